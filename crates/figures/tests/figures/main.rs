//! Properties of every drawing and its table, whatever the data.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

mod numbers;

use std::collections::BTreeSet;

use figures::{
    Axis, Band, Curve, Figure, FigureError, POINTS_DRAWN, Point, SERIES_ALLOWED, Scale, Size,
};
use roxmltree::{Document, Node};

use crate::numbers::numbers;

/// Units of the drawing per CSS pixel.
const SCALE: f64 = 4.0;

fn figure(series: Vec<Curve>) -> Figure {
    Figure {
        title: "Loss".to_owned(),
        x: Axis::linear("step"),
        y: Axis::linear("mean squared error").in_unit("rad²"),
        series,
        bands: Vec::new(),
    }
}

fn points(values: &[f64]) -> Vec<Point> {
    (0u32..).zip(values).map(|(i, y)| Point::new(f64::from(i), *y)).collect()
}

fn svg(figure: &Figure) -> String {
    figure.to_svg(Size::PAGE).unwrap()
}

fn named<'a, 'input>(
    document: &'a Document<'input>,
    tag: &'static str,
) -> impl Iterator<Item = Node<'a, 'input>> {
    document.descendants().filter(move |node| node.has_tag_name(tag))
}

fn texts(document: &Document) -> Vec<String> {
    named(document, "text").filter_map(|node| Some(node.text()?.trim().to_owned())).collect()
}

fn description(document: &Document) -> String {
    named(document, "desc").next().and_then(|node| node.text()).unwrap().to_owned()
}

fn attribute(node: Node, name: &str) -> f64 {
    node.attribute(name).unwrap().parse().unwrap()
}

/// The polylines of the series, which lie in the only nested `svg`.
fn lines<'a, 'input>(document: &'a Document<'input>) -> Vec<Node<'a, 'input>> {
    let data = named(document, "svg").nth(1).unwrap();
    data.descendants().filter(|node| node.has_tag_name("polyline")).collect()
}

#[test]
fn a_drawing_is_one_accessible_stretching_element_without_anything_foreign() {
    let drawn = svg(&figure(vec![Curve::line("training", points(&[3.0, 2.0, 1.0]))]));
    let document = Document::parse(&drawn).unwrap();
    let root = document.root_element();
    assert_eq!(root.attribute("role"), Some("img"));
    assert_eq!(root.attribute("viewBox"), Some("0 0 760 420"));
    assert_eq!(root.attribute("width"), Some("100%"));
    assert_eq!(named(&document, "title").next().and_then(|node| node.text()), Some("Loss"));
    assert_eq!(
        description(&document),
        "Line chart of mean squared error (rad²) over step. \
         training: 3 points, from 3 at 0 to 1 at 2, lowest 1, highest 3."
    );
    assert_eq!(named(&document, "script").count(), 0);
    let styles: Vec<Node> = named(&document, "style").collect();
    assert_eq!(
        styles.iter().map(|node| node.text()).collect::<Vec<_>>(),
        [Some(&*figures::style())]
    );
    for node in document.descendants() {
        assert!(node.attribute("id").is_none(), "ids collide when a page holds several drawings");
        assert!(node.attribute("style").is_none(), "a page's policy may forbid inline styles");
        assert!(node.attribute("href").is_none());
        if let Some(family) = node.attribute("font-family") {
            assert_eq!(family, "system-ui, sans-serif");
        }
    }
}

#[test]
fn every_colour_of_a_drawing_has_another_on_a_dark_page() {
    let series = |i: usize| {
        let marked = Curve::line(format!("series {i}"), points(&[3.0, 2.0, 1.0])).with_markers();
        if i.is_multiple_of(2) { marked.dashed() } else { marked }
    };
    let band = Band { from: 0.5, to: 1.5, label: "training".to_owned() };
    let figure = Figure { bands: vec![band], ..figure((0..9).map(series).collect()) };
    let empty = Figure { series: Vec::new(), ..figure.clone() };
    let style = figures::style();
    let mut found = BTreeSet::new();
    for drawn in [svg(&figure), svg(&empty)] {
        let document = Document::parse(&drawn).unwrap();
        for node in document.descendants() {
            for property in ["fill", "stroke"] {
                let Some(color) = node.attribute(property).filter(|color| *color != "none") else {
                    continue;
                };
                assert!(style.contains(&format!("[{property}=\"{color}\"]")), "{property} {color}");
                found.insert(color.to_owned());
            }
        }
    }
    assert!(found.len() > 10, "{found:?}");
}

