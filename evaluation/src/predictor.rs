use spec::JOINTS;

use crate::EvaluationError;

/// Scenarios of equal length, with everything that was recorded.
///
/// `u` in N·m and `y` in rad, both `[size, samples, 7]`; sample k of y is the state before
/// torque k acts.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenarios {
    pub size: usize,
    pub samples: usize,
    pub rate_hz: f64,
    pub u: Vec<f32>,
    pub y: Vec<f32>,
}

/// What a predictor is given: every torque, and the positions of the context only.
#[derive(Clone, Debug, PartialEq)]
pub struct Observed {
    pub size: usize,
    pub samples: usize,
    /// Samples of y that are known.
    pub context: usize,
    pub rate_hz: f64,
    /// `[size, samples, 7]`, N·m.
    pub u: Vec<f32>,
    /// `[size, context, 7]`, rad.
    pub y: Vec<f32>,
}

impl Scenarios {
    /// Hides the horizon's positions.
    pub fn observed(&self, context: usize) -> Observed {
        let y = self
            .y
            .chunks_exact(self.samples * JOINTS)
            .flat_map(|trajectory| &trajectory[..context * JOINTS])
            .copied()
            .collect();
        Observed {
            size: self.size,
            samples: self.samples,
            context,
            rate_hz: self.rate_hz,
            u: self.u.clone(),
            y,
        }
    }
}

impl Observed {
    pub fn horizon(&self) -> usize {
        self.samples - self.context
    }

    /// Torques `[samples][7]` of one scenario.
    pub fn torques(&self, scenario: usize) -> &[[f32; JOINTS]] {
        let all = self.u.as_chunks().0;
        &all[scenario * self.samples..(scenario + 1) * self.samples]
    }

    /// Context positions `[context][7]` of one scenario.
    pub fn positions(&self, scenario: usize) -> &[[f32; JOINTS]] {
        let all = self.y.as_chunks().0;
        &all[scenario * self.context..(scenario + 1) * self.context]
    }
}

/// Anything that answers how the arm will move.
pub trait Predictor {
    /// How tables and figures call it.
    fn name(&self) -> &str;

    /// Positions of the horizon, `[size, horizon, 7]`, in rad.
    fn predict(&self, observed: &Observed) -> Result<Vec<f32>, EvaluationError>;
}
