use std::ops::Range;

use crate::{Columns, MeasurementNoise, Observed, SeriesView, Shape, ShapeError};

/// Torques and positions of robots that all have the same samples, joints and rate.
///
/// y may be known for fewer samples than u, from the first sample on. A question to a predictor has
/// the torques of its horizon and no positions there.
///
/// ```
/// use series::{Series, Shape};
///
/// // One robot with two joints at 60 Hz. A predictor may know the positions of two of its samples.
/// let shape = Shape { robots: 1, samples: 3, joints: 2 };
/// let u = vec![1.0, 0.0, 1.0, 0.0, 0.5, 0.0];
/// let y = vec![0.0, 0.3, 0.1, 0.3, 0.2, 0.3];
/// let series = Series::new(shape, 60.0, u, y)?;
///
/// let observed = series.observed(2);
/// assert_eq!((observed.context(), observed.horizon()), (2, 1));
/// assert_eq!(observed.u(0)[2], [0.5, 0.0]);
/// assert_eq!(observed.y(0).samples(), 2);
/// assert_eq!(observed.y(0)[1], [0.1, 0.3]);
/// # Ok::<(), series::ShapeError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    shape: Shape,
    /// Samples of y.
    known: usize,
    rate_hz: f64,
    u: Vec<f32>,
    y: Vec<f32>,
    noise: MeasurementNoise,
    /// The true values behind u and y; `None` where only u and y are known.
    truth: Option<Truth>,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Truth {
    u: Vec<f32>,
    y: Vec<f32>,
}

impl Series {
    /// Recorded trajectories. `u` and `y` are both `[robot, sample, joint]`.
    ///
    /// # Errors
    /// The number of values is not that of the shape.
    pub fn new(shape: Shape, rate_hz: f64, u: Vec<f32>, y: Vec<f32>) -> Result<Self, ShapeError> {
        Self::question(shape, shape.samples, rate_hz, u, y)
    }

    /// A question: `u` has all samples, and `y` the first `known` samples of each robot.
    ///
    /// # Errors
    /// Those of [`Series::new`].
    pub fn question(
        shape: Shape,
        known: usize,
        rate_hz: f64,
        u: Vec<f32>,
        y: Vec<f32>,
    ) -> Result<Self, ShapeError> {
        shape.check("u", u.len())?;
        Shape { samples: known, ..shape }.check("y", y.len())?;
        let noise = MeasurementNoise::default();
        Ok(Self { shape, known, rate_hz, u, y, noise, truth: None })
    }

    /// The same values with `noise` as their measurement noise.
    #[must_use]
    pub fn with_noise(self, noise: MeasurementNoise) -> Self {
        Self { noise, ..self }
    }

    /// A series without robots, with memory for those of `shape`.
    ///
    /// # Errors
    /// [`ShapeError::TooLarge`].
    pub fn with_capacity(shape: Shape, rate_hz: f64) -> Result<Self, ShapeError> {
        let values = shape.values()?;
        Ok(Self {
            shape: Shape { robots: 0, ..shape },
            known: shape.samples,
            rate_hz,
            u: Vec::with_capacity(values),
            y: Vec::with_capacity(values),
            noise: MeasurementNoise::default(),
            truth: None,
        })
    }

    /// Appends robots of `columns`. This is the only copy between a decoded row group and a batch.
    ///
    /// # Panics
    /// If samples or joints differ, or there are no such robots.
    pub fn gather(&mut self, columns: &Columns<'_>, robots: Range<usize>) {
        let Shape { samples, joints, .. } = self.shape;
        assert_eq!((columns.samples(), columns.joints()), (samples, joints), "samples and joints");
        columns.append(robots.clone(), &mut self.u, &mut self.y);
        if columns.has_truth() {
            let Truth { u, y } = self.truth.get_or_insert_default();
            columns.append_truth(robots.clone(), u, y);
        }
        self.shape.robots += robots.len();
    }

    /// Appends the robots of `other`. The noise stays that of the robots before.
    ///
    /// # Panics
    /// If samples, known samples or joints differ.
    pub fn append(&mut self, other: &Self) {
        let shape = |series: &Self| Shape { robots: 0, ..series.shape };
        assert_eq!((shape(self), self.known), (shape(other), other.known), "samples and joints");
        if self.truth.is_some() || other.truth.is_some() {
            let Self { u, y, truth, .. } = self;
            let truth = truth.get_or_insert_with(|| Truth { u: u.clone(), y: y.clone() });
            truth.u.extend_from_slice(other.true_u());
            truth.y.extend_from_slice(other.true_y());
        }
        self.u.extend_from_slice(&other.u);
        self.y.extend_from_slice(&other.y);
        self.shape.robots += other.shape.robots;
    }

