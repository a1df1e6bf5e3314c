//! The frame in which a model sees positions, and the way from its answers back to positions.

use burn::tensor::Tensor;
use rayon::prelude::*;
use series::{Observed, Track};
use spec::Residual;

use crate::architecture::ModelInput;
use crate::lag::LaggedPath;
use crate::normalization::{SMALLEST_STANDARD_DEVIATION, Statistics};

/// The frame of one trajectory: y = center + scale · the model's value. It follows from the torques
/// and from the positions of the context, never from the positions of the horizon.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Frame {
    /// `[sample, joint]`, context and horizon, rad.
    center: Vec<f32>,
    /// `[sample, joint]`, context and horizon, rad.
    scale: Vec<f32>,
    joints: usize,
}

/// The settings that all frames share.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Framing {
    pub residual: Residual,
    pub samples: usize,
    pub context: usize,
    pub rate_hz: f64,
}

impl Framing {
    /// The frame of every observed trajectory.
    pub fn frames(&self, observed: &Observed<'_>, statistics: &[Statistics]) -> Vec<Frame> {
        let frame = |(robot, statistics): (usize, &Statistics)| match self.residual {
            Residual::None => Frame {
                center: statistics.y_mean.repeat(self.samples),
                scale: statistics.y_std.repeat(self.samples),
                joints: statistics.y_std.len(),
            },
            Residual::Integrator(integrator) => {
                self.integrated(observed.u(robot), observed.y(robot), integrator.damping)
            }
            Residual::LaggedIntegrator(integrator) => {
                self.lagged(observed.u(robot), observed.y(robot), integrator.damping)
            }
            Residual::Reference => self.referred(observed.u(robot), observed.y(robot)),
        };
        statistics.par_iter().enumerate().map(frame).collect()
    }

    /// The center is the reference, shifted to the last position of the context.
    fn referred(&self, reference: Track<'_>, y: Track<'_>) -> Frame {
        let last = self.context - 1;
        let joints = y.joints();
        let mut center = reference.values().to_vec();
        for (place, value) in center.iter_mut().enumerate() {
            let joint = place % joints;
            *value = y[last][joint] + (*value - reference[last][joint]);
        }
        self.scaled(center, y)
    }

    /// The center is the damped integrator through the last sample of the context, forwards and
    /// backwards.
    #[expect(clippy::cast_possible_truncation, reason = "series are computed in f32")]
    fn integrated(&self, u: Track<'_>, y: Track<'_>, damping: f64) -> Frame {
        let last = self.context - 1;
        let gain = 1.0 / (damping * self.rate_hz);
        let joints = u.joints();
        let mut center = vec![0.0; u.values().len()];
        for joint in 0..joints {
            let at = |sample: usize| sample * joints + joint;
            let start = f64::from(y[last][joint]);
            center[at(last)] = start as f32;
            // y of a sample is the position before the sample's u acts.
            let mut position = start;
            for sample in last + 1..self.samples {
                position += gain * f64::from(u[sample - 1][joint]);
                center[at(sample)] = position as f32;
            }
            let mut position = start;
            for sample in (0..last).rev() {
                position -= gain * f64::from(u[sample][joint]);
                center[at(sample)] = position as f32;
            }
        }
        self.scaled(center, y)
    }

    /// The frame of a path. The scale is the path's error over as many samples of the context as the
    /// horizon has, because that is the best estimate of its error over the horizon.
    #[expect(clippy::cast_possible_truncation, reason = "series are computed in f32")]
    fn scaled(&self, center: Vec<f32>, y: Track<'_>) -> Frame {
        let (last, joints) = (self.context - 1, y.joints());
        let mut scale = vec![0.0; center.len()];
        for joint in 0..joints {
            let seen = last.saturating_sub(self.samples - self.context)..last;
            let count = seen.len().max(1) as f64;
            let error = |sample: usize| y[sample][joint] - center[sample * joints + joint];
            let squares: f64 = seen.map(|sample| f64::from(error(sample)).powi(2)).sum();
            let of_joint = ((squares / count).sqrt() as f32).max(SMALLEST_STANDARD_DEVIATION);
            scale.iter_mut().skip(joint).step_by(joints).for_each(|scale| *scale = of_joint);
        }
        Frame { center, scale, joints }
    }

