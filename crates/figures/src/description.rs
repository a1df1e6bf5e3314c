//! Describes a figure in words, for readers who do not see it.

use std::fmt::Write;

use crate::trace::Trace;
use crate::{Axis, Curve, Figure, MARKERS_DRAWN, POINTS_DRAWN, Scale, text};

/// One paragraph with the axes, each series and its extent, the bands, and the points that are not
/// drawn.
pub(crate) fn describe(figure: &Figure, traces: &[Trace]) -> String {
    let mut sentences =
        vec![format!("Line chart of {} over {}.", axis(&figure.y), axis(&figure.x))];
    if traces.iter().all(|trace| trace.drawable == 0) {
        sentences.push("No data yet.".to_owned());
    }
    for (series, trace) in figure.series.iter().zip(traces) {
        sentences.push(extent(series, trace));
    }
    for band in &figure.bands {
        let text = if band.from.is_nan() || band.to.is_nan() {
            format!("The band {} is not drawn: it has no ends.", band.label)
        } else {
            format!("Shaded from {} to {}: {}.", short(band.from), short(band.to), band.label)
        };
        sentences.push(text);
    }
    sentences.join(" ")
}

fn axis(axis: &Axis) -> String {
    let scale = match axis.scale {
        Scale::Linear => "",
        Scale::Log => " (logarithmic)",
    };
    format!("{}{scale}", axis.heading())
}

fn extent(series: &Curve, trace: &Trace) -> String {
    let mut text = format!("{}: {}", series.name, text::counted(trace.drawable, "point"));
    let heights = || trace.dots().map(|dot| dot.y);
    if let (Some(first), Some(last)) = (trace.dots().next(), trace.dots().last()) {
        let lowest = heights().fold(f64::INFINITY, f64::min);
        let highest = heights().fold(f64::NEG_INFINITY, f64::max);
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            ", from {} at {} to {} at {}, lowest {}, highest {}",
            short(first.y),
            short(first.x),
            short(last.y),
            short(last.x),
            short(lowest),
            short(highest),
        );
    }
    let omissions = [
        omitted(trace.not_finite, "point", "not finite or too large"),
        omitted(trace.not_positive, "point", "not positive on a logarithmic axis"),
        omitted(trace.broken_intervals, "interval", "without two finite ends on the axis"),
    ];
    for omission in omissions.into_iter().flatten() {
        text.push_str(&omission);
    }
    if series.points.len() > POINTS_DRAWN {
        let _ = write!(text, "; drawn by the extremes of {} buckets", POINTS_DRAWN / 2 - 1);
    }
    if series.mark == crate::Mark::LineAndMarkers && trace.drawable > MARKERS_DRAWN {
        text.push_str("; drawn without markers");
    }
    text.push('.');
    text
}

fn omitted(count: usize, noun: &str, why: &str) -> Option<String> {
    (count > 0).then(|| format!("; {} not drawn: {why}", text::counted(count, noun)))
}

/// Four significant digits, because a listener cannot remember more.
fn short(value: f64) -> String {
    if !value.is_finite() {
        return value.to_string();
    }
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    if rounded == 0.0 || (1e-3..1e7).contains(&rounded.abs()) {
        return rounded.to_string();
    }
    format!("{rounded:e}")
}
