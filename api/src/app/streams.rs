//! A prediction stream. It keeps the context and the previous prediction between messages.
//!
//! docs/prediction.md documents its messages.

use std::collections::{HashSet, VecDeque};
use std::time::Instant;

use axum::body::Bytes;
use series::{Series, Shape};
use tokio::time::timeout;
use wire::{
    FilledContext, Nothing, StreamFitted, StreamLatency, StreamMessage, StreamOpened, StreamReply,
    StreamSettings, StreamStep, StreamedPrediction, StreamedTorques, WantedMotion, WarningKind,
};

use crate::app::predictions::{HeldModel, milliseconds};
use crate::app::questions::{
    RequestViolations, asked, horizon_of, noise_of_positions, read, series_of,
};
use crate::app::torques::{check_motion, contexts, motion_of, said};
use crate::checks::Checks;
use crate::error::ApiError;
use crate::limits::REQUEST_TIMEOUT;
use crate::live::{AboutModel, FittedRobot, LivePrediction, LiveQueue, Previous, Question};

/// The last samples, at most as many as the context has.
#[derive(Default)]
struct Window {
    u: VecDeque<Vec<f32>>,
    y: VecDeque<Vec<f32>>,
}

impl Window {
    fn push(&mut self, step: &StreamStep, context: usize) {
        for (window, rows) in [(&mut self.u, &step.u), (&mut self.y, &step.y)] {
            let last = &rows[rows.len().saturating_sub(context)..];
            window.extend(last.iter().cloned());
            window.drain(..window.len().saturating_sub(context));
        }
    }
}

/// A prediction from which the next one may start.
struct Last {
    positions: Vec<f32>,
    /// Number of samples since that prediction.
    age: usize,
}

/// A robot that was fitted to a context.
struct Fitted {
    robot: FittedRobot,
    /// Number of samples since then.
    age: usize,
}

pub struct PredictionStream {
    held: HeldModel,
    checks: Checks,
    settings: Option<StreamSettings>,
    window: Window,
    last: Option<Last>,
    fitted: Option<Fitted>,
    predictions: u64,
    /// Warnings that were already sent on this connection, by kind and joint.
    warned: HashSet<(WarningKind, Option<u32>)>,
}

impl PredictionStream {
    pub fn new(held: HeldModel, checks: Checks) -> Self {
        Self {
            held,
            checks,
            settings: None,
            window: Window::default(),
            last: None,
            fitted: None,
            predictions: 0,
            warned: HashSet::new(),
        }
    }

    /// The answer to a message. A refused message changes nothing.
    pub async fn answer(&mut self, message: Bytes) -> StreamReply {
        let arrived = Instant::now();
        let answered = match self.read(message).await {
            Ok(StreamMessage::Open(settings)) => {
                self.open(settings).await.map_err(|error| error.within("open"))
            }
            Ok(StreamMessage::Step(step)) => self.step(step, arrived).await,
            Ok(StreamMessage::Fit(Nothing {})) => self.fit(arrived).await,
            Ok(StreamMessage::Motion(motion)) => self.torques(&motion, arrived),
            Ok(StreamMessage::Reset(Nothing {})) => {
                self.window = Window::default();
                (self.last, self.fitted) = (None, None);
                Ok(StreamReply::Context(self.filled()))
            }
            Err(error) => Err(error),
        };
        answered.unwrap_or_else(|error| Self::refusal(&error))
    }

    /// Reads a message, and checks a step or a motion.
    async fn read(&self, message: Bytes) -> Result<StreamMessage, ApiError> {
        let (is_open, filled) = (self.settings.is_some(), self.window.u.len());
        let (about, bytes) = (self.held.about.clone(), message.len());
        let read = move || {
            let read = read(&message, ApiError::Question)?;
            match &read {
                StreamMessage::Step(step) if is_open => check(step, filled, &about)?,
                StreamMessage::Motion(motion) => {
                    let mut violations = RequestViolations::default();
                    check_motion("motion", motion, about.joints, &mut violations);
                    violations.finish()?;
                }
                _ => {}
            }
            Ok(read)
        };
        self.checks.run(bytes, read).await
    }

