//! A loaded model that makes predictions.

use std::sync::Arc;
use std::time::Duration;

use api::live::{
    AboutModel, FittedRobot, JointLimits, LiveError, LiveFit, LiveModel, LivePrediction, LiveQueue,
    Question,
};
use futures::FutureExt;
use futures::future::BoxFuture;
use models::{
    DeviceKind, Interrupt, ModelError, Sampling, TrainedModel, WarmStart, context_warnings,
    limit_warnings,
};
use series::Series;
use sha2::{Digest as _, Sha256};
use spec::{Digest, SpecError};
use wire::Warning;

use crate::cache::{Cache, Capacity};
use crate::queues::{Done, LiveQueues, Panic};

/// Number of questions whose fitted robots a model remembers.
const REMEMBERED_FITS: usize = 256;

/// Limit of the memory of these robots, in bytes. Each fit holds the law, which is as large as the
/// weights. One fit is always remembered.
const REMEMBERED_BYTES: u64 = 64 << 20;

pub struct Loaded {
    model: Arc<TrainedModel>,
    about: AboutModel,
    queues: Arc<LiveQueues>,
    /// By the digest of their contexts.
    fits: Arc<Cache<Digest, LiveFit>>,
    /// Bytes of the weights.
    bytes: u64,
}

impl Loaded {
    /// A model whose weights take `bytes` bytes.
    pub fn new(
        model: TrainedModel,
        bytes: u64,
        device: DeviceKind,
        queues: Arc<LiveQueues>,
    ) -> Self {
        let about = AboutModel {
            context: model.context(),
            horizon: model.horizon(),
            joints: model.joints(),
            rate_hz: model.rate_hz(),
            lengths: model.architecture().lengths(),
            given: model.config().given,
            limits: model
                .architecture()
                .robot()
                .map(|robot| JointLimits::of(robot.model.description()))
                .unwrap_or_default(),
            has_samples: model.is_generative(),
            sampler: model.architecture().sampler().copied(),
            needs_future: model.needs_leak(),
            device: device.name().to_owned(),
            threads: queues.threads,
        };
        let capacity = Capacity { count: REMEMBERED_FITS, bytes: REMEMBERED_BYTES.max(bytes) };
        Self { model: Arc::new(model), about, queues, fits: Arc::new(Cache::new(capacity)), bytes }
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

    fn fit(
        &self,
        contexts: Series,
        queue: LiveQueue,
    ) -> BoxFuture<'static, Result<LiveFit, LiveError>> {
        let (model, queues, fits) =
            (Arc::clone(&self.model), Arc::clone(&self.queues), Arc::clone(&self.fits));
        let bytes = self.bytes;
        async move {
            let digest = digest_of(&contexts);
            let mut is_new = false;
            let load = || {
                is_new = true;
                fit(model, contexts, digest, queue, queues)
            };
            let found = fits.get(digest, bytes, load).await?;
            let mut found = LiveFit::clone(&found);
            if !is_new {
                (found.queued, found.computed) = (Duration::ZERO, Duration::ZERO);
            }
            Ok(found)
        }
        .boxed()
    }

    fn remembered(&self, digest: Digest) -> Option<LiveFit> {
        let found = self.fits.loaded(digest)?;
        Some(LiveFit { queued: Duration::ZERO, computed: Duration::ZERO, ..LiveFit::clone(&found) })
    }
}

async fn fit(
    model: Arc<TrainedModel>,
    contexts: Series,
    digest: Digest,
    queue: LiveQueue,
    queues: Arc<LiveQueues>,
) -> Result<LiveFit, LiveError> {
    let work = move |interrupt: &Interrupt| {
        let observed = contexts.observed(contexts.known());
        let robots = interrupt.guard(|| model.fit(&observed))?;
        let mut warnings = context_warnings(&observed);
        warnings.extend(model.warnings(&observed)?);
        Ok((robots, warnings))
    };
    let Done { result, queued, computed } = queues.of(queue).run(work).await?;
    let (robots, warnings) =
        result.map_err(|Panic(reason)| LiveError::Failed { reason })?.map_err(live_error)?;
    let robots = robots.ok_or_else(LiveError::says_no_torques)?;
    let robots = robots.into_iter().map(FittedRobot::from).collect();
    Ok(LiveFit { digest, robots, warnings, queued, computed })
}

/// The digest of everything that a fit depends on.
fn digest_of(contexts: &Series) -> Digest {
    let mut digest = Sha256::new();
    digest.update(contexts.rate_hz().to_le_bytes());
    digest.update(contexts.noise().position_rad.to_le_bytes());
    for value in [contexts.u(), contexts.y()].into_iter().flatten() {
        digest.update(value.to_le_bytes());
    }
    Digest::from_bytes(digest.finalize().into())
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
    let observed = scenarios.observed(scenarios.known());
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
