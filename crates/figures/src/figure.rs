//! A figure as data: axes, series and bands, with their limits.

use crate::theme::{COMPARED, MEASURED, compared};

/// Largest number of drawn points per series. The crate's documentation says how the rest is left
/// out.
pub const POINTS_DRAWN: usize = 2000;

/// A series with more points than this is drawn only as line and ribbon.
pub const MARKERS_DRAWN: usize = 100;

/// Largest number of series of a figure, and of bands.
pub const SERIES_ALLOWED: usize = 32;

/// A chart of one or more series over a shared pair of axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Drawn above the chart; also its accessible name.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Drawn in this order, later ones on top. Colours and marker shapes follow the order.
    pub series: Vec<Curve>,
    /// Shaded ranges of x, behind everything else.
    pub bands: Vec<Band>,
}

/// An axis: the quantity that it measures, and how values become positions.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// The quantity, such as `RMSE`.
    pub label: String,
    /// Its unit, such as `rad`, shown in parentheses.
    pub unit: Option<String>,
    /// Linear or logarithmic.
    pub scale: Scale,
    /// The ends of the axis, lower first. `None` takes them from the data.
    pub range: Option<(f64, f64)>,
}

/// How values become positions along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences are equally long.
    Linear,
    /// Equal ratios are equally long; only positive values have a place.
    Log,
}

/// A series of a figure: a named line through points.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Shown in the legend.
    pub name: String,
    /// Connected in this order; they are not sorted.
    pub points: Vec<Point>,
    /// Whether the points themselves are shown.
    pub mark: Mark,
    /// How the connecting line is drawn.
    pub stroke: Stroke,
    /// The place of its colour in the palette, which begins again after its end; by default the curve's own place.
    pub colour: Option<usize>,
}

/// One point and, if known, an interval of its y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Position along the horizontal axis, in its unit.
    pub x: f64,
    /// Position along the vertical axis, in its unit.
    pub y: f64,
    /// Lower end of the interval. Drawn only together with `high`.
    pub low: Option<f64>,
    /// Upper end of the interval. Drawn only together with `low`.
    pub high: Option<f64>,
}

/// Whether a series shows its points, and in which form it shows their intervals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A line; intervals become a ribbon around it.
    Line,
    /// A line with a marker at each point; intervals become error bars.
    LineAndMarkers,
}

/// How the line of a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// Unbroken.
    Solid,
    /// Dashed, for a reference.
    Dashed,
    /// Wide and pale, for what others are compared with: narrower lines on it stay visible, and so does it.
    Wide,
    /// Thin and pale, for one of many alike, such as a sample. It has no place in the legend.
    Faint,
}

/// A shaded range of x with a label above it.
///
/// An infinite end reaches to the end of the axis. A band narrower than 3 px, such as one with
/// `from == to`, is drawn 3 px wide.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Where the band begins, in the unit of x.
    pub from: f64,
    /// Where the band ends, in the unit of x.
    pub to: f64,
    /// Written above the band.
    pub label: String,
}

/// The size of a drawing in CSS pixels. It determines the proportions and the relative size of
/// text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// 240 to 4096.
    pub width: u16,
    /// 200 to 4096.
    pub height: u16,
}

/// Why a figure could not be drawn.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The size leaves no room for the axes, or is needlessly large.
    #[error("a figure cannot be {width} x {height} px; allowed are 240 to 4096 x 200 to 4096 px")]
    Size {
        /// The requested width.
        width: u16,
        /// The requested height.
        height: u16,
    },
    /// The range of an axis is empty, reversed, not finite or, on a logarithmic axis, not positive.
    #[error("the axis {label:?} cannot reach from {low} to {high}; {allowed}")]
    Range {
        /// The axis, by its label.
        label: String,
        /// The requested lower end.
        low: f64,
        /// The requested upper end.
        high: f64,
        /// The allowed values.
        allowed: &'static str,
    },
    /// There are more series or bands than a reader could tell apart.
    #[error("a figure cannot have {count} {what}; at most {SERIES_ALLOWED} are allowed")]
    TooMany {
        /// `series` or `bands`.
        what: &'static str,
        /// The number of series or bands.
        count: usize,
    },
    /// The drawing backend failed.
    #[error("drawing the {layer} failed")]
    Drawing {
        /// The figure that was being drawn.
        layer: &'static str,
        /// The reason that the backend gives.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The drawing backend wrote something other than an SVG document.
    #[error("drawing the {layer} failed: not understood: {found:?}, expected an <svg> element")]
    NoSvg {
        /// The figure that was being drawn.
        layer: &'static str,
        /// The beginning and the end of the text.
        found: String,
    },
}

