use std::fmt;

use thiserror::Error;

/// Number of robots, samples of each robot, and joints of each robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shape {
    /// Number of robots; 0 for an empty series.
    pub robots: usize,
    /// Samples of each robot.
    pub samples: usize,
    /// Joints of each robot.
    pub joints: usize,
}

/// The reason why values are no series. `name` says which values: u, y, or the true ones.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are the words of the message")]
pub enum ShapeError {
    /// Values in one slice, whose number does not fit the shape.
    #[error("{name} has {actual} values, expected {expected} for {shape}")]
    Values { name: &'static str, actual: usize, expected: usize, shape: Shape },

    /// Columns, of which there must be one for each joint.
    #[error("{name} has {actual} columns, expected one for each of {joints} joints")]
    Columns { name: &'static str, actual: usize, joints: usize },

    /// A column with a part of a robot: its rows are no multiple of the samples of a robot.
    #[error("column {column} of {name} has {actual} rows, expected a multiple of {samples}")]
    Rows { name: &'static str, column: usize, actual: usize, samples: usize },

    /// More values than a `usize` can count.
    #[error("{shape} do not fit into memory")]
    TooLarge { shape: Shape },
}

impl Shape {
    /// Number of values of u of one robot, and of y.
    pub fn values_per_robot(self) -> usize {
        self.samples * self.joints
    }

    /// Number of values of u, and of y.
    ///
    /// # Errors
    /// [`ShapeError::TooLarge`] if a `usize` cannot count them.
    pub fn values(self) -> Result<usize, ShapeError> {
        let values = self.robots.checked_mul(self.samples);
        let values = values.and_then(|values| values.checked_mul(self.joints));
        values.ok_or(ShapeError::TooLarge { shape: self })
    }

    /// Checks that `actual` is the number of values of this shape.
    pub(crate) fn check(self, name: &'static str, actual: usize) -> Result<(), ShapeError> {
        let expected = self.values()?;
        if actual == expected {
            return Ok(());
        }
        Err(ShapeError::Values { name, actual, expected, shape: self })
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { robots, samples, joints } = self;
        write!(f, "{robots} robots of {samples} samples of {joints} joints")
    }
}
