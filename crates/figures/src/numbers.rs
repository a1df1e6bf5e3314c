//! The drawn numbers as JSON, for scripts that show values or draw a part of the figure again.

use serde_json::{Map, Value, json};

use crate::coordinate::Coordinate;
use crate::layout::Layout;
use crate::marks::CurveStyle;
use crate::trace::{Dot, Trace};
use crate::{Axis, Band, Figure, Scale, Stroke, theme};

/// `plot` has the edges of the plot (left, top, right, bottom) in the units of `viewBox`; `x` and `y` the axes with their
/// ends; `series` the name, the colour and the drawn points of each curve. `null` among the points is a break of the line.
/// A series without `x` has that of the series before it. `bands` has the shaded parts of x; it is missing without any.
pub(crate) fn json(
    figure: &Figure,
    layout: &Layout,
    styles: &[CurveStyle],
    traces: &[Trace],
) -> String {
    let plot = &layout.plot;
    let mut before: Option<Vec<Value>> = None;
    let mut series = Vec::with_capacity(traces.len());
    for ((curve, style), trace) in figure.series.iter().zip(styles).zip(traces) {
        let column = |value: &dyn Fn(&Dot) -> Option<f64>| -> Vec<Value> {
            let number = |dot: &Dot| value(dot).map_or(Value::Null, short);
            let runs: Vec<Vec<Value>> =
                trace.runs.iter().map(|run| run.iter().map(number).collect()).collect();
            runs.join(&Value::Null)
        };
        let mut told = Map::new();
        told.insert("name".to_owned(), curve.name.clone().into());
        told.insert("colour".to_owned(), theme::hex(style.rgb).into());
        let stroke = match curve.stroke {
            Stroke::Solid => "solid",
            Stroke::Dashed => "dashed",
            Stroke::Wide => "wide",
            Stroke::Faint => "faint",
        };
        told.insert("stroke".to_owned(), stroke.into());
        told.insert("markers".to_owned(), style.markers.into());
        let x = column(&|dot| Some(dot.x));
        if before.as_ref() != Some(&x) {
            told.insert("x".to_owned(), x.clone().into());
            before = Some(x);
        }
        told.insert("y".to_owned(), column(&|dot| Some(dot.y)).into());
        if trace.dots().any(|dot| dot.interval.is_some()) {
            told.insert("low".to_owned(), column(&|dot| dot.interval.map(|ends| ends.0)).into());
            told.insert("high".to_owned(), column(&|dot| dot.interval.map(|ends| ends.1)).into());
        }
        series.push(Value::from(told));
    }
    let edges = [plot.left, plot.top, plot.right, plot.bottom].map(short);
    let [x, y] = [(&figure.x, &layout.x), (&figure.y, &layout.y)].map(|(a, b)| axis(a, b));
    let mut told = json!({ "plot": edges, "x": x, "y": y, "series": series });
    let drawn = figure.bands.iter().filter(|band| band.from.is_finite() && band.to.is_finite());
    let bands: Vec<Value> = drawn.map(band).collect();
    if !bands.is_empty() {
        told["bands"] = bands.into();
    }
    told.to_string()
}

fn band(Band { from, to, label }: &Band) -> Value {
    json!({ "from": short(*from), "to": short(*to), "label": label })
}

fn axis(axis: &Axis, coordinate: &Coordinate) -> Value {
    let (low, high) = coordinate.ends();
    json!({
        "label": axis.label,
        "unit": axis.unit,
        "log": axis.scale == Scale::Log,
        "low": short(low),
        "high": short(high),
    })
}

/// Seven significant digits, more than a drawing shows.
fn short(value: f64) -> Value {
    format!("{value:.6e}").parse().unwrap_or(value).into()
}
