//! A loaded model that makes predictions.

use std::sync::Arc;

use api::live::{AboutModel, LiveError, LiveModel, LivePrediction, LiveQueue, Question};
use futures::FutureExt;
use futures::future::BoxFuture;
use models::{
    DeviceKind, Interrupt, ModelError, Sampling, TrainedModel, WarmStart, context_warnings,
    limit_warnings,
};
use spec::SpecError;
use wire::Warning;

use crate::queues::{Done, LiveQueues, Panic};

pub struct Loaded {
    model: Arc<TrainedModel>,
    about: AboutModel,
    queues: Arc<LiveQueues>,
}

impl Loaded {
    pub fn new(model: TrainedModel, device: DeviceKind, queues: Arc<LiveQueues>) -> Self {
        let about = AboutModel {
            context: model.context(),
            horizon: model.horizon(),
            joints: model.joints(),
            rate_hz: model.rate_hz(),
            needs_future: model.needs_leak(),
            device: device.name().to_owned(),
            threads: queues.threads,
        };
        Self { model: Arc::new(model), about, queues }
    }
}

impl LiveModel for Loaded {
    fn about(&self) -> &AboutModel {
        &self.about
    }

    fn predict(
        &self,
        question: Question,
        queue: LiveQueue,
    ) -> BoxFuture<'static, Result<LivePrediction, LiveError>> {
        let (model, queues) = (Arc::clone(&self.model), Arc::clone(&self.queues));
        async move {
            let samples = question.samples.unwrap_or(1);
            let work = move |interrupt: &Interrupt| ask(&model, question, interrupt);
            let Done { result, queued, computed } = queues.of(queue).run(work).await?;
            let Predicted { positions, warnings } = result
                .map_err(|Panic(reason)| LiveError::Failed { reason })?
                .map_err(live_error)?;
            if positions.iter().any(|position| !position.is_finite()) {
                let reason = "it predicts positions that are not finite".to_owned();
                return Err(LiveError::Failed { reason });
            }
            Ok(LivePrediction { positions, samples, warnings, queued, computed })
        }
        .boxed()
    }
}

/// The predicted positions, with the warnings about the request and about them.
struct Predicted {
    positions: Vec<f32>,
    warnings: Vec<Warning>,
}

fn ask(
    model: &TrainedModel,
    question: Question,
    interrupt: &Interrupt,
) -> Result<Predicted, ModelError> {
    let Question { scenarios, samples, sampler, seed, previous } = question;
    let observed = scenarios.observed(model.context());
    let warm_start = previous.map(|previous| WarmStart {
        previous: previous.positions,
        shift: previous.shift,
        steps: previous.steps,
    });
    let sampling =
        Sampling { sampler, seed, samples: samples.unwrap_or(1), first_scenario: 0, warm_start };
    let positions = interrupt.guard(|| match samples {
        None => model.predict_with(&observed, &sampling),
        Some(_) => model.sample(&observed, &sampling),
    })?;
    let config = model.config();
    let mut warnings = context_warnings(&observed);
    warnings.extend(model.warnings(&observed)?);
    let (robots, horizon) = (observed.robots(), observed.horizon());
    warnings.extend(limit_warnings(&positions, robots, horizon, &config.limits_rad));
    Ok(Predicted { positions, warnings })
}

/// The error for a request that the model cannot answer, or for a failure of the model.
fn live_error(error: ModelError) -> LiveError {
    let refused = |field: &str, value: String, allowed: String| {
        LiveError::Refused(SpecError::one(field, value, allowed))
    };
    match error {
        ModelError::NotGenerative => {
            let allowed = "left out, for a model that has one answer to a question";
            refused("sampling.samples", "given".to_owned(), allowed.to_owned())
        }
        ModelError::Sampling { field, value, allowed } if field.starts_with("warm_start") => {
            refused("warm_start_steps", value, allowed)
        }
        ModelError::Sampling { field, value, allowed } => {
            refused(&format!("sampling.{field}"), value, allowed)
        }
        ModelError::Spec(error) => LiveError::Refused(error.within("sampling")),
        error => LiveError::Failed { reason: error.to_string() },
    }
}
