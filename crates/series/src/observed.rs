use crate::{MeasurementNoise, Shape, Track};

/// The input of a predictor: every torque, and the positions of the context only.
///
/// This type guarantees that no position of the horizon reaches a predictor. It borrows one slice
/// of y per robot, and that slice ends with the context. [`crate::SeriesView::observed`]
/// cuts it there and is the only constructor. A predictor, a model and its normalization get this
/// type and nothing else, so they cannot see more even by mistake. It has no true values either: u
/// and y are the measured ones, with the standard deviation of their noise. The recording before
/// the window, the pre-roll, is known too. Predictors see it as earlier windows, which end earlier.
#[derive(Clone, Debug, PartialEq)]
pub struct Observed<'a> {
    /// Context and horizon.
    pub(crate) samples: usize,
    pub(crate) context: usize,
    pub(crate) pre_roll: usize,
    pub(crate) joints: usize,
    pub(crate) rate_hz: f64,
    pub(crate) noise: MeasurementNoise,
    /// `[pre_roll + samples, joint]` of each robot.
    pub(crate) u: Vec<&'a [f32]>,
    /// `[pre_roll + context, joint]` of each robot.
    pub(crate) y: Vec<&'a [f32]>,
}

impl<'a> Observed<'a> {
    /// Samples of the window: context and horizon.
    pub fn shape(&self) -> Shape {
        Shape { robots: self.robots(), samples: self.samples, joints: self.joints }
    }

    /// Number of robots; each is predicted on its own.
    pub fn robots(&self) -> usize {
        self.u.len()
    }

    /// Context and horizon.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Samples whose positions are known.
    pub fn context(&self) -> usize {
        self.context
    }

    /// Samples whose positions a predictor predicts.
    pub fn horizon(&self) -> usize {
        self.samples - self.context
    }

    /// Recorded samples before the window.
    pub fn pre_roll(&self) -> usize {
        self.pre_roll
    }

    /// Joints of each robot.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Samples per second, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Noise of the positions, and of the torques of the context.
    pub fn noise(&self) -> MeasurementNoise {
        self.noise
    }

    /// Torques of one robot over context and horizon, N·m.
    pub fn u(&self, robot: usize) -> Track<'a> {
        self.after_pre_roll(self.u[robot])
    }

    /// Positions of one robot over the context, rad.
    pub fn y(&self, robot: usize) -> Track<'a> {
        self.after_pre_roll(self.y[robot])
    }

    fn after_pre_roll(&self, row: &'a [f32]) -> Track<'a> {
        Track::new(&row[self.pre_roll * self.joints..], self.joints)
    }

    /// The robots with these indices, in this order. An index may occur more than once.
    ///
    /// # Panics
    /// If there is no such robot.
    #[must_use]
    pub fn pick(&self, robots: &[usize]) -> Self {
        let pick = |rows: &[&'a [f32]]| robots.iter().map(|&robot| rows[robot]).collect();
        Self { u: pick(&self.u), y: pick(&self.y), ..*self }
    }

    /// The window of the same length `shift` samples ago, as a predictor would have seen it then.
    /// All that it knows is known here, since its context ends `shift` samples earlier. `None` if
    /// the recording begins later.
    pub fn earlier(&self, shift: usize) -> Option<Self> {
        let pre_roll = self.pre_roll.checked_sub(shift)?;
        let shorter = |rows: &[&'a [f32]]| {
            rows.iter().map(|row| &row[..row.len() - shift * self.joints]).collect()
        };
        Some(Self { pre_roll, u: shorter(&self.u), y: shorter(&self.y), ..*self })
    }
}
