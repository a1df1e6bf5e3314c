use spec::JOINTS;

use crate::ModelError;

/// Whole trajectories, context and horizon.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// Torques `[size, samples, 7]`, N·m.
    pub u: Vec<f32>,
    /// Joint positions `[size, samples, 7]`, rad.
    pub y: Vec<f32>,
    pub size: usize,
    pub samples: usize,
}

impl Batch {
    pub(crate) fn check(&self, samples: usize) -> Result<(), ModelError> {
        if self.samples != samples {
            return Err(ModelError::Samples { actual: self.samples, expected: samples });
        }
        if self.size == 0 {
            let expected = samples.saturating_mul(JOINTS);
            return Err(ModelError::Length { what: "u", actual: 0, expected });
        }
        check_series("u", &self.u, self.size, samples)?;
        check_series("y", &self.y, self.size, samples)
    }

    /// At most `size` trajectories from `first` on, of a batch that was checked.
    pub(crate) fn part(&self, first: usize, size: usize) -> Self {
        let row = self.samples * JOINTS;
        let end = (first + size).min(self.size);
        Self {
            u: self.u[first * row..end * row].to_vec(),
            y: self.y[first * row..end * row].to_vec(),
            size: end - first,
            samples: self.samples,
        }
    }

    pub(crate) fn known(&self, context: usize) -> PredictionInput {
        let y_context = self
            .y
            .chunks_exact(self.samples * JOINTS)
            .flat_map(|trajectory| &trajectory[..context * JOINTS])
            .copied()
            .collect();
        PredictionInput { u: self.u.clone(), y_context, size: self.size }
    }
}

/// All that a predictor may know: every torque, and the positions of the context.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictionInput {
    /// Torques `[size, samples, 7]`, N·m.
    pub u: Vec<f32>,
    /// Joint positions `[size, context, 7]`, rad.
    pub y_context: Vec<f32>,
    pub size: usize,
}

impl PredictionInput {
    pub(crate) fn check(&self, samples: usize, context: usize) -> Result<(), ModelError> {
        check_series("u", &self.u, self.size, samples)?;
        check_series("y_context", &self.y_context, self.size, context)
    }
}

fn check_series(
    what: &'static str,
    values: &[f32],
    size: usize,
    samples: usize,
) -> Result<(), ModelError> {
    let row = samples * JOINTS;
    if size.checked_mul(row) != Some(values.len()) {
        let expected = size.saturating_mul(row);
        return Err(ModelError::Length { what, actual: values.len(), expected });
    }
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(ModelError::NotFiniteInput { what, trajectory: index / row }),
        None => Ok(()),
    }
}