    pub fn refusal(error: &ApiError) -> StreamReply {
        error.log();
        StreamReply::Error(error.to_problem())
    }

    /// Makes a trial prediction with the settings. It also makes the first real prediction as fast
    /// as the later ones. Samples at another rate are forgotten.
    async fn open(&mut self, settings: StreamSettings) -> Result<StreamReply, ApiError> {
        let held = self.held.at(settings.rate_hz)?;
        let about = &held.about;
        let AboutModel { context, horizon, joints, .. } = *about;
        let mut violations = RequestViolations::default();
        violations.sampling(&settings.sampling, 1, about);
        violations.position_noise(settings.position_noise_rad);
        violations.finish()?;
        let rest = |samples: usize| vec![0.0; samples * joints];
        let scenario = scenario(about, rest(context + horizon), rest(context))?;
        let noise = noise_of_positions(settings.position_noise_rad);
        let question = asked(&settings.sampling, scenario.with_noise(noise));
        if let Some(steps) = settings.warm_start_steps {
            let previous = Some(Previous { positions: rest(horizon), shift: 1, steps });
            self.ask(Question { previous, ..question.clone() }).await?;
        }
        self.ask(question).await?;
        if context != self.held.about.context {
            self.window = Window::default();
        }
        self.settings = Some(settings);
        (self.last, self.fitted) = (None, None);
        self.held = held;
        let model = self.held.resource.clone();
        Ok(StreamReply::Opened(StreamOpened { model, filled: self.filled(), horizon }))
    }

    async fn step(&mut self, step: StreamStep, arrived: Instant) -> Result<StreamReply, ApiError> {
        let AboutModel { context, horizon, .. } = self.held.about;
        let Some(settings) = self.settings.clone() else {
            let mut violations = RequestViolations::default();
            violations.add("step", "the first message", "after open");
            return Err(violations.finish().err().unwrap_or(ApiError::Internal));
        };
        let seen = step.u.len();
        self.window.push(&step, context);
        if let Some(last) = &mut self.last {
            last.age += seen;
        }
        if let Some(fitted) = &mut self.fitted {
            fitted.age += seen;
        }
        let Some(future_u) = step.future_u else { return Ok(StreamReply::Context(self.filled())) };

        let u = self.window.u.iter().chain(&future_u).flatten().copied().collect();
        let y = self.window.y.iter().flatten().copied().collect();
        // A prediction that is older than its horizon does not overlap the next one.
        let last = self.last.take().filter(|last| last.age < horizon);
        let previous = settings.warm_start_steps.zip(last).map(|(steps, last)| Previous {
            positions: last.positions,
            shift: last.age,
            steps,
        });
        let warm_start_shift = previous.as_ref().map(|previous| previous.shift);
        let noise = noise_of_positions(settings.position_noise_rad);
        let scenario = scenario(&self.held.about, u, y)?.with_noise(noise);
        let question = Question { previous, ..asked(&settings.sampling, scenario) };
        let prediction = self.ask(question).await?;
        let (queued, computed) = (prediction.queued, prediction.computed);
        let mut warnings = prediction.warnings.clone();
        let bytes = prediction.answered_bytes(&settings.sampling);
        let answer = move || Ok(prediction.of(0, 1, horizon, &settings.sampling));
        let predicted = self.checks.run(bytes, answer).await?;
        self.last = Some(Last { positions: predicted.y.concat(), age: 0 });
        let number = self.predictions;
        self.predictions += 1;
        let latency_ms = StreamLatency {
            queue: milliseconds(queued),
            compute: milliseconds(computed),
            total: milliseconds(arrived.elapsed()),
        };
        warnings.retain(|warning| self.warned.insert((warning.kind, warning.joint)));
        Ok(StreamReply::Prediction(StreamedPrediction {
            number,
            predicted,
            warm_start_shift,
            latency_ms,
            warnings,
        }))
    }