    /// Changes the shape and keeps the memory. The caller overwrites the values.
    ///
    /// # Errors
    /// [`ShapeError::TooLarge`].
    pub fn reshape(&mut self, shape: Shape, rate_hz: f64) -> Result<(), ShapeError> {
        let values = shape.values()?;
        for series in [&mut self.u, &mut self.y] {
            if series.capacity() < values {
                // The allocator gives zeros, which cost nothing if the system provides zeroed
                // pages.
                *series = vec![0.0; values];
            } else {
                series.resize(values, 0.0);
            }
        }
        (self.shape, self.known, self.rate_hz) = (shape, shape.samples, rate_hz);
        (self.noise, self.truth) = (MeasurementNoise::default(), None);
        Ok(())
    }

    /// u and y, for a caller that adds `noise` to them. Their values before the first call are kept
    /// as the true ones.
    pub fn add_noise(&mut self, noise: MeasurementNoise) -> (&mut [f32], &mut [f32]) {
        let Self { u, y, truth, .. } = self;
        truth.get_or_insert_with(|| Truth { u: u.clone(), y: y.clone() });
        self.noise = self.noise.and(noise);
        (u, y)
    }

    /// Puts another series, such as references, in the place of the torques, measured and true.
    ///
    /// # Panics
    /// If it has another length.
    pub fn replace_u(&mut self, values: &[f32]) {
        self.u.copy_from_slice(values);
        if let Some(truth) = &mut self.truth {
            truth.u.copy_from_slice(values);
        }
    }

    /// Marks the torques from `sample` on as planned and not measured. They become the true ones.
    ///
    /// # Panics
    /// If there are fewer samples.
    pub fn plan_from(&mut self, sample: usize) {
        let Some(truth) = &self.truth else { return };
        let row = self.shape.samples * self.shape.joints;
        if row == 0 {
            return;
        }
        let planned = sample * self.shape.joints..row;
        for (u, true_u) in self.u.chunks_exact_mut(row).zip(truth.u.chunks_exact(row)) {
            u[planned.clone()].copy_from_slice(&true_u[planned.clone()]);
        }
    }

    /// The lengths of the dimensions of [`Series::u`]; those of [`Series::y`] have known samples only.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// Number of robots.
    pub fn robots(&self) -> usize {
        self.shape.robots
    }

    /// Samples of each robot.
    pub fn samples(&self) -> usize {
        self.shape.samples
    }

    /// Joints of each robot.
    pub fn joints(&self) -> usize {
        self.shape.joints
    }

    /// Samples whose positions are known.
    pub fn known(&self) -> usize {
        self.known
    }

    /// Samples per second, Hz.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Noise of positions and torques.
    pub fn noise(&self) -> MeasurementNoise {
        self.noise
    }

    /// True torques, in the form of [`Series::u`]. They are the measured ones where no others are
    /// known.
    pub fn true_u(&self) -> &[f32] {
        self.truth.as_ref().map_or(&self.u, |truth| &truth.u)
    }

    /// True positions, in the form of [`Series::y`]. They are the measured ones where no others are
    /// known.
    pub fn true_y(&self) -> &[f32] {
        self.truth.as_ref().map_or(&self.y, |truth| &truth.y)
    }

    /// Torques `[robot, sample, joint]`, N·m.
    pub fn u(&self) -> &[f32] {
        &self.u
    }

    /// Positions `[robot, sample, joint]`, rad, of the known samples.
    pub fn y(&self) -> &[f32] {
        &self.y
    }

    /// [`Series::u`], for writing.
    pub fn u_mut(&mut self) -> &mut [f32] {
        &mut self.u
    }

    /// [`Series::y`], for writing.
    pub fn y_mut(&mut self) -> &mut [f32] {
        &mut self.y
    }

    /// u and y for writing both.
    pub fn both_mut(&mut self) -> (&mut [f32], &mut [f32]) {
        (&mut self.u, &mut self.y)
    }

    /// All robots and samples.
    pub fn view(&self) -> SeriesView<'_> {
        self.part(0..self.shape.robots)
    }

    /// Copies consecutive robots.
    ///
    /// # Panics
    /// If there are no such robots.
    #[must_use]
    pub fn copy(&self, robots: Range<usize>) -> Self {
        let row = self.shape.samples * self.shape.joints;
        let known = self.known * self.shape.joints;
        let cut =
            |values: &[f32], row: usize| values[robots.start * row..robots.end * row].to_vec();
        let truth = self.truth.as_ref();
        Self {
            shape: Shape { robots: robots.len(), ..self.shape },
            u: cut(&self.u, row),
            y: cut(&self.y, known),
            truth: truth.map(|truth| Truth { u: cut(&truth.u, row), y: cut(&truth.y, known) }),
            ..*self
        }
    }

    /// A view of consecutive robots.
    ///
    /// # Panics
    /// If there are no such robots.
    pub fn part(&self, robots: Range<usize>) -> SeriesView<'_> {
        let Self { shape, known, rate_hz, noise, .. } = *self;
        let rows = |values, samples| robots.clone().map(move |robot| row(values, robot, samples));
        let joints = shape.joints;
        SeriesView {
            samples: shape.samples,
            known,
            joints,
            rate_hz,
            noise,
            u: rows(&self.u[..], shape.samples * joints).collect(),
            y: rows(&self.y[..], known * joints).collect(),
            true_y: rows(self.true_y(), known * joints).collect(),
        }
    }

    /// Like [`SeriesView::observed`], without a pre-roll.
    ///
    /// # Panics
    /// Like [`SeriesView::observed`].
    pub fn observed(&self, context: usize) -> Observed<'_> {
        self.view().observed(0, context)
    }
}