#[test]
fn the_same_figure_gives_the_same_bytes() {
    let values: Vec<f64> = (0..5000).map(|i| f64::from(i).sin() + 2.0).collect();
    let figure = figure(vec![Curve::line("training", points(&values)).dashed()]);
    assert_eq!(svg(&figure), svg(&figure.clone()));
}

fn without_style(svg: &str) -> String {
    svg.lines()
        .filter(|line| !line.starts_with("<style>"))
        .map(|line| format!("{line}\n"))
        .collect()
}

#[test]
fn a_stack_holds_its_figures_one_below_the_other_as_they_are_alone() {
    let figures = [1.0, 2.0].map(|y| figure(vec![Curve::line("training", points(&[y, 3.0]))]));
    let drawn = figures::stacked("Two & more", &figures, Size::PAGE).unwrap();
    let document = Document::parse(&drawn).unwrap();
    let root = document.root_element();
    assert_eq!(root.attribute("viewBox"), Some("0 0 760 840"));
    let title = root.children().find(|node| node.has_tag_name("title")).unwrap();
    assert_eq!(title.text(), Some("Two & more"));
    assert_eq!(drawn.matches("<style>").count(), 1);
    let panels: Vec<Node> = root.children().filter(|node| node.has_tag_name("svg")).collect();
    assert_eq!(panels.iter().map(|panel| attribute(*panel, "y")).collect::<Vec<_>>(), [0.0, 420.0]);
    for (panel, figure) in panels.iter().zip(&figures) {
        // The stack has the colours of dark pages once, for all its figures.
        let alone = without_style(&svg(figure));
        let (_, within) = alone.split_once(">\n").unwrap();
        let (_, drawn) = drawn[panel.range()].split_once(">\n").unwrap();
        assert_eq!(drawn.trim_end(), within.trim_end());
    }
    // Labels of one figure need more space than those of the other.
    let figures = [1.0, 1e-7].map(|y| figure(vec![Curve::line("training", points(&[y, 3.0 * y]))]));
    let drawn = figures::stacked("", &figures, Size::PAGE).unwrap();
    let document = Document::parse(&drawn).unwrap();
    let panels = document.root_element().children().filter(|node| node.has_tag_name("svg"));
    let lefts: Vec<f64> = panels
        .map(|panel| panel.descendants().filter(|node| node.has_tag_name("svg")).nth(1).unwrap())
        .map(|data| attribute(data, "x"))
        .collect();
    assert!((lefts[0] - lefts[1]).abs() < f64::EPSILON, "{lefts:?}");
    let nowhere = Size { width: 1, height: 1 };
    assert!(matches!(
        figures::stacked("", &figures, nowhere),
        Err(FigureError::Size { width: 1, height: 1 })
    ));
}

#[test]
fn axes_legend_and_title_are_written() {
    let drawn = svg(&figure(vec![
        Curve::line("training", points(&[3.0, 2.0, 1.0])),
        Curve::line("validation", points(&[4.0, 3.0, 2.0])),
    ]));
    let texts = texts(&Document::parse(&drawn).unwrap());
    for expected in ["Loss", "step", "mean squared error (rad²)", "training", "validation", "0"] {
        assert!(texts.iter().any(|text| text == expected), "{expected:?} is missing in {texts:?}");
    }
}

/// Regression: an axis from -47 to 35 in a low panel had only one label, 0.
#[test]
fn a_low_axis_still_has_two_labels() {
    for (low, high) in [(-47.0, 35.0), (-35.0, 25.0), (0.9, 2.1), (-1e-4, 9e-4), (-99.0, 99.0)] {
        let figure = figure(vec![Curve::line("u", points(&[low, high]))]);
        let drawn = figure.to_svg(Size { width: 760, height: 200 }).unwrap();
        let document = Document::parse(&drawn).unwrap();
        // Labels of the vertical axis end at the axis.
        let labels =
            named(&document, "text").filter(|label| label.attribute("text-anchor") == Some("end"));
        assert!(labels.count() >= 2, "{low} to {high}: {:?}", texts(&document));
    }
}

#[test]
fn a_heading_that_is_too_long_keeps_its_unit() {
    let series = vec![Curve::line("a", points(&[1.0, 2.0]))];
    let y = Axis::linear("root mean squared error of the joint positions").in_unit("rad");
    let drawn = Figure { y, ..figure(series) }.to_svg(Size { width: 300, height: 220 }).unwrap();
    let texts = texts(&Document::parse(&drawn).unwrap());
    assert!(texts.iter().any(|text| text.starts_with("root") && text.ends_with("… (rad)")));
}

