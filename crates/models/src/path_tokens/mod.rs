//! Tokens of a trajectory beside a path, and positions from velocities relative to that path, for
//! networks that read a trajectory from its first sample to its last.
//!
//! A token is `patch` samples and the sample before them: torques, velocities, sines and cosines of
//! the angles, the distance of the arm from a path, and whether the sample lies in the horizon. In
//! the horizon, angles and velocities are the path's ([`samples`]).
//!
//! Torques and velocities are in units of the trajectory's own speed, which is a channel as well:
//! an arm under three times the torque moves much like the same arm three times as fast. A network
//! gives each joint's velocity relative to that of the path at each sample, in the same unit. This
//! velocity is faded in from 0 within a tenth of a second and summed. So whatever the weights are,
//! a prediction continues from the last measured position with the path's velocity, and patches
//! meet without a jump.
//!
//! The loss is the metric: the root mean square of each joint's error over the horizon, averaged
//! over robots and joints. A squared error would give a robot with an error of 5° 2500 times the
//! weight of one with 0.1°.

mod samples;

use burn::tensor::{Tensor, TensorData};
use spec::Residual;

use self::samples::Samples;
use crate::ModelError;
use crate::architecture::{Extents, ModelInput};
use crate::loss::Loss;
use crate::sizes::{divides, within};

/// Time over which the velocity relative to the path is faded in, s. It is the time constant of the
/// heaviest joint behind its damper.
const RISE_S: f64 = 0.1;

/// Errors well below this count less, degrees.
const LEAST_ERROR_DEG: f64 = 0.01;

/// Arrays in the shape of the answer that the loss keeps: the errors, their unit and the prediction.
const KEPT_BY_LOSS: usize = 3;

/// The width of a token of `patch` samples.
pub(crate) const fn width(joints: usize, patch: usize) -> usize {
    samples::channels(joints) * (patch + 1)
}

/// The damping of the path, N·m·s/rad.
pub(crate) const fn damping(residual: Residual) -> f64 {
    match residual {
        // Specs have a path of torques.
        Residual::None | Residual::Reference => 1.0,
        Residual::Integrator(path) | Residual::LaggedIntegrator(path) => path.damping,
    }
}

/// Checks that tokens of `patch` samples make up context, horizon and the least context.
///
/// # Errors
/// [`ModelError::Size`] for the first that they do not make up.
pub(crate) fn check(
    patch: u32,
    least_context: Option<u32>,
    [context, horizon]: [u32; 2],
) -> Result<(), ModelError> {
    divides("patch", patch, "context", context)?;
    divides("patch", patch, "horizon", horizon)?;
    if let Some(least) = least_context {
        within("least_context", least, patch, context)?;
        divides("patch", patch, "least_context", least)?;
    }
    Ok(())
}

/// The displacement of the arm from the path, rad, `[batch, horizon, joint]`. From tokens `[batch,
/// token, width]` and the number of those of the context, `velocities` gives the velocities relative
/// to the path `[batch, horizon, joint]`, in units of the trajectory's speed.
pub(crate) fn displacement(
    input: &ModelInput,
    damping: f64,
    patch: usize,
    velocities: impl FnOnce(Tensor<3>, usize) -> Tensor<3>,
) -> Tensor<3> {
    let device = input.u.device();
    let samples = Samples::of(input, damping);
    let [_, context, _] = input.y_context.dims();
    let velocities = velocities(samples.tokens(patch, &device), context / patch);
    let [_, horizon, _] = velocities.dims();
    let steps = velocities * rise(horizon, input) * samples.speeds(&device);
    steps.cumsum(1) / input.rate_hz
}

/// The loss of a displacement, with the `target` of the model in its unit.
pub(crate) fn loss(displacement: Tensor<3>, input: &ModelInput, target: Tensor<3>) -> Loss {
    let unit = input.unit_of_horizon();
    let predicted = displacement.clone().detach() / unit.clone();
    let errors = (displacement - target * unit) * 1_f64.to_degrees();
    Loss::root_mean_square(errors, LEAST_ERROR_DEG, predicted)
}

/// The number of values that [`loss`] keeps of one trajectory for the backward pass.
pub(crate) const fn kept_by_loss(extents: Extents) -> usize {
    KEPT_BY_LOSS * extents.horizon as usize * extents.joints
}

/// The factor of the velocity relative to the path at each sample, `[1, horizon, 1]`.
#[expect(clippy::cast_possible_truncation, reason = "series are computed in f32")]
fn rise(horizon: usize, input: &ModelInput) -> Tensor<3> {
    let samples = RISE_S * input.rate_hz;
    let share = |sample: usize| (1.0 - (-(sample as f64) / samples).exp()) as f32;
    let shares: Vec<f32> = (1..=horizon).map(share).collect();
    Tensor::from_data(TensorData::new(shares, [1, horizon, 1]), &input.u.device())
}
