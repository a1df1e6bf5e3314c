use spec::JOINTS;

use crate::EvaluationError;

/// Scenarios of equal length, with everything that was recorded.
///
/// `u` in N·m and `y` in rad, both `[size, pre_roll + samples, 7]`; sample k of y is the state before
/// torque k acts.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenarios {
    pub size: usize,
    /// Samples of the window that is asked about: context and horizon.
    pub samples: usize,
    /// Samples before that window. Only predictors that go on from predictions of their own, made
    /// earlier, use them.
    pub pre_roll: usize,
    pub rate_hz: f64,
    pub u: Vec<f32>,
    pub y: Vec<f32>,
}

/// What a predictor is given: every torque, and the positions of the context only.
#[derive(Clone, Debug, PartialEq)]
pub struct Observed {
    pub size: usize,
    /// Context and horizon.
    pub samples: usize,
    /// Samples of y that are known.
    pub context: usize,
    pub rate_hz: f64,
    /// `[size, samples, 7]`, N·m.
    pub u: Vec<f32>,
    /// `[size, context, 7]`, rad.
    pub y: Vec<f32>,
    before: Before,
}

/// What was recorded before a window, `[size, samples, 7]` each.
#[derive(Clone, Debug, PartialEq)]
struct Before {
    samples: usize,
    u: Vec<f32>,
    y: Vec<f32>,
}

impl Scenarios {
    /// Hides the horizon's positions.
    ///
    /// # Panics
    /// When there are not `size` scenarios in `u` and `y`, or the context is longer than the window.
    pub fn observed(&self, context: usize) -> Observed {
        assert!(context <= self.samples, "a context within the window");
        let Self { size, samples, pre_roll, rate_hz, .. } = *self;
        let of =
            |series: &[f32], first, count| part(series, size, pre_roll + samples, first, count);
        Observed {
            size,
            samples,
            context,
            rate_hz,
            u: of(&self.u, pre_roll, samples),
            y: of(&self.y, pre_roll, context),
            before: Before {
                samples: pre_roll,
                u: of(&self.u, 0, pre_roll),
                y: of(&self.y, 0, pre_roll),
            },
        }
    }

    /// Positions of the horizon after `context` samples, `[size, horizon, 7]`, rad.
    ///
    /// # Panics
    /// As [`Scenarios::observed`].
    pub fn horizon_positions(&self, context: usize) -> Vec<f32> {
        let row = self.pre_roll + self.samples;
        part(&self.y, self.size, row, self.pre_roll + context, self.samples - context)
    }
}

impl Observed {
    pub fn horizon(&self) -> usize {
        self.samples - self.context
    }

    /// Samples that are known before the window.
    pub fn pre_roll(&self) -> usize {
        self.before.samples
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

    /// The window of the same length `shift` samples ago: what a predictor was asked then. It knows
    /// nothing that this one does not, since its context ends `shift` samples before this one's.
    /// `None` when the recording begins later.
    pub fn earlier(&self, shift: usize) -> Option<Self> {
        let pre_roll = self.before.samples.checked_sub(shift)?;
        // What is known of a series from the beginning of the recording: before the window and in it.
        let known = |before: &[f32], window: &[f32], own: usize, first: usize, count: usize| {
            let width = self.before.samples * JOINTS;
            let mut picked = Vec::with_capacity(self.size * count * JOINTS);
            for scenario in 0..self.size {
                let before = &before[scenario * width..][..width];
                let window = &window[scenario * own * JOINTS..][..own * JOINTS];
                let all = before.iter().chain(window).copied();
                picked.extend(all.skip(first * JOINTS).take(count * JOINTS));
            }
            picked
        };
        let u = |first, count| known(&self.before.u, &self.u, self.samples, first, count);
        let y = |first, count| known(&self.before.y, &self.y, self.context, first, count);
        Some(Self {
            u: u(pre_roll, self.samples),
            y: y(pre_roll, self.context),
            before: Before { samples: pre_roll, u: u(0, pre_roll), y: y(0, pre_roll) },
            ..*self
        })
    }
}

/// Samples `first` to `first + count` of each of `size` series of `length` samples.
fn part(series: &[f32], size: usize, length: usize, first: usize, count: usize) -> Vec<f32> {
    assert_eq!(series.len(), size * length * JOINTS, "[size, pre_roll + samples, 7] values");
    series
        .chunks_exact(length * JOINTS)
        .flat_map(|row| &row[first * JOINTS..(first + count) * JOINTS])
        .copied()
        .collect()
}

/// Several answers to one question, each as likely as the others.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    pub count: usize,
    /// Positions `[count, size, horizon, 7]`, rad.
    pub positions: Vec<f32>,
}

