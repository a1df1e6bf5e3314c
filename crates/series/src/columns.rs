use std::ops::Range;

use crate::ShapeError;

/// Columns of a table, one per joint, with the samples of one robot after another. This is how
/// Parquet stores a series.
#[derive(Clone, Debug)]
pub struct Columns<'a> {
    samples: usize,
    u: Vec<&'a [f32]>,
    y: Vec<&'a [f32]>,
    /// True u and y, if the columns above are measured.
    truth: Option<[Vec<&'a [f32]>; 2]>,
}

impl<'a> Columns<'a> {
    /// `u` and `y` have a column per joint. All columns have the same whole number of robots.
    ///
    /// # Errors
    /// The number of columns is not that of the joints, or a column has another length.
    pub fn new(samples: usize, u: Vec<&'a [f32]>, y: Vec<&'a [f32]>) -> Result<Self, ShapeError> {
        let (joints, rows) = (u.len(), u.first().map_or(0, |column| column.len()));
        if y.len() != joints {
            return Err(ShapeError::Columns { name: "y", actual: y.len(), joints });
        }
        for (name, columns) in [("u", &u), ("y", &y)] {
            let is_whole = |column: &&[f32]| {
                column.len() == rows && column.len().checked_rem(samples) == Some(0)
            };
            if let Some(column) = columns.iter().position(|column| !is_whole(column)) {
                let actual = columns[column].len();
                return Err(ShapeError::Rows { name, column, actual, samples });
            }
        }
        Ok(Self { samples, u, y, truth: None })
    }

    /// Adds the true values behind the measured ones, in columns of the same form.
    ///
    /// # Errors
    /// Those of [`Columns::new`].
    pub fn with_truth(mut self, u: Vec<&'a [f32]>, y: Vec<&'a [f32]>) -> Result<Self, ShapeError> {
        let truth = Self::new(self.samples, u, y)?;
        if truth.robots() != self.robots() || truth.joints() != self.joints() {
            let (actual, joints) = (truth.joints(), self.joints());
            return Err(ShapeError::Columns { name: "true y", actual, joints });
        }
        self.truth = Some([truth.u, truth.y]);
        Ok(self)
    }

    /// Number of robots: the rows of a column, divided by the samples of a robot.
    pub fn robots(&self) -> usize {
        self.u.first().map_or(0, |column| column.len() / self.samples)
    }

    /// Samples of each robot.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Joints of each robot, one column of u and one of y for each.
    pub fn joints(&self) -> usize {
        self.u.len()
    }

    /// Appends u and y of the given robots, each `[robot, sample, joint]`.
    pub(crate) fn append(&self, robots: Range<usize>, u: &mut Vec<f32>, y: &mut Vec<f32>) {
        let rows = self.rows(robots);
        interleave(&self.u, rows.clone(), u);
        interleave(&self.y, rows, y);
    }

    pub(crate) fn has_truth(&self) -> bool {
        self.truth.is_some()
    }

    /// Like [`Columns::append`], with the true values. Appends nothing where there are none.
    pub(crate) fn append_truth(&self, robots: Range<usize>, u: &mut Vec<f32>, y: &mut Vec<f32>) {
        let Some([true_u, true_y]) = &self.truth else { return };
        let rows = self.rows(robots);
        interleave(true_u, rows.clone(), u);
        interleave(true_y, rows, y);
    }

    fn rows(&self, robots: Range<usize>) -> Range<usize> {
        robots.start * self.samples..robots.end * self.samples
    }
}

/// Appends `rows` of the columns, one row after another.
fn interleave(columns: &[&[f32]], rows: Range<usize>, values: &mut Vec<f32>) {
    /// Rows per block. Passes of each column over all rows would not stay in the cache.
    const BLOCK: usize = 512;
    let joints = columns.len();
    let start = values.len();
    values.resize(start + rows.len() * joints, 0.0);
    for (block, values) in values[start..].chunks_mut(BLOCK * joints.max(1)).enumerate() {
        let first = rows.start + block * BLOCK;
        for (joint, column) in columns.iter().enumerate() {
            let values = values[joint..].iter_mut().step_by(joints);
            for (value, source) in values.zip(&column[first..]) {
                *value = *source;
            }
        }
    }
}
