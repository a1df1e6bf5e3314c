//! Axes: their ends, their ticks, and the positions of values in pixels.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

use crate::ticks::{self, Tick};
use crate::trace::{drawable, has_place};
use crate::{Axis, FigureError, Scale, text};

/// Units of the canvas per CSS pixel. The canvas only knows whole units, and a curve on whole
/// pixels would have visible steps.
pub(crate) const SUBPIXELS: u16 = 4;

/// An axis with fixed ends. It has no ticks if there are no values and no range, because their
/// numbers would mean nothing.
#[derive(Debug, Clone)]
pub(crate) struct Coordinate {
    scale: Scale,
    low: f64,
    high: f64,
    blank: bool,
    ticks: Vec<Tick>,
    minor: Vec<f64>,
}

/// The direction of an axis. It decides whether the width or the height of a label matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Direction {
    Horizontal,
    Vertical,
}

impl Coordinate {
    /// An axis over its own range. Without one, it covers the values that have a position on it.
    pub(crate) fn new(
        axis: &Axis,
        direction: Direction,
        values: impl Iterator<Item = f64>,
    ) -> Result<Self, FigureError> {
        let known = match axis.range {
            Some((low, high)) => {
                check_range(axis, low, high)?;
                Some((low, high))
            }
            None => range_of(axis.scale, direction, values),
        };
        let (low, high) = known.unwrap_or((1.0, 2.0));
        let blank = known.is_none();
        Ok(Self { scale: axis.scale, low, high, blank, ticks: Vec::new(), minor: Vec::new() })
    }

    /// Chooses the densest ticks whose labels do not touch on an axis of this length in pixels.
    pub(crate) fn choose_ticks(&mut self, direction: Direction, length: f64, font_size: f64) {
        if self.blank {
            return;
        }
        self.minor = ticks::minor(self.scale, self.low, self.high);
        let spacing = match direction {
            Direction::Horizontal => 70.0,
            Direction::Vertical => 36.0,
        };
        let most = (2..=12u32).rev().find(|n| f64::from(*n) * spacing <= length).unwrap_or(2);
        let mut sets = ticks::candidates(self.scale, self.low, self.high, most);
        let fitting = sets.iter().position(|set| self.fits(set, direction, length, font_size));
        // The last set is the sparsest, and some ticks are better than none.
        self.ticks = sets.swap_remove(fitting.unwrap_or(sets.len() - 1));
        if self.ticks.len() < 2 {
            // A single label does not show the scale, so a slightly crowded axis is better.
            let denser = ticks::candidates(self.scale, self.low, self.high, 2 * most);
            let several = |set: &Vec<Tick>| set.len() > 1;
            let fits = |set: &Vec<Tick>| self.fits(set, direction, length, font_size);
            if let Some(set) = denser.into_iter().rev().filter(several).find(fits) {
                self.ticks = set;
            }
        }
    }

    fn fits(&self, set: &[Tick], direction: Direction, length: f64, font_size: f64) -> bool {
        let extent = |tick: &Tick| match direction {
            Direction::Horizontal => text::width(&tick.label, font_size) + 14.0,
            Direction::Vertical => font_size * 1.7,
        };
        set.windows(2).all(|pair| {
            let apart = (self.position(pair[1].value) - self.position(pair[0].value)) * length;
            apart >= (extent(&pair[0]) + extent(&pair[1])) / 2.0
        })
    }

    /// The ends of the axis, the lower one first.
    pub(crate) fn ends(&self) -> (f64, f64) {
        (self.low, self.high)
    }

    /// The width of the widest tick label in pixels.
    pub(crate) fn label_width(&self, font_size: f64) -> f64 {
        self.ticks.iter().map(|tick| text::width(&tick.label, font_size)).fold(0.0, f64::max)
    }

    /// The position of a value between the ends: 0 at the lower, 1 at the upper. A value without a
    /// position on a logarithmic axis lies far below its lower end.
    pub(crate) fn position(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log if value <= 0.0 => -1e3,
            Scale::Log => (value / self.low).ln() / (self.high / self.low).ln(),
        }
    }
}

impl Ranged for Coordinate {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let (start, end) = (f64::from(limit.0), f64::from(limit.1));
        // Far outside, the exact position does not matter, but SVG readers do not accept every
        // number.
        nearest((start + self.position(*value) * (end - start)).clamp(-1e7, 1e7))
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() {
            return self.minor.clone();
        }
        self.ticks.iter().map(|tick| tick.value).collect()
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Coordinate {
    fn format_ext(&self, value: &f64) -> String {
        let tick = self.ticks.iter().find(|tick| tick.value == *value);
        tick.map(|tick| tick.label.clone()).unwrap_or_default()
    }
}

/// CSS pixels in the units of the canvas.
pub(crate) fn subpixels(pixels: f64) -> i32 {
    nearest(pixels * f64::from(SUBPIXELS))
}

#[expect(clippy::cast_possible_truncation, reason = "rounded; the cast saturates far outside")]
fn nearest(position: f64) -> i32 {
    position.round() as i32
}

fn check_range(axis: &Axis, low: f64, high: f64) -> Result<(), FigureError> {
    let wide_enough = match axis.scale {
        Scale::Linear => high - low > 1e-12 * low.abs().max(high.abs()),
        Scale::Log => high > low * (1.0 + 1e-6),
    };
    let placed = |value| drawable(value) && has_place(value, axis.scale);
    if placed(low) && placed(high) && wide_enough {
        return Ok(());
    }
    let allowed = match axis.scale {
        Scale::Linear => "two different finite numbers are allowed, the lower one first",
        Scale::Log => "two different positive numbers are allowed, the lower one first",
    };
    Err(FigureError::Range { label: axis.label.clone(), low, high, allowed })
}

/// A range that shows all values with a little room around them; `None` without any.
fn range_of(
    scale: Scale,
    direction: Direction,
    values: impl Iterator<Item = f64>,
) -> Option<(f64, f64)> {
    let (low, high) = values
        .filter(|value| drawable(*value) && has_place(*value, scale))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return None;
    }
    let margin = match direction {
        Direction::Horizontal => 0.02,
        Direction::Vertical => 0.06,
    };
    Some(match scale {
        Scale::Log => {
            let ratio = high / low;
            let factor = if ratio < 1.0 + 1e-6 { 1.5 } else { ratio.powf(margin) };
            (low / factor, high * factor)
        }
        Scale::Linear => {
            let (span, largest) = (high - low, low.abs().max(high.abs()));
            if span <= 1e-9 * largest || span == 0.0 {
                let half = if largest == 0.0 { 1.0 } else { largest / 2.0 };
                return Some((low - half, high + half));
            }
            // Heights are compared by their ratio, so the axis starts at zero if that costs little
            // space.
            let from_zero = direction == Direction::Vertical && low >= 0.0 && low < high / 2.0;
            let lower = if from_zero { 0.0 } else { low - margin * span };
            (lower, high + margin * span)
        }
    })
}