    /// The frame of [`Framing::integrated`] over the context. Over the horizon, the center is the
    /// lagged path, and the scale of sample k is the path's error after k samples in the context.
    #[expect(clippy::cast_possible_truncation, reason = "series are computed in f32")]
    fn lagged(&self, u: Track<'_>, y: Track<'_>, damping: f64) -> Frame {
        let mut frame = self.integrated(u, y, damping);
        let joints = u.joints();
        for joint in 0..joints {
            let path = LaggedPath::fit(u, y, joint, damping, self.rate_hz);
            let ahead = path.ahead(self.samples - self.context);
            let at = (self.context * joints + joint..).step_by(joints);
            for (at, (position, error)) in at.zip(ahead) {
                frame.center[at] = position as f32;
                frame.scale[at] = error as f32;
            }
        }
        frame
    }
}

impl Frame {
    /// The positions for which the answer is 0, `[sample, joint]`, context and horizon, rad.
    pub fn center(&self) -> &[f32] {
        &self.center
    }

    /// The unit of answers, `[sample, joint]`, context and horizon, rad.
    pub fn scale(&self) -> &[f32] {
        &self.scale
    }

    /// Appends `y` `[sample, joint]` in this frame to `seen`. The first row of `y` is sample
    /// `first`.
    pub fn extend_seen(&self, y: &[f32], first: usize, seen: &mut Vec<f32>) {
        let (center, scales) = self.from(first);
        seen.extend(
            y.iter()
                .zip(center)
                .zip(scales)
                .map(|((value, center), scale)| (value - center) / scale),
        );
    }

    /// Center and scale of the samples from `first` on.
    fn from(&self, first: usize) -> (&[f32], &[f32]) {
        let values = first * self.joints..;
        (&self.center[values.clone()], &self.scale[values])
    }

    /// Turns a model's answers for the samples from `first` on into rad.
    pub fn restore(&self, y: &mut [f32], first: usize) {
        let (center, scales) = self.from(first);
        for ((value, center), scale) in y.iter_mut().zip(center).zip(scales) {
            *value = *value * scale + center;
        }
    }
}

/// Factor for the logarithms of units, which lie between about -10 and 0.
const PER_LOGARITHM: f64 = 0.25;

/// The known series of a network, over context and horizon.
///
/// Answers relative to a path contain neither the arm's pose, on which its inertia depends, nor the
/// size of their unit. The path and the unit give both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum KnownInputs {
    /// Normalized torques, or references in their place.
    Torques,
    /// These, the path as normalized positions, and a quarter of the logarithm of the unit in them.
    TorquesPathAndUnit,
}

impl KnownInputs {
    /// The known series for a model whose answers are relative to `residual`.
    pub fn of(residual: Residual) -> Self {
        match residual {
            Residual::None => Self::Torques,
            Residual::Integrator(_) | Residual::LaggedIntegrator(_) | Residual::Reference => {
                Self::TorquesPathAndUnit
            }
        }
    }

    /// Channels for an arm of `joints` joints. The torques come first.
    pub const fn channels(self, joints: usize) -> usize {
        match self {
            Self::Torques => joints,
            Self::TorquesPathAndUnit => 3 * joints,
        }
    }

