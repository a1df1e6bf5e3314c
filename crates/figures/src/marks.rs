//! The style of a curve: its colour, its line, its markers, its intervals.

use plotters::prelude::SVGBackend;
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, DrawingBackend, DrawingErrorKind,
};

use crate::coordinate::subpixels;
use crate::layout::{LEGEND_LINE, Layout, LegendEntry};
use crate::theme::PALETTE;
use crate::trace::Trace;
use crate::{Curve, MARKERS_DRAWN, Mark, Stroke};

const LINE_WIDTH: f64 = 2.0;
const WIDE_WIDTH: f64 = 6.0;
const WIDE_OPACITY: f64 = 0.35;
const FAINT_OPACITY: f64 = 0.45;
/// A line through more points than this is dense.
const DENSE: usize = 500;
const RIBBON_OPACITY: f64 = 0.18;
const MARKER_RADIUS: f64 = 3.5;
const CAP: f64 = 3.0;

/// The result of drawing on a canvas.
pub(crate) type Drawn = Result<(), DrawingErrorKind<std::io::Error>>;

/// A colour and a width in subpixels, in the form that plotters' backends need.
pub(crate) struct Pen {
    color: BackendColor,
    width: u32,
}

impl BackendStyle for Pen {
    fn color(&self) -> BackendColor {
        self.color
    }

    fn stroke_width(&self) -> u32 {
        self.width
    }
}

/// The style of the curve at an index of a figure's list.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CurveStyle {
    pub(crate) rgb: (u8, u8, u8),
    shape: Shape,
    pub(crate) stroke: Stroke,
    pub(crate) markers: bool,
    bars: bool,
}

#[derive(Debug, Clone, Copy)]
enum Shape {
    Circle,
    Square,
    Triangle,
    Diamond,
}

impl CurveStyle {
    pub(crate) fn new(index: usize, series: &Curve, trace: &Trace) -> Self {
        let shapes = [Shape::Circle, Shape::Square, Shape::Triangle, Shape::Diamond];
        let index = series.colour.unwrap_or(index);
        let marked = series.mark == Mark::LineAndMarkers && trace.drawable <= MARKERS_DRAWN;
        Self {
            rgb: PALETTE[index % PALETTE.len()],
            // A colour that comes again has the next shape.
            shape: shapes[(index + index / PALETTE.len()) % shapes.len()],
            stroke: series.stroke,
            markers: marked,
            bars: marked,
        }
    }

    fn pen(&self, width: f64, alpha: f64) -> Pen {
        Pen { color: BackendColor { alpha, rgb: self.rgb }, width: subpixels(width).unsigned_abs() }
    }

    /// Ribbons of runs with intervals. A single interval has no width and gets a bar instead.
    pub(crate) fn draw_ribbons(
        &self,
        canvas: &mut SVGBackend,
        at: &Layout,
        trace: &Trace,
    ) -> Drawn {
        if self.bars {
            return Ok(());
        }
        for run in &trace.runs {
            for part in run.split(|dot| dot.interval.is_none()).filter(|part| part.len() > 1) {
                let upper =
                    part.iter().filter_map(|dot| at.place_interval(dot).map(|(_, high)| high));
                let lower =
                    part.iter().rev().filter_map(|dot| at.place_interval(dot).map(|(low, _)| low));
                canvas.fill_polygon(upper.chain(lower), &self.pen(1.0, RIBBON_OPACITY))?;
            }
        }
        Ok(())
    }

    pub(crate) fn draw_lines(&self, canvas: &mut SVGBackend, at: &Layout, trace: &Trace) -> Drawn {
        // A dense curve moves up and down within its own width, and a thin line keeps that visible.
        let pen = match self.stroke {
            Stroke::Wide => self.pen(WIDE_WIDTH, WIDE_OPACITY),
            Stroke::Faint => self.pen(1.0, FAINT_OPACITY),
            _ if trace.drawable > DENSE => self.pen(1.0, 1.0),
            _ => self.pen(LINE_WIDTH, 1.0),
        };
        for run in trace.runs.iter().filter(|run| run.len() > 1) {
            canvas.draw_path(run.iter().map(|dot| at.place(dot)), &pen)?;
        }
        Ok(())
    }

    /// Markers and error bars, and a dot for each point that has no neighbour to draw a line to.
    pub(crate) fn draw_points(&self, canvas: &mut SVGBackend, at: &Layout, trace: &Trace) -> Drawn {
        for run in &trace.runs {
            let lone = run.len() == 1;
            for dot in run.iter().filter(|_| lone || self.markers) {
                if let Some((low, high)) = at.place_interval(dot) {
                    self.draw_bar(canvas, low, high)?;
                }
                if self.markers {
                    self.draw_marker(canvas, at.place(dot))?;
                } else {
                    let radius = subpixels(MARKER_RADIUS * 0.6).unsigned_abs();
                    canvas.draw_circle(at.place(dot), radius, &self.pen(1.0, 1.0), true)?;
                }
            }
        }
        Ok(())
    }

    fn draw_bar(&self, canvas: &mut SVGBackend, low: BackendCoord, high: BackendCoord) -> Drawn {
        let pen = self.pen(1.25, 0.8);
        let cap = subpixels(CAP);
        canvas.draw_line(low, high, &pen)?;
        for (x, y) in [low, high] {
            canvas.draw_line((x - cap, y), (x + cap, y), &pen)?;
        }
        Ok(())
    }

    fn draw_marker(&self, canvas: &mut SVGBackend, (x, y): BackendCoord) -> Drawn {
        let pen = self.pen(1.0, 1.0);
        let r = subpixels(MARKER_RADIUS);
        // Each shape has about the same area as the circle.
        match self.shape {
            Shape::Circle => canvas.draw_circle((x, y), r.unsigned_abs(), &pen, true),
            Shape::Square => {
                let half = r * 7 / 8;
                canvas.draw_rect((x - half, y - half), (x + half, y + half), &pen, true)
            }
            Shape::Triangle => {
                let reach = r * 5 / 4;
                let corners = [(x, y - reach), (x + reach, y + r), (x - reach, y + r)];
                canvas.fill_polygon(corners, &pen)
            }
            Shape::Diamond => {
                let reach = r * 5 / 4;
                canvas.fill_polygon(
                    [(x, y - reach), (x + reach, y), (x, y + reach), (x - reach, y)],
                    &pen,
                )
            }
        }
    }

    pub(crate) fn draw_legend_line(&self, canvas: &mut SVGBackend, entry: &LegendEntry) -> Drawn {
        let y = subpixels(entry.middle);
        let ends = [(subpixels(entry.left), y), (subpixels(entry.left + LEGEND_LINE), y)];
        match self.stroke {
            Stroke::Wide => canvas.draw_path(ends, &self.pen(WIDE_WIDTH, WIDE_OPACITY)),
            _ => canvas.draw_path(ends, &self.pen(LINE_WIDTH, 1.0)),
        }
    }

    pub(crate) fn draw_legend_marker(&self, canvas: &mut SVGBackend, entry: &LegendEntry) -> Drawn {
        if !self.markers {
            return Ok(());
        }
        let middle = (subpixels(entry.left + LEGEND_LINE / 2.0), subpixels(entry.middle));
        self.draw_marker(canvas, middle)
    }
}
