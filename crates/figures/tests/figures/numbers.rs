//! The numbers that a drawing carries for scripts.

use figures::{Axis, Band, Curve, Point};
use roxmltree::Document;

use crate::{SCALE, figure, lines, named, svg};

pub fn numbers(document: &Document) -> serde_json::Value {
    serde_json::from_str(named(document, "metadata").next().unwrap().text().unwrap()).unwrap()
}

#[test]
fn a_script_finds_the_drawn_numbers_where_the_lines_are() {
    let first = vec![
        Point::with_interval(1.0, 2.0, 1.5, 2.5),
        Point::new(10.0, f64::NAN),
        Point::new(100.0, 0.123456789),
        Point::new(1000.0, 7.0),
    ];
    let second = vec![Point::new(1.0, 4.0), Point::new(1000.0, 5.0)];
    let mut figure = figure(vec![
        Curve::line("truth", first).measured(),
        Curve::line("a \"b\" <c>", second.clone()).dashed(),
        Curve::line("markers", second).with_markers().coloured(0),
    ]);
    figure.x = Axis::log("frequency").in_unit("Hz");
    let drawn = svg(&figure);
    let document = Document::parse(&drawn).unwrap();
    let numbers = numbers(&document);
    let series = numbers["series"].as_array().unwrap();
    assert_eq!(series[0]["x"], serde_json::json!([1.0, null, 100.0, 1000.0]));
    assert_eq!(series[0]["y"], serde_json::json!([2.0, null, 0.1234568, 7.0]));
    assert_eq!(series[0]["low"], serde_json::json!([1.5, null, null, null]));
    assert_eq!((&series[0]["stroke"], &series[1]["stroke"]), (&"wide".into(), &"dashed".into()));
    assert_eq!((&series[1]["name"], series[1]["low"].is_null()), (&"a \"b\" <c>".into(), true));
    assert_eq!(
        (&series[0]["colour"], &series[2]["colour"]),
        (&"#000000".into(), &"#0072B2".into())
    );
    // It has the places of the series before it.
    assert!(series[2]["x"].is_null() && series[2]["markers"] == true);
    assert_eq!((&numbers["x"]["log"], &numbers["x"]["unit"]), (&true.into(), &"Hz".into()));

    let edges: Vec<f64> =
        numbers["plot"].as_array().unwrap().iter().map(|edge| edge.as_f64().unwrap()).collect();
    let end = |axis: &str, end: &str| numbers[axis][end].as_f64().unwrap();
    let share = (5.0 - end("y", "low")) / (end("y", "high") - end("y", "low"));
    let y = edges[3] - share * (edges[3] - edges[1]);
    let share = (1000.0 / end("x", "low")).ln() / (end("x", "high") / end("x", "low")).ln();
    let x = edges[0] + share * (edges[2] - edges[0]);
    let line = lines(&document)[1].attribute("points").unwrap().to_owned();
    let last: Vec<f64> =
        line.split_whitespace().last().unwrap().split(',').map(|at| at.parse().unwrap()).collect();
    assert!(
        (last[0] / SCALE - x).abs() < 1.0 && (last[1] / SCALE - y).abs() < 1.0,
        "{last:?}, {x}, {y}"
    );

    assert!(numbers["bands"].is_null());
    let mut with_bands = figure.clone();
    let band = |from, label: &str| Band { from, to: 5.0, label: label.to_owned() };
    with_bands.bands = vec![band(2.0, "in distribution"), band(f64::NAN, "nowhere")];
    let drawn = svg(&with_bands);
    let told = self::numbers(&Document::parse(&drawn).unwrap());
    let expected = serde_json::json!([{"from": 2.0, "to": 5.0, "label": "in distribution"}]);
    assert_eq!(told["bands"], expected);

    // Ribbons, lines and the key of the legend: a script can hide all of a series.
    let groups = |place: &str| {
        document.descendants().filter(|node| node.attribute("data-series") == Some(place)).count()
    };
    assert_eq!([groups("0"), groups("1")], [2, 2]);
    let mut with_ribbon = figure;
    with_ribbon.series[0].points[2] = Point::with_interval(100.0, 3.0, 2.0, 4.0);
    with_ribbon.series[0].points[3] = Point::with_interval(1000.0, 3.0, 2.0, 4.0);
    let drawn = svg(&with_ribbon);
    assert_eq!(drawn.matches("data-series=\"0\"").count(), 3);
}
