//! Draws series as SVG and writes their data table.
//!
//! A [`Figure`] is plain data: two axes, named series, shaded bands. [`Figure::to_svg`] draws it,
//! and [`Figure::to_csv`] writes the numbers behind the drawing. Neither knows what the numbers
//! mean. [`predictor_colour`] knows the names of predictors, which have the same colour in every
//! figure. An [`ArmFigure`] is an arm, drawn from two sides.
//!
//! The drawing is one self-contained SVG element: no scripts, no ids (so that several can stand in one page), no fonts of
//! its own. The same figure and size give the same bytes. It stretches to the width of its container and has a ground of its
//! own: white, or dark for readers who prefer dark pages. Its only style sheet, [`style`], makes that difference.
//! `<title>` and `<desc>` say in words what it shows, and `<metadata>` holds the drawn numbers as JSON, with which a script can
//! show values and draw a part of the figure again. The groups `frame` and `data`, and those of each series (`data-series`),
//! are what such a script finds by name.
//!
//! # What is not drawn
//!
//! - A point with a non-finite coordinate, a coordinate beyond ±10¹²⁰, or a coordinate that is not
//!   positive on a logarithmic axis is skipped and breaks its line. `<desc>` counts these points.
//! - A series of more than [`POINTS_DRAWN`] points is decimated: its points are split, in order,
//!   into equal buckets, and each bucket keeps its lowest and its highest point, and a break if it
//!   holds one. First and last point are always kept. The data table is never decimated.
//! - Markers and error bars of a series with more than [`MARKERS_DRAWN`] points.

#![warn(missing_docs)]

mod arm;
mod coordinate;
mod description;
mod drawing;
mod figure;
mod layout;
mod marks;
mod numbers;
mod predictors;
mod stack;
mod table;
mod text;
mod theme;
mod ticks;
mod trace;

pub use arm::{ArmFigure, ArmJoint};
pub use figure::{
    Axis, Band, Curve, Figure, FigureError, MARKERS_DRAWN, Mark, POINTS_DRAWN, Point,
    SERIES_ALLOWED, Scale, Size, Stroke,
};
pub use predictors::{is_baseline, predictor_colour};
pub use stack::stacked;
pub use theme::{COMPARED, MEASURED, compared, style};

impl Figure {
    /// Draws the figure as one self-contained `<svg>` element.
    ///
    /// # Errors
    ///
    /// [`FigureError::Size`], [`FigureError::Range`] and [`FigureError::TooMany`] for requests that
    /// cannot be met. Data never causes an error. Points that cannot be drawn are skipped and
    /// counted in `<desc>`, and a figure with nothing to draw says "no data yet".
    pub fn to_svg(&self, size: Size) -> Result<String, FigureError> {
        drawing::svg(self, size)
    }

    /// The data behind the drawing: one row per point, without omissions.
    ///
    /// RFC 4180 with `\n` line ends. Columns: `series`, the label and unit of x, those of y, `low`,
    /// `high`. Numbers have the fewest digits that read back as the same `f64`. `NaN`, `inf` and
    /// `-inf` are written as such, and a missing interval is an empty cell. A name that a
    /// spreadsheet would run as a formula gets a leading apostrophe.
    #[must_use]
    pub fn to_csv(&self) -> String {
        table::csv(self)
    }
}
