use std::ops::Range;

use crate::{MeasurementNoise, Observed, Shape, Track};

/// Some robots and some samples of a [`crate::Series`]: a slice of each robot, without copies.
#[derive(Clone, Debug, PartialEq)]
pub struct SeriesView<'a> {
    pub(crate) samples: usize,
    /// Samples of y.
    pub(crate) known: usize,
    pub(crate) joints: usize,
    pub(crate) rate_hz: f64,
    pub(crate) noise: MeasurementNoise,
    /// `[sample, joint]` of each robot.
    pub(crate) u: Vec<&'a [f32]>,
    pub(crate) y: Vec<&'a [f32]>,
    /// True positions. They are those of `y` where no others are known.
    pub(crate) true_y: Vec<&'a [f32]>,
}

impl<'a> SeriesView<'a> {
    /// The number of robots, their samples and their joints.
    pub fn shape(&self) -> Shape {
        Shape { robots: self.robots(), samples: self.samples, joints: self.joints }
    }

    /// Number of robots in the view.
    pub fn robots(&self) -> usize {
        self.u.len()
    }

    /// Samples of each robot.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Number of samples whose y is known. They come first. In a recording, all are known.
    pub fn known(&self) -> usize {
        self.known
    }

    /// Joints of each robot.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Samples per second, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Noise of positions and torques.
    pub fn noise(&self) -> MeasurementNoise {
        self.noise
    }

    /// Torques of one robot, N·m.
    pub fn u(&self, robot: usize) -> Track<'a> {
        Track::new(self.u[robot], self.joints)
    }

    /// Known positions of one robot as they were measured, rad.
    pub fn y(&self, robot: usize) -> Track<'a> {
        Track::new(self.y[robot], self.joints)
    }

    /// Known positions of one robot without noise, rad, for scores and losses. They are the
    /// measured ones where no others are known, as in recordings.
    pub fn true_y(&self, robot: usize) -> Track<'a> {
        Track::new(self.true_y[robot], self.joints)
    }

    /// A view of consecutive robots.
    ///
    /// # Panics
    /// If there are no such robots.
    #[must_use]
    pub fn part(&self, robots: Range<usize>) -> Self {
        let part = |rows: &[&'a [f32]]| rows[robots.clone()].to_vec();
        Self { u: part(&self.u), y: part(&self.y), true_y: part(&self.true_y), ..*self }
    }

    /// The same robots over `samples` only.
    ///
    /// # Panics
    /// If there are no such samples.
    #[must_use]
    pub fn window(&self, samples: Range<usize>) -> Self {
        let Self { joints, rate_hz, noise, .. } = *self;
        let known = samples.start.min(self.known)..samples.end.min(self.known);
        let cut = |rows: &[&'a [f32]], samples: &Range<usize>| {
            rows.iter().map(|row| &row[samples.start * joints..samples.end * joints]).collect()
        };
        Self {
            samples: samples.len(),
            known: known.len(),
            joints,
            rate_hz,
            noise,
            u: cut(&self.u, &samples),
            y: cut(&self.y, &known),
            true_y: cut(&self.true_y, &known),
        }
    }

    /// Copies the known positions of all robots without noise, `[robot, sample, joint]`, rad.
    pub fn copy_true_y(&self) -> Vec<f32> {
        self.true_y.concat()
    }

    /// The data that a predictor may see in the window after `pre_roll` samples: all torques, and
    /// the positions of the first `context` samples. This is the only way to make an [`Observed`].
    ///
    /// # Panics
    /// If y is known for fewer samples, or the context is longer than the window.
    pub fn observed(&self, pre_roll: usize, context: usize) -> Observed<'a> {
        let Self { samples, known, joints, rate_hz, noise, .. } = *self;
        let end = pre_roll + context;
        assert!(end <= known && known <= samples, "y is known for {known} samples, not for {end}");
        Observed {
            samples: samples - pre_roll,
            context,
            pre_roll,
            joints,
            rate_hz,
            noise,
            u: self.u.clone(),
            y: self.y.iter().map(|row| &row[..end * joints]).collect(),
        }
    }
}