fn row(values: &[f32], robot: usize, width: usize) -> &[f32] {
    &values[robot * width..][..width]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: Shape = Shape { robots: 3, samples: 5, joints: 2 };

    /// 1000 robot + 10 sample + joint in u, and 0.5 more in y.
    fn numbered() -> Series {
        let value = |k: usize| (1000 * (k / 10) + 10 * (k / 2 % 5) + k % 2) as f32;
        let u: Vec<f32> = (0..30).map(value).collect();
        let y = u.iter().map(|value| value + 0.5).collect();
        Series::new(SHAPE, 60.0, u, y).unwrap()
    }

    /// The columns of a table with `series`.
    fn columns(values: &[f32]) -> Vec<Vec<f32>> {
        (0..2).map(|joint| values.iter().skip(joint).step_by(2).copied().collect()).collect()
    }

    fn slices(columns: &[Vec<f32>]) -> Vec<&[f32]> {
        columns.iter().map(Vec::as_slice).collect()
    }

    #[test]
    fn robots_are_gathered_from_columns_in_any_order() {
        let series = numbered();
        let (u, y) = (columns(series.u()), columns(series.y()));
        let columns = Columns::new(5, slices(&u), slices(&y)).unwrap();
        let mut gathered = Series::with_capacity(SHAPE, 60.0).unwrap();
        gathered.gather(&columns, 2..3);
        gathered.gather(&columns, 0..2);
        assert_eq!(gathered.shape(), SHAPE);
        for (place, robot) in [2, 0, 1].into_iter().enumerate() {
            assert_eq!(gathered.view().u(place), series.view().u(robot));
            assert_eq!(gathered.view().y(place), series.view().y(robot));
        }
    }

    #[test]
    fn values_of_another_number_are_refused() {
        let error = Series::new(SHAPE, 60.0, vec![0.0; 30], vec![0.0; 29]).unwrap_err();
        let expected = "y has 29 values, expected 30 for 3 robots of 5 samples of 2 joints";
        assert_eq!(error.to_string(), expected);
        assert!(Series::question(SHAPE, 4, 60.0, vec![0.0; 30], vec![0.0; 24]).is_ok());
        let column = [0.0; 10];
        let short = Columns::new(5, vec![&column, &column], vec![&column, &column[1..]]);
        assert!(matches!(short, Err(ShapeError::Rows { name: "y", column: 1, actual: 9, .. })));
        let missing = Columns::new(5, vec![&column, &column], vec![&column]);
        assert!(matches!(missing, Err(ShapeError::Columns { name: "y", actual: 1, joints: 2 })));
        let whole = Columns::new(0, vec![&column], vec![&column]);
        assert!(matches!(whole, Err(ShapeError::Rows { name: "u", .. })));
    }

    #[test]
    fn a_view_has_the_values_of_its_robots_and_samples() {
        let series = numbered();
        let view = series.part(1..3).window(2..4);
        assert_eq!((view.robots(), view.samples(), view.joints()), (2, 2, 2));
        assert_eq!(view.u(1).values(), [2020.0, 2021.0, 2030.0, 2031.0]);
        assert_eq!(view.y(0)[1][1], 1031.5);
        assert_eq!(view.y(0).joint(0).collect::<Vec<_>>(), [1020.5, 1030.5]);
    }

    #[test]
    fn what_is_observed_ends_with_the_context() {
        let series = numbered();
        let observed = series.view().observed(1, 2);
        assert_eq!((observed.robots(), observed.samples(), observed.horizon()), (3, 4, 2));
        assert_eq!(observed.u(0).joint(0).collect::<Vec<_>>(), [10.0, 20.0, 30.0, 40.0]);
        assert_eq!(observed.y(2).joint(1).collect::<Vec<_>>(), [2011.5, 2021.5]);
        let picked = observed.pick(&[2, 0, 2]);
        assert_eq!(picked.y(0), observed.y(2));
        assert_eq!(picked.u(1), observed.u(0));
        assert_eq!(picked.y(2), observed.y(2));
    }

    #[test]
    fn an_earlier_window_is_the_one_that_was_asked_then() {
        let series = numbered();
        let observed = series.view().observed(2, 2);
        let earlier = observed.earlier(1).unwrap();
        assert_eq!(earlier, series.view().window(0..4).observed(1, 2));
        assert_eq!(earlier.pre_roll(), 1);
        assert_eq!(earlier.earlier(1), observed.earlier(2));
        assert_eq!(observed.earlier(0).unwrap(), observed);
        assert_eq!(observed.earlier(3), None);
    }

    #[test]
    #[should_panic(expected = "y is known for 4 samples")]
    fn a_question_cannot_be_cut_where_it_knows_nothing() {
        let question = Series::question(SHAPE, 4, 60.0, vec![0.0; 30], vec![0.0; 24]).unwrap();
        let _ = question.observed(5);
    }
}
