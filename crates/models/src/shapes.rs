//! Checks that series fit a model.

use series::{Observed, SeriesView};
use spec::{Length, ModelSpec};

use crate::ModelError;

/// Checks a batch of whole trajectories of `samples` samples. It needs at least one trajectory.
pub(crate) fn check_batch(
    batch: &SeriesView<'_>,
    samples: usize,
    joints: usize,
) -> Result<(), ModelError> {
    expect("samples of u", batch.samples(), samples)?;
    expect("samples of y", batch.known(), samples)?;
    expect("joints", batch.joints(), joints)?;
    if batch.robots() == 0 {
        return expect("trajectories", 0, 1);
    }
    (0..batch.robots()).try_for_each(|robot| {
        check_finite("u", robot, batch.u(robot).values())?;
        check_finite("y", robot, batch.y(robot).values())
    })
}

/// Checks a question to a model that was trained on trajectories of length `trained`.
pub(crate) fn check_observed(
    observed: &Observed<'_>,
    model: &ModelSpec,
    trained: Length,
    joints: usize,
) -> Result<(), ModelError> {
    let [context, samples] = [observed.context(), observed.samples()]
        .map(|samples| u32::try_from(samples).unwrap_or(u32::MAX));
    let nearest = model.lengths().nearest(Length { context, samples }, trained, model.patch());
    expect("samples of u", observed.samples(), nearest.samples as usize)?;
    expect("samples of y", observed.context(), nearest.context as usize)?;
    expect("joints", observed.joints(), joints)?;
    (0..observed.robots()).try_for_each(|robot| {
        check_finite("u", robot, observed.u(robot).values())?;
        check_finite("y", robot, observed.y(robot).values())
    })
}

fn expect(what: &'static str, actual: usize, expected: usize) -> Result<(), ModelError> {
    if actual == expected {
        return Ok(());
    }
    Err(ModelError::Shape { what, actual, expected })
}

fn check_finite(what: &'static str, trajectory: usize, values: &[f32]) -> Result<(), ModelError> {
    if values.iter().all(|value| value.is_finite()) {
        return Ok(());
    }
    Err(ModelError::NotFiniteInput { what, trajectory })
}