    /// The known series `[batch, sample, channel]`.
    pub fn series(self, input: &ModelInput) -> Tensor<3> {
        match self {
            Self::Torques => input.u.clone(),
            Self::TorquesPathAndUnit => {
                let unit = input.unit.clone().log() * PER_LOGARITHM;
                Tensor::cat(vec![input.u.clone(), input.path.clone(), unit], 2)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use series::{Series, Shape};
    use spec::{DampedIntegrator, Residual};

    use super::Framing;
    use crate::normalization::Statistics;

    const JOINTS: usize = 3;

    const FRAMING: Framing = Framing {
        residual: Residual::Integrator(DampedIntegrator { damping: 10.0 }),
        samples: 12,
        context: 8,
        rate_hz: 60.0,
    };

    fn statistics() -> Statistics {
        Statistics {
            u_mean: vec![0.0; JOINTS],
            u_std: vec![1.0; JOINTS],
            y_mean: vec![0.1; JOINTS],
            y_std: vec![2.0; JOINTS],
        }
    }

    /// An arm that obeys q̇ = u / D exactly.
    fn arm(damping: f32) -> Series {
        let u: Vec<f32> = (0..12 * JOINTS).map(|i| (i as f32 * 0.7).sin() * 5.0).collect();
        let mut y = vec![0.3; 12 * JOINTS];
        for i in JOINTS..y.len() {
            y[i] = y[i - JOINTS] + u[i - JOINTS] / damping / 60.0;
        }
        Series::new(Shape { robots: 1, samples: 12, joints: JOINTS }, 60.0, u, y).unwrap()
    }

    #[test]
    fn the_path_of_a_reference_goes_through_the_last_position() {
        let shape = Shape { robots: 1, samples: 12, joints: JOINTS };
        let reference: Vec<f32> = (0..36_u8).map(|k| (0.3 * f32::from(k)).sin()).collect();
        // The arm is 0.1 rad off its reference, and in the last four samples of the context 0.2 rad.
        let off = |place: usize| if place / JOINTS < 4 { 0.1 } else { 0.2 };
        let y = reference.iter().enumerate().map(|(place, r)| r - off(place)).collect();
        let series = Series::new(shape, 60.0, reference.clone(), y).unwrap();
        let framing = Framing { residual: Residual::Reference, ..FRAMING };
        let observed = series.observed(8);
        let frames = framing.frames(&observed, &[Statistics::identity(JOINTS)]);
        for (center, r) in frames[0].center().iter().zip(&reference) {
            assert!((center - (r - 0.2)).abs() < 1e-6);
        }
        // One of the four samples before the last one is 0.1 rad off this path.
        assert!(
            frames[0].scale().iter().all(|scale| (scale - 0.05).abs() < 1e-6),
            "{:?}",
            frames[0].scale()
        );
    }

    #[test]
    fn an_arm_that_is_the_integrator_leaves_nothing_over() {
        let arm = arm(10.0);
        let frames = FRAMING.frames(&arm.observed(8), &[statistics()]);
        let mut seen = Vec::new();
        frames[0].extend_seen(arm.y(), 0, &mut seen);
        // The smallest scale is a thousandth of a radian.
        assert!(seen.iter().all(|value| value.abs() < 1e-3), "{seen:?}");
    }

    #[test]
    fn another_damping_is_left_over_in_the_scale_of_the_context() {
        let arm = arm(5.0);
        let frames = FRAMING.frames(&arm.observed(8), &[statistics()]);
        let mut seen = Vec::new();
        frames[0].extend_seen(&arm.y()[8 * JOINTS..], 8, &mut seen);
        let largest = seen.iter().fold(0.0_f32, |a, b| a.max(b.abs()));
        assert!((0.1..20.0).contains(&largest), "{largest}");
    }

    #[test]
    fn what_a_model_sees_becomes_the_position_again() {
        let arm = arm(7.0);
        let y = &arm.y()[8 * JOINTS..];
        let lagged = Residual::LaggedIntegrator(DampedIntegrator { damping: 10.0 });
        for residual in [FRAMING.residual, lagged, Residual::None] {
            let frames = Framing { residual, ..FRAMING }.frames(&arm.observed(8), &[statistics()]);
            let mut seen = Vec::new();
            frames[0].extend_seen(y, 8, &mut seen);
            frames[0].restore(&mut seen, 8);
            let close = seen.iter().zip(y).all(|(a, b)| (a - b).abs() < 1e-6);
            assert!(close, "{residual:?}");
        }
    }
}
