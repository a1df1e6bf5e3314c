//! That series are what a model takes.

use series::{Observed, SeriesView};

use crate::ModelError;

/// Whole trajectories of `samples` samples, at least one.
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

/// Checks the question to a model of `samples` samples, `context` of them known.
pub(crate) fn check_observed(
    observed: &Observed<'_>,
    samples: usize,
    context: usize,
    joints: usize,
) -> Result<(), ModelError> {
    expect("samples of u", observed.samples(), samples)?;
    expect("samples of y", observed.context(), context)?;
    expect("joints", observed.joints(), joints)?;
    (0..observed.robots()).try_for_each(|robot| {
        check_finite("u", robot, observed.u(robot).values())?;
        check_finite("y", robot, observed.y(robot).values())
    })
}

/// Checks the question to a model that has no size of context or horizon.
pub(crate) fn check_any_length(observed: &Observed<'_>, joints: usize) -> Result<(), ModelError> {
    /// A sample with one before it and one after it.
    const LEAST_CONTEXT: usize = 3;

    let context = observed.context().max(LEAST_CONTEXT);
    check_observed(observed, observed.samples(), context, joints)
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