#[test]
fn points_that_are_not_finite_break_the_line_and_are_told() {
    let values = [1.0, 2.0, f64::NAN, 3.0, 4.0, f64::INFINITY, f64::NEG_INFINITY, 1.0, 2.0];
    let drawn = svg(&figure(vec![Curve::line("training", points(&values))]));
    assert!(!drawn.contains("NaN") && !drawn.contains("inf"));
    let document = Document::parse(&drawn).unwrap();
    assert_eq!(lines(&document).len(), 3);
    assert!(description(&document).contains("3 points not drawn: not finite or too large"));
}

#[test]
fn zero_on_a_logarithmic_axis_is_left_out_and_told() {
    let series = vec![Curve::line("training", points(&[1.0, 0.1, 0.0, 0.01, -1.0]))];
    let drawn = svg(&Figure { y: Axis::log("loss"), ..figure(series) });
    let document = Document::parse(&drawn).unwrap();
    assert_eq!(lines(&document).len(), 1);
    assert!(description(&document).contains("2 points not drawn: not positive on a logarithmic"));
}

#[test]
fn an_interval_below_a_logarithmic_axis_is_drawn_down_to_its_end() {
    let series = Curve::line("a", vec![Point::with_interval(1.0, 1.0, -1.0, 2.0)]).with_markers();
    let drawn = svg(&Figure { y: Axis::log("loss"), ..figure(vec![series]) });
    let document = Document::parse(&drawn).unwrap();
    let clip = named(&document, "svg").nth(1).unwrap();
    let bar = clip.descendants().find(|node| node.has_tag_name("line")).unwrap();
    assert!(attribute(bar, "y1") > attribute(clip, "y") + attribute(clip, "height"));
}

#[test]
fn a_figure_without_points_says_so() {
    let nothing = vec![
        figure(Vec::new()),
        figure(vec![Curve::line("training", Vec::new())]),
        figure(vec![Curve::line("training", points(&[f64::NAN]))]),
    ];
    for figure in nothing {
        let drawn = svg(&figure);
        let document = Document::parse(&drawn).unwrap();
        assert!(texts(&document).iter().any(|text| text == "no data yet"));
        assert!(description(&document).contains("No data yet."));
    }
}

#[test]
fn a_band_without_width_is_drawn_three_pixels_wide_and_named() {
    let bands = vec![Band { from: 1.0, to: 1.0, label: "in distribution".to_owned() }];
    for x in [Axis::linear("f"), Axis::log("f")] {
        let series = vec![Curve::line("a", points(&[1.0, 2.0, 3.0]))];
        let drawn = svg(&Figure { bands: bands.clone(), x, ..figure(series) });
        let document = Document::parse(&drawn).unwrap();
        let band = named(&document, "rect").nth(1).unwrap();
        assert!((attribute(band, "width") / SCALE - 3.0).abs() <= 0.25);
        assert!(texts(&document).iter().any(|text| text == "in distribution"));
    }
}

#[test]
fn a_band_with_infinite_ends_covers_the_plot_and_one_without_ends_is_not_drawn() {
    let label = String::new();
    let bands = vec![
        Band { from: f64::NEG_INFINITY, to: f64::INFINITY, label: label.clone() },
        Band { from: f64::NAN, to: 1.0, label },
    ];
    let series = vec![Curve::line("a", points(&[1.0, 2.0]))];
    let drawn = svg(&Figure { bands, ..figure(series) });
    let document = Document::parse(&drawn).unwrap();
    let rects: Vec<Node> = named(&document, "rect").skip(1).collect();
    assert_eq!(rects.len(), 1);
    assert!(attribute(rects[0], "width") > 600.0 * SCALE);
    assert!(description(&document).contains("is not drawn: it has no ends"));
}

/// Beside the plot, `2 10 11 12 18 1…ean of 7 seeds` stood for a group of runs.
#[test]
fn long_names_of_a_few_curves_are_whole_below_the_plot() {
    let name = |k: u32| format!("{k} train-lagrangian with a long name, mean of 7 runs, 3 seeds");
    let drawn = |count: u32| {
        let curves = (1..=count).map(|k| Curve::line(name(k), points(&[1.0, 2.0]))).collect();
        figure(curves).to_svg(Size::PAGE).unwrap()
    };
    let has = |drawn: &str, name: &str| {
        drawn.split("</text>").any(|before| before.trim_end().ends_with(name))
    };
    let few = drawn(3);
    assert!((1..=3).all(|k| has(&few, &name(k))), "{few}");
    // With many, the plot needs the height.
    assert!(!has(&drawn(12), &name(1)));
}