    /// Fits a robot to the context.
    async fn fit(&mut self, arrived: Instant) -> Result<StreamReply, ApiError> {
        let (about, filled) = (&self.held.about, self.window.u.len());
        let Some(settings) = self.settings.as_ref().filter(|_| filled == about.context) else {
            let mut violations = RequestViolations::default();
            let allowed =
                format!("after open and {} samples, which fill the context", about.context);
            violations.add("fit", format!("after {filled} samples"), allowed);
            return Err(violations.finish().err().unwrap_or(ApiError::Internal));
        };
        let (u, y) = (self.window.u.make_contiguous(), self.window.y.make_contiguous());
        let noise = settings.position_noise_rad;
        let contexts = contexts([&*u].into_iter(), [&*y].into_iter(), noise, about)?;
        let fitting = self.held.model.fit(contexts, LiveQueue::Streams);
        let mut fit = timeout(REQUEST_TIMEOUT, fitting).await.map_err(|_| ApiError::Timeout)??;
        self.fitted = fit.robots.pop().map(|robot| Fitted { robot, age: 0 });
        fit.warnings.retain(|warning| self.warned.insert((warning.kind, warning.joint)));
        let latency_ms = StreamLatency {
            queue: milliseconds(fit.queued),
            compute: milliseconds(fit.computed),
            total: milliseconds(arrived.elapsed()),
        };
        Ok(StreamReply::Fitted(StreamFitted { latency_ms, warnings: fit.warnings }))
    }

    /// The torques of a motion of the fitted robot. They are computed at once, because a controller
    /// waits for them at its own rate.
    fn torques(&self, motion: &WantedMotion, arrived: Instant) -> Result<StreamReply, ApiError> {
        let Some(Fitted { robot, age }) = &self.fitted else {
            let mut violations = RequestViolations::default();
            violations.add("motion", "before fit", "after fit");
            return Err(violations.finish().err().unwrap_or(ApiError::Internal));
        };
        let about = &self.held.about;
        // A controller must not miss a warning about the torques that it is about to use, so these
        // are repeated.
        let (said, warnings) = said(robot, &motion_of(motion, about.joints)?, &about.limits)?;
        let latency_ms = milliseconds(arrived.elapsed());
        Ok(StreamReply::Torques(StreamedTorques { said, age: *age, latency_ms, warnings }))
    }

    async fn ask(&self, question: Question) -> Result<LivePrediction, ApiError> {
        let prediction = self.held.model.predict(question, LiveQueue::Streams);
        Ok(timeout(REQUEST_TIMEOUT, prediction).await.map_err(|_| ApiError::Timeout)??)
    }

    fn filled(&self) -> FilledContext {
        FilledContext { filled: self.window.u.len(), context: self.held.about.context }
    }
}

/// One robot: torques of context and horizon, and positions of the context.
fn scenario(about: &AboutModel, u: Vec<f32>, y: Vec<f32>) -> Result<Series, ApiError> {
    let AboutModel { context, horizon, joints, rate_hz, .. } = *about;
    let shape = Shape { robots: 1, samples: context + horizon, joints };
    series_of(shape, context, rate_hz, u, y)
}

/// Checks a step, before which the context has `filled` samples.
fn check(step: &StreamStep, filled: usize, about: &AboutModel) -> Result<(), ApiError> {
    let mut violations = RequestViolations::default();
    let AboutModel { context, horizon, joints, .. } = *about;
    let seen = step.u.len();
    if seen == 0 {
        violations.add("step.u", "0 rows", "at least one row");
    }
    violations.rows("step.y", &step.y, seen, "as many as u");
    violations.values("step.u", &step.u, joints);
    violations.values("step.y", &step.y, joints);
    if let Some(future_u) = &step.future_u {
        violations.rows("step.future_u", future_u, horizon, &horizon_of(about));
        violations.values("step.future_u", future_u, joints);
        let filled = filled + seen;
        if filled < context {
            let found = format!("given after {filled} samples");
            let allowed = format!("left out until the context has its {context} samples");
            violations.add("step.future_u", found, allowed);
        }
    }
    violations.finish()
}
