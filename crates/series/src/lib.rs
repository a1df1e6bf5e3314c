//! Torques u (N·m) and positions y (rad) of many robots over time, from Parquet to tensor and back.
//!
//! [`Series`] owns the values, [`SeriesView`] borrows those of some robots and samples, and
//! [`Observed`] borrows those that a predictor may know. All values are f32 in the order `[robot,
//! sample, joint]`. The values of a robot lie together, so that batches and windows are slices. A
//! batch has the order of its tensor `[batch, time, channel]`.
//!
//! `y[k]` is the position at sample k, before `u[k]` acts. `u[k]` is held until sample k + 1.
//!
//! u and y are the measured values. A series may also have the true values, for scores and losses.
//! An [`Observed`] never has them.
//!
//! [`Smoother`] and [`LowPass`] remove the noise of measured positions, [`JointMotion`] has their
//! derivatives, [`Decimated`] asks at a lower rate, and the quantiles here are those of every table.
//!
//! Values are copied twice between a decoded row group and a tensor. [`Series::gather`] takes the
//! robots of a batch out of [`Columns`], and a model normalizes the batch into the tensor. Views
//! copy nothing.

#![warn(missing_docs)]

mod columns;
mod decimation;
mod motion;
mod noise;
mod observed;
mod owned;
mod quantiles;
mod shape;
mod smoothing;
mod track;
mod view;

pub use columns::Columns;
pub use decimation::Decimated;
pub use motion::{JointMotion, mean_torques};
pub use noise::MeasurementNoise;
pub use observed::Observed;
pub use owned::Series;
pub use quantiles::{interpolated_quantile, measured_quantile, median, student_quantile_975};
pub use shape::{Shape, ShapeError};
pub use smoothing::{LowPass, Smoother};
pub use track::Track;
pub use view::SeriesView;