#[test]
fn the_legend_never_lies_on_the_plot() {
    let many = |count: usize| {
        (0..count)
            .map(|i| Curve::line(format!("predictor with number {i}"), points(&[1.0, 2.0])))
            .collect::<Vec<_>>()
    };
    for count in [1, 2, 6, SERIES_ALLOWED] {
        for size in [Size::PAGE, Size { width: 240, height: 200 }, Size { width: 400, height: 600 }]
        {
            let drawn = figure(many(count)).to_svg(size).unwrap();
            let document = Document::parse(&drawn).unwrap();
            let plot = named(&document, "svg").nth(1).unwrap();
            let (right, bottom) = (
                attribute(plot, "x") + attribute(plot, "width"),
                attribute(plot, "y") + attribute(plot, "height"),
            );
            assert!(attribute(plot, "height") >= 40.0 * SCALE, "{count} series in {size:?}");
            for text in named(&document, "text") {
                if !text.text().unwrap().contains("predictor") {
                    continue;
                }
                let (x, y) = (attribute(text, "x"), attribute(text, "y"));
                assert!(x > right || y > bottom, "{count} series in {size:?}");
                assert!(y < f64::from(size.height) * SCALE, "{count} series in {size:?}");
            }
        }
    }
}

#[test]
fn hostile_text_stays_text() {
    let hostile = "</text><script>alert(\"&'\")</script>\u{0}\u{1b}\u{202E}\u{FFFE}";
    let mut figure = figure(vec![Curve::line(hostile, points(&[1.0, 2.0]))]);
    figure.title = hostile.to_owned();
    figure.x = Axis::linear(hostile).in_unit(hostile);
    figure.bands.push(Band { from: 0.0, to: 1.0, label: hostile.to_owned() });
    let drawn = svg(&figure);
    let document = Document::parse(&drawn).unwrap();
    assert_eq!(named(&document, "script").count(), 0);
    assert!(drawn.chars().all(|c| c == '\n' || !c.is_control()));
    assert!(!drawn.contains(['\u{202E}', '\u{FFFE}']));
    assert!(numbers(&document)["series"][0]["name"].as_str().unwrap().starts_with("</text>"));
    assert!(texts(&document).iter().any(|text| text.starts_with("</text><script>alert(")));
}

#[test]
fn extreme_values_are_drawn_within_the_canvas() {
    let extremes: [&[f64]; 8] = [
        &[f64::MAX, f64::MIN, 0.0],
        &[1e119, -1e119],
        &[f64::MIN_POSITIVE, 1e-300],
        &[5e-324],
        &[1e16, 1e16 + 2.0],
        &[1.0, 1.0 + f64::EPSILON],
        &[0.0, 0.0],
        &[-0.0],
    ];
    for values in extremes {
        for scale in [Scale::Linear, Scale::Log] {
            let axis = Axis { scale, ..Axis::linear("v") };
            let across = values.iter().map(|v| Point::new(*v, *v)).collect();
            let figure =
                Figure { x: axis.clone(), y: axis, ..figure(vec![Curve::line("a", across)]) };
            let drawn = svg(&figure);
            assert!(!drawn.contains("NaN"), "{values:?}");
            for line in lines(&Document::parse(&drawn).unwrap()) {
                for pair in line.attribute("points").unwrap().split_whitespace() {
                    let (x, y) = pair.split_once(',').unwrap();
                    let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
                    assert!((0.0..=760.0 * SCALE).contains(&x), "{values:?} at x {x}");
                    assert!((0.0..=420.0 * SCALE).contains(&y), "{values:?} at y {y}");
                }
            }
        }
    }
}

#[test]
fn a_long_series_is_decimated_in_the_drawing_but_not_in_the_table() {
    let values: Vec<f64> = (0..50_000).map(|i| f64::from(i % 100)).collect();
    let figure = figure(vec![Curve::line("training", points(&values))]);
    let drawn = svg(&figure);
    let document = Document::parse(&drawn).unwrap();
    let vertices: usize = lines(&document)
        .iter()
        .map(|line| line.attribute("points").unwrap().split_whitespace().count())
        .sum();
    assert!((POINTS_DRAWN / 2..=POINTS_DRAWN).contains(&vertices), "{vertices} points are drawn");
    assert!(description(&document).contains("50000 points"));
    assert_eq!(figure.to_csv().lines().count(), 50_001);
}