/// One prediction, and samples where they were asked for and there are any.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// Positions `[size, horizon, 7]`, rad.
    pub positions: Vec<f32>,
    pub samples: Option<Samples>,
}

impl Answer {
    /// Of a predictor whose prediction is its first sample. Below two samples there is a prediction
    /// alone.
    pub(crate) fn of_samples(count: usize, positions: Vec<f32>) -> Self {
        if count < 2 {
            return Self { positions, samples: None };
        }
        let first = positions[..positions.len() / count].to_vec();
        Self { positions: first, samples: Some(Samples { count, positions }) }
    }
}

/// Anything that answers how the arm will move.
pub trait Predictor {
    /// How tables and figures call it.
    fn name(&self) -> &str;

    /// Positions of the horizon, `[size, horizon, 7]`, in rad.
    ///
    /// A scenario without an answer has values that are not finite; it is reported as such.
    fn predict(&self, observed: &Observed) -> Result<Vec<f32>, EvaluationError>;

    /// `count` samples of what it holds possible; `None` from a predictor that has one answer only.
    fn sample(
        &self,
        observed: &Observed,
        count: usize,
    ) -> Result<Option<Samples>, EvaluationError> {
        let _ = (observed, count);
        Ok(None)
    }

    /// The prediction, and `count` samples from 2 on.
    fn answer(&self, observed: &Observed, count: usize) -> Result<Answer, EvaluationError> {
        let positions = self.predict(observed)?;
        let samples = if count < 2 { None } else { self.sample(observed, count)? };
        Ok(Answer { positions, samples })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sample k of scenario s has value 100 s + k in y and 1000 more in u.
    fn numbered(size: usize, pre_roll: usize, samples: usize) -> Scenarios {
        let mut y = Vec::new();
        for scenario in 0..size {
            for sample in 0..pre_roll + samples {
                y.extend([(100 * scenario + sample) as f32; JOINTS]);
            }
        }
        let u = y.iter().map(|value| value + 1000.0).collect();
        Scenarios { size, samples, pre_roll, rate_hz: 60.0, u, y }
    }

    fn firsts(series: &[f32]) -> Vec<f32> {
        series.iter().step_by(JOINTS).copied().collect()
    }

    #[test]
    fn the_window_is_what_comes_after_the_pre_roll() {
        let scenarios = numbered(2, 3, 5);
        let observed = scenarios.observed(4);
        assert_eq!(firsts(&observed.y), [3., 4., 5., 6., 103., 104., 105., 106.]);
        assert_eq!(firsts(&observed.u)[..5], [1003., 1004., 1005., 1006., 1007.]);
        assert_eq!(firsts(&scenarios.horizon_positions(4)), [7., 107.]);
    }

    #[test]
    fn an_earlier_window_is_the_one_that_was_asked_then() {
        let scenarios = numbered(2, 3, 5);
        let observed = scenarios.observed(4);
        let earlier = observed.earlier(2).unwrap();
        assert_eq!(firsts(&earlier.y), [1., 2., 3., 4., 101., 102., 103., 104.]);
        assert_eq!(firsts(&earlier.u)[..5], [1001., 1002., 1003., 1004., 1005.]);
        assert_eq!(earlier.pre_roll(), 1);
        assert_eq!(earlier.earlier(1), observed.earlier(3));
        assert_eq!(observed.earlier(0).unwrap(), observed);
        assert_eq!(observed.earlier(4), None);
    }
}
