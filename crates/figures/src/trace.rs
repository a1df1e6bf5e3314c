//! The drawable part of a series: unbroken runs of points, few enough for a drawing.

use crate::{Axis, POINTS_DRAWN, Point, Scale};

/// Beyond this, the arithmetic of ranges and ticks could overflow.
const LARGEST_DRAWN: f64 = 1e120;

/// A point with a position on both axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dot {
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// The interval's ends, lower first. On a logarithmic axis the lower end may lie below the
    /// axis.
    pub(crate) interval: Option<(f64, f64)>,
}

/// The drawable part of a series.
#[derive(Debug, Default)]
pub(crate) struct Trace {
    /// Maximal unbroken runs. None is empty.
    pub(crate) runs: Vec<Vec<Dot>>,
    /// Number of points with a position on both axes, before decimation.
    pub(crate) drawable: usize,
    /// Number of points left out because they are not finite or too large.
    pub(crate) not_finite: usize,
    /// Number of points left out because they are not positive on a logarithmic axis.
    pub(crate) not_positive: usize,
    /// Number of drawn points whose interval is incomplete or has no position on the axis.
    pub(crate) broken_intervals: usize,
}

impl Trace {
    pub(crate) fn new(points: &[Point], x: &Axis, y: &Axis) -> Self {
        let mut trace = Self::default();
        let mut samples: Vec<Option<Dot>> = Vec::with_capacity(points.len());
        for point in points {
            samples.push(trace.place(point, x.scale, y.scale));
        }
        trace.runs = runs(&decimate(samples));
        trace
    }

    pub(crate) fn dots(&self) -> impl Iterator<Item = &Dot> {
        self.runs.iter().flatten()
    }

    fn place(&mut self, point: &Point, x: Scale, y: Scale) -> Option<Dot> {
        if !drawable(point.x) || !drawable(point.y) {
            self.not_finite += 1;
            return None;
        }
        if !has_place(point.x, x) || !has_place(point.y, y) {
            self.not_positive += 1;
            return None;
        }
        self.drawable += 1;
        let interval = match (point.low, point.high) {
            (None, None) => None,
            (Some(low), Some(high))
                if drawable(low) && drawable(high) && has_place(low.max(high), y) =>
            {
                Some((low.min(high), low.max(high)))
            }
            _ => {
                self.broken_intervals += 1;
                None
            }
        };
        Some(Dot { x: point.x, y: point.y, interval })
    }
}

/// Whether a value is finite and small enough to calculate with.
pub(crate) fn drawable(value: f64) -> bool {
    value.abs() <= LARGEST_DRAWN
}

/// Whether a drawable value has a position on an axis with this scale.
pub(crate) fn has_place(value: f64, scale: Scale) -> bool {
    match scale {
        Scale::Linear => true,
        // Smaller values would lie as far down as the limit of `LARGEST_DRAWN` lies up.
        Scale::Log => value >= LARGEST_DRAWN.recip(),
    }
}

/// At most about [`POINTS_DRAWN`] of the samples: the first, the last, and each bucket's extremes.
///
/// Extremes are better than means, because readers of a loss curve look for spikes.
fn decimate(samples: Vec<Option<Dot>>) -> Vec<Option<Dot>> {
    if samples.len() <= POINTS_DRAWN {
        return samples;
    }
    let last = samples.len() - 1;
    let buckets = (POINTS_DRAWN - 2) / 2;
    let inner = last - 1;
    let mut kept = vec![samples[0]];
    for bucket in 0..buckets {
        let start = 1 + bucket * inner / buckets;
        let end = 1 + (bucket + 1) * inner / buckets;
        kept.extend(extremes(&samples[start..end]));
    }
    kept.push(samples[last]);
    kept
}

/// The lowest and the highest of some samples, and the first break between them, in their order.
fn extremes(samples: &[Option<Dot>]) -> Vec<Option<Dot>> {
    let heights = || samples.iter().enumerate().filter_map(|(i, s)| s.map(|dot| (i, dot.y)));
    let lowest = heights().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i);
    let highest = heights().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i);
    let gap = samples.iter().position(Option::is_none);
    let mut chosen: Vec<usize> = [lowest, highest, gap].into_iter().flatten().collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|i| samples[i]).collect()
}

fn runs(samples: &[Option<Dot>]) -> Vec<Vec<Dot>> {
    samples
        .split(Option::is_none)
        .filter(|run| !run.is_empty())
        .map(|run| run.iter().flatten().copied().collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace(points: &[Point]) -> Trace {
        Trace::new(points, &Axis::linear("x"), &Axis::linear("y"))
    }

    #[test]
    fn a_point_that_is_not_finite_breaks_the_line_and_is_counted() {
        let trace = trace(&[
            Point::new(0.0, 1.0),
            Point::new(1.0, f64::NAN),
            Point::new(2.0, 1.0),
            Point::new(f64::INFINITY, 1.0),
            Point::new(4.0, 1e200),
        ]);
        assert_eq!(trace.runs.len(), 2);
        assert_eq!((trace.drawable, trace.not_finite), (2, 3));
    }

    #[test]
    fn an_interval_given_by_half_is_dropped_but_its_point_stays() {
        let half = Point { x: 0.0, y: 1.0, low: Some(0.5), high: None };
        let infinite = Point::with_interval(1.0, 1.0, 0.0, f64::INFINITY);
        let trace = trace(&[half, infinite]);
        assert_eq!((trace.drawable, trace.broken_intervals), (2, 2));
    }

    #[test]
    fn a_reversed_interval_is_put_in_order() {
        let trace = trace(&[Point::with_interval(0.0, 1.0, 2.0, 0.5)]);
        assert_eq!(trace.runs[0][0].interval, Some((0.5, 2.0)));
    }

    #[test]
    fn decimation_keeps_the_ends_the_spike_and_the_break() {
        let mut points: Vec<Point> =
            (0..100_000).map(|i| Point::new(f64::from(i), f64::from(i % 7))).collect();
        points[31_415].y = 1e6;
        points[62_832].y = f64::NAN;
        let trace = trace(&points);
        let drawn = trace.dots().count();
        assert!(drawn <= POINTS_DRAWN, "{drawn} points are drawn");
        assert_eq!(trace.runs.len(), 2);
        assert_eq!(trace.runs[0][0].x, 0.0);
        assert_eq!(trace.runs[1].last().map(|dot| dot.x), Some(99_999.0));
        assert!(trace.dots().any(|dot| dot.y == 1e6));
        assert_eq!(trace.drawable, 99_999);
    }
}
