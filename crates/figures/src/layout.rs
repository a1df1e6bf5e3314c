//! The layout of a drawing, in CSS pixels from the upper left corner.

use plotters::coord::ranged1d::Ranged;

use crate::coordinate::{Coordinate, Direction, subpixels};
use crate::trace::{Dot, Trace, drawable};
use crate::{Axis, Band, Figure, FigureError, Size, Stroke, text};

pub(crate) const FONT_SIZE: f64 = 12.0;
pub(crate) const TITLE_FONT_SIZE: f64 = 15.0;
pub(crate) const MARGIN: f64 = 14.0;
/// Length of the line in front of a name in the legend.
pub(crate) const LEGEND_LINE: f64 = 28.0;
/// Space between that line and the name.
pub(crate) const LEGEND_SPACE: f64 = 8.0;
/// Height below the plot: tick labels, then the axis's heading.
pub(crate) const X_AXIS_HEIGHT: f64 = 44.0;
const LEGEND_ROW: f64 = 20.0;
const LEGEND_GAP: f64 = 18.0;
const BAND_ROW: f64 = 17.0;
const BAND_ROWS: usize = 3;
const NARROWEST_BAND: f64 = 3.0;
const SHORTEST_PLOT: f64 = 130.0;

/// The places of all parts of a drawing.
#[derive(Debug)]
pub(crate) struct Layout {
    pub(crate) size: Size,
    pub(crate) plot: Plot,
    pub(crate) title: String,
    pub(crate) x: Coordinate,
    pub(crate) y: Coordinate,
    pub(crate) x_heading: String,
    pub(crate) y_heading: String,
    pub(crate) legend: Vec<LegendEntry>,
    pub(crate) bands: Vec<PlacedBand>,
}

/// The rectangle that the axes enclose.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plot {
    pub(crate) left: f64,
    pub(crate) top: f64,
    pub(crate) right: f64,
    pub(crate) bottom: f64,
}

/// A line of the legend.
#[derive(Debug)]
pub(crate) struct LegendEntry {
    /// The series that it names; `None` for the note that there are more.
    pub(crate) series: Option<usize>,
    pub(crate) left: f64,
    /// The vertical middle of the entry.
    pub(crate) middle: f64,
    pub(crate) name: String,
}

/// A band with its ends on the plot and, if there is room, its label.
#[derive(Debug)]
pub(crate) struct PlacedBand {
    pub(crate) left: f64,
    pub(crate) right: f64,
    pub(crate) label: Option<BandLabel>,
}

/// The text above a band.
#[derive(Debug)]
pub(crate) struct BandLabel {
    pub(crate) text: String,
    pub(crate) center: f64,
    pub(crate) middle: f64,
}

/// The space for the legend, which is decided before the plot's position.
enum LegendRoom {
    Right { width: f64 },
    Below { rows: Vec<Vec<(usize, f64)>>, hidden: usize },
}

impl Layout {
    /// The plot begins `least_left` pixels from the left edge, or further right if its labels need
    /// more space.
    pub(crate) fn new(
        figure: &Figure,
        traces: &[Trace],
        size: Size,
        least_left: f64,
    ) -> Result<Self, FigureError> {
        let (width, height) = (f64::from(size.width), f64::from(size.height));
        let (mut x, mut y) = coordinates(figure, traces)?;

        let labelled = figure.bands.iter().filter(|band| !band.label.is_empty()).count();
        let title_height = if figure.title.is_empty() { 0.0 } else { 26.0 };
        let band_rows = row_count(labelled.min(BAND_ROWS));
        let top = MARGIN + title_height + band_rows * BAND_ROW;

        let spare = height - top - X_AXIS_HEIGHT - MARGIN - SHORTEST_PLOT;
        let legend_room = legend_room(figure, width, spare);
        let legend_height = match &legend_room {
            LegendRoom::Right { .. } => 0.0,
            LegendRoom::Below { rows, hidden } => {
                row_count(rows.len() + usize::from(*hidden > 0)) * LEGEND_ROW
            }
        };
        let bottom = height - MARGIN - X_AXIS_HEIGHT - legend_height;

        y.choose_ticks(Direction::Vertical, bottom - top, FONT_SIZE);
        let left = (MARGIN + 20.0 + y.label_width(FONT_SIZE) + 10.0).max(least_left);
        let right = match legend_room {
            LegendRoom::Right { width: legend } => width - MARGIN - legend,
            // Half of the last tick's label extends over the end of the axis.
            LegendRoom::Below { .. } => width - MARGIN - 10.0,
        };
        x.choose_ticks(Direction::Horizontal, right - left, FONT_SIZE);

        let plot = Plot { left, top, right, bottom };
        let legend = match legend_room {
            LegendRoom::Right { width } => legend_right(figure, &plot, width),
            LegendRoom::Below { rows, hidden } => {
                legend_below(figure, &plot, &rows, hidden, bottom + X_AXIS_HEIGHT)
            }
        };
        // The heading is centred on the plot and may extend beyond its ends.
        let middle = (top + bottom) / 2.0;
        let y_heading_room = 2.0 * (middle - MARGIN - title_height).min(height - MARGIN - middle);
        Ok(Self {
            size,
            plot,
            title: text::fit(&figure.title, TITLE_FONT_SIZE * 1.05, width - 2.0 * MARGIN),
            bands: place_bands(&figure.bands, &x, &plot, title_height),
            x_heading: fit_heading(&figure.x, plot.width()),
            y_heading: fit_heading(&figure.y, y_heading_room),
            x,
            y,
            legend,
        })
    }
}

