use std::fmt;

use thiserror::Error;

/// How many robots, samples of each, and joints of each robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shape {
    pub robots: usize,
    pub samples: usize,
    pub joints: usize,
}

/// Why values are no series.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ShapeError {
    #[error("{name} has {actual} values, {shape} have {expected}")]
    Values { name: &'static str, actual: usize, expected: usize, shape: Shape },

    #[error("{name} has {actual} columns, a robot has {joints} joints")]
    Columns { name: &'static str, actual: usize, joints: usize },

    #[error("column {column} of {name} has {actual} rows, expected whole robots of {samples}")]
    Rows { name: &'static str, column: usize, actual: usize, samples: usize },

    #[error("{shape} are more values than fit into memory")]
    TooLarge { shape: Shape },
}

impl Shape {
    /// Values of u of one robot, and of y.
    pub fn values_per_robot(self) -> usize {
        self.samples * self.joints
    }

    /// Values of u, and of y.
    ///
    /// # Errors
    /// [`ShapeError::TooLarge`] for more than a `usize` counts.
    pub fn values(self) -> Result<usize, ShapeError> {
        let values = self.robots.checked_mul(self.samples);
        let values = values.and_then(|values| values.checked_mul(self.joints));
        values.ok_or(ShapeError::TooLarge { shape: self })
    }

    /// That `actual` values are those of this shape.
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