#[test]
fn intervals_are_ribbons_of_lines_and_bars_of_markers() {
    let with_intervals =
        vec![Point::with_interval(1.0, 2.0, 1.5, 2.5), Point::with_interval(2.0, 3.0, 2.5, 3.5)];
    let ribbon = svg(&figure(vec![Curve::line("a", with_intervals.clone())]));
    let bars = svg(&figure(vec![Curve::line("a", with_intervals).with_markers()]));
    let count = |drawn: &str, tag: &'static str| {
        let document = Document::parse(drawn).unwrap();
        let data = named(&document, "svg").nth(1).unwrap();
        data.descendants().filter(|node| node.has_tag_name(tag)).count()
    };
    assert_eq!((count(&ribbon, "polygon"), count(&ribbon, "line")), (1, 0));
    assert_eq!((count(&bars, "polygon"), count(&bars, "line")), (0, 6));
}

#[test]
fn baselines_are_dashed() {
    let series = Curve::line("hold last", points(&[1.0, 2.0]));
    let dashes = |figure: &Figure| svg(figure).matches("stroke-dasharray").count();
    // One is on the plot, and one in the legend.
    assert_eq!(dashes(&figure(vec![series.clone().dashed()])), 2);
    assert_eq!(dashes(&figure(vec![series])), 0);
}

#[test]
fn samples_are_pale_and_not_in_the_legend() {
    let series = |name: &str| Curve::line(name, points(&[1.0, 2.0]));
    let drawn =
        svg(&figure(vec![series("mean").faint(), series("mean"), series("truth").measured()]));
    let document = Document::parse(&drawn).unwrap();
    let keys: Vec<_> = document
        .descendants()
        .filter(|node| node.attribute("class") == Some("key"))
        .map(|node| node.attribute("data-series").unwrap())
        .collect();
    assert_eq!(keys, ["1", "2"]);
    assert_eq!(lines(&document).len(), 3);
}

#[test]
fn what_is_outside_the_axis_range_is_clipped() {
    let mut figure = figure(vec![Curve::line("a", points(&[0.0, 1e9, 0.5]))]);
    figure.y.range = Some((0.0, 1.0));
    let drawn = svg(&figure);
    let document = Document::parse(&drawn).unwrap();
    let plot = named(&document, "svg").nth(1).unwrap();
    assert!(plot.attribute("viewBox").is_some());
    assert!(texts(&document).iter().any(|text| text == "1.0"));
}

#[test]
fn impossible_requests_are_refused_with_what_is_allowed() {
    let mut reversed = figure(Vec::new());
    reversed.y.range = Some((1.0, 0.0));
    let mut from_zero = figure(Vec::new());
    from_zero.y = Axis { range: Some((0.0, 1.0)), ..Axis::log("loss") };
    for figure in [reversed, from_zero] {
        let refused = figure.to_svg(Size::PAGE);
        assert!(matches!(refused, Err(FigureError::Range { .. })), "{refused:?}");
    }
    let tiny = figure(Vec::new()).to_svg(Size { width: 10, height: 10 }).unwrap_err();
    assert_eq!(
        tiny.to_string(),
        "a figure cannot be 10 x 10 px; allowed are 240 to 4096 x 200 to 4096 px"
    );
    let crowd = vec![Curve::line("a", Vec::new()); SERIES_ALLOWED + 1];
    let refused = figure(crowd).to_svg(Size::PAGE).unwrap_err();
    assert_eq!(refused.to_string(), "a figure cannot have 33 series; at most 32 are allowed");
}

#[test]
fn the_table_holds_every_number_as_it_is() {
    let figure = figure(vec![
        Curve::line(
            "plain",
            vec![
                Point::with_interval(1000.0, 0.1, 1e-7, 0.30000000000000004),
                Point::new(-1.5, f64::NAN),
                Point::new(f64::INFINITY, f64::NEG_INFINITY),
            ],
        ),
        Curve::line("with, comma and \"quote\"", vec![Point::new(0.0, 1e300)]),
        Curve::line("=1+1", vec![Point::new(0.0, 1.0)]),
    ]);
    assert_eq!(
        figure.to_csv(),
        "series,step,mean squared error (rad²),low,high\n\
         plain,1000,0.1,1e-7,0.30000000000000004\n\
         plain,-1.5,NaN,,\n\
         plain,inf,-inf,,\n\
         \"with, comma and \"\"quote\"\"\",0,1e300,,\n\
         '=1+1,0,1,,\n"
    );
}