impl Layout {
    /// The position of a dot on the canvas.
    pub(crate) fn place(&self, dot: &Dot) -> (i32, i32) {
        self.at(dot.x, dot.y)
    }

    /// The positions of the lower and upper ends of a dot's interval on the canvas.
    pub(crate) fn place_interval(&self, dot: &Dot) -> Option<((i32, i32), (i32, i32))> {
        dot.interval.map(|(low, high)| (self.at(dot.x, low), self.at(dot.x, high)))
    }

    fn at(&self, x: f64, y: f64) -> (i32, i32) {
        // plotters takes the last unit inside a rectangle as its end.
        let across = (subpixels(self.plot.left), subpixels(self.plot.right) - 1);
        let up = (subpixels(self.plot.bottom) - 1, subpixels(self.plot.top));
        (self.x.map(&x, across), self.y.map(&y, up))
    }
}

impl Plot {
    pub(crate) fn width(&self) -> f64 {
        self.right - self.left
    }

    pub(crate) fn height(&self) -> f64 {
        self.bottom - self.top
    }
}

fn coordinates(figure: &Figure, traces: &[Trace]) -> Result<(Coordinate, Coordinate), FigureError> {
    let dots = || traces.iter().flat_map(Trace::dots);
    let band_ends = figure.bands.iter().flat_map(|band| [band.from, band.to]);
    let across = dots().map(|dot| dot.x).chain(band_ends);
    let up = dots().flat_map(|dot| {
        let (low, high) = dot.interval.unwrap_or((dot.y, dot.y));
        [dot.y, low, high]
    });
    Ok((
        Coordinate::new(&figure.x, Direction::Horizontal, across)?,
        Coordinate::new(&figure.y, Direction::Vertical, up)?,
    ))
}

/// The heading of an axis. Only its label is shortened, because a number without its unit misleads.
fn fit_heading(axis: &Axis, room: f64) -> String {
    let heading = text::printable(&axis.heading());
    let unit = axis.unit.as_ref().map(|unit| text::printable(&format!(" ({unit})")));
    match unit {
        Some(unit) if text::width(&heading, FONT_SIZE) > room => {
            let unit = text::fit(&unit, FONT_SIZE, room / 2.0);
            let label_room = room - text::width(&unit, FONT_SIZE);
            format!("{}{unit}", text::fit(&axis.label, FONT_SIZE, label_room))
        }
        _ => text::fit(&heading, FONT_SIZE, room),
    }
}

/// The places of the series with an entry in the legend.
fn listed(figure: &Figure) -> Vec<usize> {
    let series = figure.series.iter().enumerate();
    series.filter(|(_, curve)| curve.stroke != Stroke::Faint).map(|(place, _)| place).collect()
}

/// Chooses the legend's side. It is beside the plot if it would take several rows below, and the
/// drawing is wide enough. Names that would be cut there stand below, if that leaves most of the
/// height to the plot.
fn legend_room(figure: &Figure, width: f64, spare_height: f64) -> LegendRoom {
    let room = width - 2.0 * MARGIN - 60.0;
    let entry_width = |name: &str| LEGEND_LINE + LEGEND_SPACE + text::width(name, FONT_SIZE);
    let listed = listed(figure);
    let widths: Vec<f64> = listed
        .iter()
        .map(|&place| entry_width(&text::printable(&figure.series[place].name)).min(room))
        .collect();

    let mut rows: Vec<Vec<(usize, f64)>> = Vec::new();
    let mut row_end = f64::INFINITY;
    for (series, entry) in listed.into_iter().zip(&widths) {
        if row_end + entry > room {
            rows.push(Vec::new());
            row_end = 0.0;
        }
        if let Some(row) = rows.last_mut() {
            row.push((series, row_end));
        }
        row_end += entry + LEGEND_GAP;
    }

    let in_one_row = widths.iter().sum::<f64>() + row_count(widths.len()) * LEGEND_GAP <= room;
    if !in_one_row && width >= 560.0 {
        let beside = widths.iter().copied().fold(0.0, f64::max) + LEGEND_GAP;
        let most = width * 0.34;
        if beside <= most || row_count(rows.len()) * LEGEND_ROW > spare_height / 2.0 {
            return LegendRoom::Right { width: beside.min(most) };
        }
    }
    let fitting = (1..=rows.len())
        .rev()
        .find(|rows| row_count(*rows) * LEGEND_ROW <= spare_height)
        .unwrap_or(0);
    // One of the rows then says how many names are missing.
    let kept = if fitting < rows.len() { fitting.saturating_sub(1) } else { fitting };
    let hidden = rows.drain(kept..).map(|row| row.len()).sum();
    LegendRoom::Below { rows, hidden }
}

