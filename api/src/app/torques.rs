//! The torques that motions take: the inverse question to a checkpoint.

use std::sync::Arc;
use std::time::Instant;

use axum::body::Bytes;
use series::{JointMotion, Series, Shape, ShapeError};
use spec::{Digest, Range, SpecError};
use wire::{
    PredictionLatency, SaidTorques, TorqueAnswer, TorqueRequest, WantedMotion, Warning, WarningKind,
};

use crate::app::App;
use crate::app::predictions::{HeldModel, milliseconds, narrow, rows};
use crate::app::questions::{RequestViolations, context_of, noise_of_positions, series_of};
use crate::error::ApiError;
use crate::limits::{MOTION_INSTANTS, TORQUE_SCENARIOS};
use crate::live::{AboutModel, FittedRobot, JointLimits, LiveError, LiveFit, LiveQueue};

impl App {
    /// The answer to a [`TorqueRequest`], a [`TorqueAnswer`] as JSON.
    ///
    /// # Errors
    /// Like [`App::held_model`]. [`ApiError::Question`] with everything that is wrong with the
    /// request.
    pub(crate) async fn say_torques(
        &self,
        checkpoint: i64,
        body: Bytes,
    ) -> Result<Vec<u8>, ApiError> {
        let bytes = body.len();
        let request: TorqueRequest = self.read_body(body, ApiError::Question).await?;
        let asked = Instant::now();
        let held = self.held_model(checkpoint).await?.at(request.rate_hz)?;
        let HeldModel { resource, model, about } = held;
        let load = milliseconds(asked.elapsed());
        let limits = Arc::clone(&about.limits);
        let question = move || question(&request, &about);
        let (robots, motions) = self.checks.run(bytes, question).await?;
        let fit = match robots {
            Robots::Of(digest) => {
                let is_of_these = |fit: &LiveFit| fit.robots.len() == motions.len();
                let known = model.remembered(digest).filter(is_of_these);
                known.ok_or_else(|| forgotten(digest))?
            }
            Robots::Observed(contexts) => model.fit(contexts, LiveQueue::Requests).await?,
        };
        let write = move || {
            let computing = Instant::now();
            let mut scenarios = Vec::with_capacity(motions.len());
            let mut beyond = Vec::new();
            for (robot, motion) in fit.robots.iter().zip(&motions) {
                let (said, warnings) = said(robot, motion, &limits)?;
                scenarios.push(said);
                beyond.extend(warnings);
            }
            let mut warnings = fit.warnings;
            warnings.extend(Warning::merge(beyond));
            let queue = milliseconds(fit.queued);
            let compute = milliseconds(fit.computed + computing.elapsed());
            let latency_ms = PredictionLatency { load, queue, compute };
            let answer =
                TorqueAnswer { model: resource, fit: fit.digest, scenarios, latency_ms, warnings };
            // It has only strings and finite numbers, so this cannot fail.
            serde_json::to_vec(&answer).map_err(|_| ApiError::Internal)
        };
        // A torque takes about as long as ten bytes of JSON.
        self.checks.run(bytes, write).await
    }
}

/// The refusal of robots that are not remembered.
fn forgotten(digest: Digest) -> ApiError {
    let allowed = "that of an earlier answer to as many scenarios, which the server still remembers; \
                   ask again with u and y";
    ApiError::Question(SpecError::one("fit", digest.to_string(), allowed))
}

/// The torques of a motion, with a warning for each joint that leaves `limits`, if they are known.
///
/// # Errors
/// [`LiveError::Failed`] if they are not finite.
pub(super) fn said(
    robot: &FittedRobot,
    motion: &JointMotion,
    limits: &[JointLimits],
) -> Result<(SaidTorques, Vec<Warning>), ApiError> {
    let torques = robot(motion);
    if torques.iter().any(|torque| !torque.is_finite()) {
        let reason = "it says torques that are not finite".to_owned();
        return Err(ApiError::Live(LiveError::Failed { reason }));
    }
    let warnings = beyond_limits(motion, &torques, limits);
    Ok((SaidTorques { u: rows(&torques, motion.joints()) }, warnings))
}

/// A warning for each quantity and joint that leaves its limits.
fn beyond_limits(motion: &JointMotion, torques: &[f32], limits: &[JointLimits]) -> Vec<Warning> {
    let torques: Vec<f64> = torques.iter().copied().map(f64::from).collect();
    let within = |largest: f64| Range::new(-largest, largest);
    let range_of = |kind: WarningKind, limits: &JointLimits| match kind {
        WarningKind::PositionLimits => limits.position_rad,
        WarningKind::VelocityLimits => within(limits.velocity_rad_s),
        _ => within(limits.torque_nm),
    };
    let quantities = [
        (WarningKind::PositionLimits, motion.q()),
        (WarningKind::VelocityLimits, motion.qd()),
        (WarningKind::TorqueLimits, &torques),
    ];
    let mut warnings = Vec::new();
    for (kind, values) in quantities {
        for ((joint, limits), number) in limits.iter().enumerate().zip(1..) {
            let range = range_of(kind, limits);
            let of_joint = values.iter().skip(joint).step_by(motion.joints()).copied();
            let reached = furthest(of_joint, range);
            warnings
                .extend(reached.map(|reached| Warning::outside(kind, number, reached, range, 1)));
        }
    }
    warnings
}