impl Axis {
    /// A linear axis whose range follows the data.
    #[must_use]
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), unit: None, scale: Scale::Linear, range: None }
    }

    /// A logarithmic axis whose range follows the data.
    #[must_use]
    pub fn log(label: impl Into<String>) -> Self {
        Self { scale: Scale::Log, ..Self::linear(label) }
    }

    /// The axis with a unit.
    #[must_use]
    pub fn in_unit(self, unit: impl Into<String>) -> Self {
        Self { unit: Some(unit.into()), ..self }
    }

    /// Label and unit as written along the axis and in the data table: `RMSE (rad)`.
    pub(crate) fn heading(&self) -> String {
        match &self.unit {
            Some(unit) => format!("{} ({unit})", self.label),
            None => self.label.clone(),
        }
    }
}

impl Curve {
    /// An unbroken line without markers.
    #[must_use]
    pub fn line(name: impl Into<String>, points: Vec<Point>) -> Self {
        Self { name: name.into(), points, mark: Mark::Line, stroke: Stroke::Solid, colour: None }
    }

    /// The series as what was measured: wide, pale and black, or white on a dark page. Put it before those that are compared with it.
    #[must_use]
    pub fn measured(self) -> Self {
        Self { stroke: Stroke::Wide, ..self.coloured(MEASURED) }
    }

    /// The series as one of many alike: thin, pale and not in the legend.
    #[must_use]
    pub fn faint(self) -> Self {
        Self { stroke: Stroke::Faint, ..self }
    }

    /// The series in the palette's colour at `place`, whatever stands before it.
    #[must_use]
    pub fn coloured(self, place: usize) -> Self {
        Self { colour: Some(place), ..self }
    }

    /// The series as the `place`-th of those that are compared. Where colours come again, its line is
    /// dashed, has markers, or both.
    #[must_use]
    pub fn compared(self, place: usize) -> Self {
        let curve = self.coloured(compared(place));
        match (place / COMPARED.len() % 4, curve.stroke) {
            (1, Stroke::Solid) => curve.dashed(),
            (2, Stroke::Solid) => curve.with_markers(),
            (3, Stroke::Solid) => curve.dashed().with_markers(),
            _ => curve,
        }
    }

    /// The series with a marker at each point.
    #[must_use]
    pub fn with_markers(self) -> Self {
        Self { mark: Mark::LineAndMarkers, ..self }
    }

    /// The series with a dashed line.
    #[must_use]
    pub fn dashed(self) -> Self {
        Self { stroke: Stroke::Dashed, ..self }
    }
}

impl Point {
    /// A point without an interval.
    #[must_use]
    pub fn new(x: f64, y: f64) -> Self {
        Self { x, y, low: None, high: None }
    }

    /// A point whose y has the interval from `low` to `high`.
    #[must_use]
    pub fn with_interval(x: f64, y: f64, low: f64, high: f64) -> Self {
        Self { x, y, low: Some(low), high: Some(high) }
    }
}

impl Size {
    /// Wide enough for a legend at the side, and low enough for two figures on a screen.
    pub const PAGE: Self = Self { width: 760, height: 420 };

    pub(crate) fn check(self) -> Result<(), FigureError> {
        if (240..=4096).contains(&self.width) && (200..=4096).contains(&self.height) {
            return Ok(());
        }
        Err(FigureError::Size { width: self.width, height: self.height })
    }
}