fn legend_right(figure: &Figure, plot: &Plot, width: f64) -> Vec<LegendEntry> {
    let listed = listed(figure);
    let count = listed.len();
    let fitting =
        (1..=count).rev().find(|n| row_count(*n) * LEGEND_ROW <= plot.height()).unwrap_or(0);
    let named = if fitting < count { fitting.saturating_sub(1) } else { count };
    let left = plot.right + LEGEND_GAP;
    let middle = |row: usize| plot.top + (row_count(row) + 0.5) * LEGEND_ROW;
    let name_room = width - LEGEND_GAP - LEGEND_LINE - LEGEND_SPACE;
    let names = names_that_fit(figure, name_room);
    let mut legend: Vec<LegendEntry> = listed
        .into_iter()
        .take(named)
        .enumerate()
        .map(|(row, series)| {
            let name = names[series].clone();
            LegendEntry { series: Some(series), left, middle: middle(row), name }
        })
        .collect();
    if named < count {
        legend.push(more(count - named, left, middle(named)));
    }
    legend
}

fn legend_below(
    figure: &Figure,
    plot: &Plot,
    rows: &[Vec<(usize, f64)>],
    hidden: usize,
    top: f64,
) -> Vec<LegendEntry> {
    let name_room = plot.width() - LEGEND_LINE - LEGEND_SPACE;
    let middle = |row: usize| top + (row_count(row) + 0.65) * LEGEND_ROW;
    let names = names_that_fit(figure, name_room);
    let mut legend = Vec::new();
    for (row, entries) in rows.iter().enumerate() {
        for (series, offset) in entries {
            legend.push(LegendEntry {
                series: Some(*series),
                left: plot.left + offset,
                middle: middle(row),
                name: names[*series].clone(),
            });
        }
    }
    if hidden > 0 {
        legend.push(more(hidden, plot.left, middle(rows.len())));
    }
    legend
}

fn names_that_fit(figure: &Figure, room: f64) -> Vec<String> {
    let names: Vec<&str> = figure.series.iter().map(|series| series.name.as_str()).collect();
    text::fit_names(&names, FONT_SIZE, room)
}

fn more(hidden: usize, left: f64, middle: f64) -> LegendEntry {
    LegendEntry { series: None, left, middle, name: format!("and {hidden} more") }
}

/// Places the visible bands. Each label goes into the first row above the plot that has space for
/// it.
fn place_bands(bands: &[Band], x: &Coordinate, plot: &Plot, title_height: f64) -> Vec<PlacedBand> {
    let mut row_ends = vec![f64::NEG_INFINITY; bands.len().min(BAND_ROWS)];
    let mut placed = Vec::new();
    for band in bands {
        let Some((left, right)) = band_edges(band, x, plot) else { continue };
        let text = text::fit(&band.label, FONT_SIZE, plot.width());
        let half = text::width(&text, FONT_SIZE) / 2.0;
        let center = ((left + right) / 2.0).max(plot.left + half).min(plot.right - half);
        let row = row_ends.iter().position(|end| *end + 8.0 <= center - half);
        let label = row.filter(|_| !text.is_empty()).map(|row| {
            row_ends[row] = center + half;
            // Row 0 is the lowest, nearest to its band.
            let middle = plot.top - (row_count(row) + 0.5) * BAND_ROW;
            BandLabel { text, center, middle: middle.max(MARGIN + title_height) }
        });
        placed.push(PlacedBand { left, right, label });
    }
    placed
}

/// The visible ends of a band in pixels, at least [`NARROWEST_BAND`] apart.
fn band_edges(band: &Band, x: &Coordinate, plot: &Plot) -> Option<(f64, f64)> {
    if band.from.is_nan() || band.to.is_nan() {
        return None;
    }
    let at = |value: f64| {
        let position = if drawable(value) { x.position(value) } else { value.signum() * 1e3 };
        plot.left + position * plot.width()
    };
    let (from, to) = (at(band.from.min(band.to)), at(band.from.max(band.to)));
    if to < plot.left || from > plot.right {
        return None;
    }
    let (left, right) = (from.max(plot.left), to.min(plot.right));
    if right - left >= NARROWEST_BAND {
        return Some((left, right));
    }
    let half = NARROWEST_BAND / 2.0;
    let center = ((left + right) / 2.0).max(plot.left + half).min(plot.right - half);
    Some((center - half, center + half))
}

/// A number of rows or entries as a float. There are at most a few hundred.
fn row_count(rows: usize) -> f64 {
    u32::try_from(rows).map_or(f64::INFINITY, f64::from)
}