/// The value that lies furthest outside of `range`, if any does. Values are those of f32, so the ends
/// are rounded to it.
fn furthest(values: impl Iterator<Item = f64>, range: Range) -> Option<f64> {
    let [min, max] = [range.min, range.max].map(|end| f64::from(narrow(end)));
    let beyond = |value: &f64| (min - value).max(value - max);
    values.filter(|value| beyond(value) > 0.0).max_by(|a, b| beyond(a).total_cmp(&beyond(b)))
}

/// The robots that a request asks about.
enum Robots {
    /// Those of an earlier fit.
    Of(Digest),
    /// Those that explain contexts.
    Observed(Series),
}

/// The robots of a request, and its motions.
///
/// # Errors
/// Every violation.
fn question(
    request: &TorqueRequest,
    about: &AboutModel,
) -> Result<(Robots, Vec<JointMotion>), ApiError> {
    let TorqueRequest { scenarios, fit, position_noise_rad, rate_hz: _ } = request;
    let AboutModel { context, joints, .. } = *about;
    let (context, why) = match fit {
        Some(_) => (0, "because fit names the robots".to_owned()),
        None => (context, context_of(about)),
    };
    let mut violations = RequestViolations::default();
    if !(1..=TORQUE_SCENARIOS).contains(&scenarios.len()) {
        let allowed = format!("1 to {TORQUE_SCENARIOS}");
        violations.add("scenarios", format!("{} of them", scenarios.len()), allowed);
    }
    for (index, scenario) in scenarios.iter().enumerate() {
        let field = |name: &str| format!("scenarios[{index}].{name}");
        for (name, of_context) in [("u", &scenario.u), ("y", &scenario.y)] {
            violations.rows(&field(name), of_context, context, &why);
            violations.values(&field(name), of_context, joints);
        }
        check_motion(&field("motion"), &scenario.motion, joints, &mut violations);
    }
    violations.position_noise(*position_noise_rad);
    violations.finish()?;
    let u = scenarios.iter().map(|scenario| scenario.u.as_slice());
    let y = scenarios.iter().map(|scenario| scenario.y.as_slice());
    let contexts = match fit {
        Some(digest) => Robots::Of(*digest),
        None => Robots::Observed(contexts(u, y, *position_noise_rad, about)?),
    };
    let motions = scenarios.iter().map(|scenario| motion_of(&scenario.motion, joints));
    Ok((contexts, motions.collect::<Result<_, _>>()?))
}

/// Series whose horizon is one sample with the last torque.
pub(super) fn contexts<'a>(
    u: impl Iterator<Item = &'a [Vec<f32>]>,
    y: impl Iterator<Item = &'a [Vec<f32>]>,
    position_noise_rad: f64,
    about: &AboutModel,
) -> Result<Series, ApiError> {
    let AboutModel { context, joints, rate_hz, .. } = *about;
    let mut torques = Vec::new();
    let mut robots = 0;
    for of_robot in u {
        robots += 1;
        torques.extend(of_robot.iter().chain(of_robot.last()).flatten());
    }
    let positions = y.flatten().flatten().copied().collect();
    let shape = Shape { robots, samples: context + 1, joints };
    let series = series_of(shape, context, rate_hz, torques, positions)?;
    Ok(series.with_noise(noise_of_positions(position_noise_rad)))
}

/// Checks a motion that a client sent.
pub(super) fn check_motion(
    field: &str,
    motion: &WantedMotion,
    joints: usize,
    violations: &mut RequestViolations,
) {
    let instants = motion.q.len();
    if !(1..=MOTION_INSTANTS).contains(&instants) {
        let allowed = format!("1 to {MOTION_INSTANTS} rows");
        violations.add(format!("{field}.q"), format!("{instants} rows"), allowed);
    }
    for (name, values) in [("q", &motion.q), ("qd", &motion.qd), ("qdd", &motion.qdd)] {
        let field = format!("{field}.{name}");
        violations.rows(&field, values, instants, "as many as q");
        violations.values(&field, values, joints);
    }
}

/// A motion that was checked before, so an error is a fault of this program.
pub(super) fn motion_of(motion: &WantedMotion, joints: usize) -> Result<JointMotion, ApiError> {
    let wide = |rows: &[Vec<f32>]| rows.iter().flatten().copied().map(f64::from).collect();
    let WantedMotion { q, qd, qdd } = motion;
    let refused =
        |error: ShapeError| ApiError::Question(SpecError::one("motion", "rows", error.to_string()));
    JointMotion::new(joints, wide(q), wide(qd), wide(qdd)).map_err(refused)
}
