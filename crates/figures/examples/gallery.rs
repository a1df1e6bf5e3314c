//! Writes one SVG per kind of figure into the folder named on the command line.

use std::path::PathBuf;
use std::{env, fs, io};

use figures::{Axis, Band, Curve, Figure, Point, Size};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = env::args_os().nth(1).map(PathBuf::from);
    let folder = folder.ok_or_else(|| io::Error::other("usage: gallery FOLDER"))?;
    fs::create_dir_all(&folder)?;
    let narrow = Size { width: 360, height: 320 };
    let figures = [
        ("loss", loss(), Size::PAGE),
        ("loss-narrow", loss(), narrow),
        ("error", error_over_frequency(ten_predictors()), Size::PAGE),
        ("error-narrow", error_over_frequency(ten_predictors()), narrow),
        ("ribbons", ribbons(), Size::PAGE),
        ("one-frequency", one_frequency(), Size::PAGE),
        ("empty", Figure { series: Vec::new(), ..loss() }, Size::PAGE),
        ("hostile", hostile(), Size::PAGE),
    ];
    for (name, figure, size) in figures {
        fs::write(folder.join(format!("{name}.svg")), figure.to_svg(size)?)?;
        fs::write(folder.join(format!("{name}.csv")), figure.to_csv())?;
    }
    Ok(())
}

/// A reproducible number between -1 and 1.
fn jitter(i: u32) -> f64 {
    (f64::from(i) * 12.9898).sin() * (f64::from(i) * 78.233).cos()
}

fn loss() -> Figure {
    let curve = |i: u32, floor: f64| floor + (-f64::from(i) / 900.0).exp();
    let train = (0..12_000u32)
        .map(|i| Point::new(f64::from(i) * 10.0, curve(i, 0.002) * (0.4 * jitter(i)).exp()));
    let validation = (0..120u32).map(|i| {
        Point::new(f64::from(i) * 1000.0, curve(i * 100, 0.004) * (1.0 + 0.1 * jitter(i)))
    });
    Figure {
        title: "Loss".to_owned(),
        x: Axis::linear("optimizer step"),
        y: Axis::log("mean squared error"),
        series: vec![
            Curve::line("training", train.collect()),
            Curve::line("validation", validation.collect()).with_markers(),
        ],
        bands: Vec::new(),
    }
}

fn ten_predictors() -> Vec<Curve> {
    let names = [
        "diffusion transformer",
        "transformer",
        "GRU",
        "least squares per robot",
        "damped integrator",
        "hold last position",
        "a predictor whose name is far too long to be shown in any legend",
        "eighth",
        "ninth",
        "tenth",
    ];
    (0u32..)
        .zip(names)
        .map(|(i, name)| {
            let level = 0.004 * 1.7f64.powi(i32::try_from(i).unwrap_or(0));
            let points = (0..9u32).map(|k| {
                let frequency = 0.05 * 1.5f64.powi(i32::try_from(k).unwrap_or(0));
                let y = level * (1.0 + frequency * 2.0) * (1.0 + 0.2 * jitter(i * 9 + k));
                Point::with_interval(frequency, y, y * 0.86, y * 1.17)
            });
            let curve = Curve::line(name, points.collect()).with_markers();
            if (3..6).contains(&i) { curve.dashed() } else { curve }
        })
        .collect()
}

fn error_over_frequency(series: Vec<Curve>) -> Figure {
    Figure {
        title: "Error over excitation frequency, multisine, context 400, horizon 600".to_owned(),
        x: Axis::log("excitation frequency").in_unit("Hz"),
        y: Axis::log("RMSE of joint positions").in_unit("rad"),
        series,
        bands: vec![Band { from: 0.1, to: 0.3, label: "in distribution".to_owned() }],
    }
}

fn ribbons() -> Figure {
    let series = ten_predictors().into_iter().take(3);
    let lines = series.map(|curve| Curve { mark: figures::Mark::Line, ..curve });
    Figure {
        x: Axis::linear("excitation frequency").in_unit("Hz"),
        y: Axis::linear("RMSE of joint positions").in_unit("rad"),
        bands: vec![
            Band { from: 0.1, to: 0.1, label: "trained on 0.1 Hz".to_owned() },
            Band { from: 0.15, to: 0.25, label: "also trained".to_owned() },
        ],
        ..error_over_frequency(lines.collect())
    }
}

fn one_frequency() -> Figure {
    let single = |curve: Curve| Curve { points: curve.points[2..3].to_vec(), ..curve };
    error_over_frequency(ten_predictors().into_iter().take(4).map(single).collect())
}

fn hostile() -> Figure {
    let values = [1.0, 0.0, f64::NAN, -3.0, 1e-9, 1e140, f64::INFINITY, 2.0, 3.0];
    let points = (0u32..).zip(values).map(|(i, y)| Point::new(f64::from(i), y)).collect();
    Figure {
        title: "<script>alert('&')</script> \u{202E}\u{0} ]]>".to_owned(),
        x: Axis::linear("x \"quoted\" & <b>"),
        y: Axis::log("y"),
        series: vec![Curve::line("=HYPERLINK(\"x\"), <i>\nline", points)],
        bands: vec![Band { from: f64::NEG_INFINITY, to: 1.5, label: "<&>".to_owned() }],
    }
}
