//! The figure of one scenario with its predictions.

use figures::{Axis, Band, Curve, Figure, Point, SERIES_ALLOWED};
use series::SeriesView;
use wire::{DrawnScenario, PredictorKind, ScenarioRank, at_noise};

/// The predictions of one predictor, `[horizon, joint]`, rad.
pub struct DrawnAnswer {
    /// Name of the predictor.
    pub name: String,
    /// Kind of the predictor.
    pub kind: PredictorKind,
    /// The place of its colour in the palette.
    pub colour: usize,
    /// Positions of the horizon, `[sample, joint]`, rad.
    pub positions: Vec<f32>,
}

impl DrawnAnswer {
    /// RMSE of each joint over the horizon of `scenario`, the only robot there, in degrees.
    pub fn joint_rmse_deg(&self, scenario: &SeriesView<'_>, context: usize) -> Vec<f64> {
        let joints = scenario.joints();
        let truth = scenario.true_y(0);
        let rmse = |joint: usize| {
            let truth = truth.joint(joint).skip(context);
            let predicted = self.positions.iter().skip(joint).step_by(joints);
            let squares: Vec<f64> = truth
                .zip(predicted)
                .map(|(truth, predicted)| (f64::from(*predicted) - f64::from(truth)).powi(2))
                .collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt().to_degrees()
        };
        (0..joints).map(rmse).collect()
    }
}

/// The position of the joint that `drawn` names, beside predictions. `scenario` has one robot and begins with its context, of
/// which as many samples are shown as there are in the horizon. `answers` begins with the model by which the scenario was chosen.
pub fn prediction_figure(
    drawn: &DrawnScenario,
    scenario: &SeriesView<'_>,
    context: usize,
    answers: &[DrawnAnswer],
) -> Figure {
    let (joints, joint) = (scenario.joints(), drawn.joint - 1);
    let horizon = scenario.samples() - context;
    let first = context.saturating_sub(horizon);
    // The last sample of the context is at 0.
    let time = |sample: usize| (sample as f64 - (context as f64 - 1.0)) / scenario.rate_hz();
    let truth = scenario.true_y(0).joint(joint).enumerate().skip(first);
    let truth = truth.map(|(sample, q)| Point::new(time(sample), f64::from(q).to_degrees()));
    let mut series = vec![Curve::line("truth", truth.collect()).measured()];
    for answer in answers {
        let rmse_deg = answer.joint_rmse_deg(scenario, context)[joint];
        let positions = answer.positions.iter().skip(joint).step_by(joints).enumerate();
        let points = positions
            .map(|(step, q)| Point::new(time(context + step), f64::from(*q).to_degrees()))
            .collect();
        let line = Curve::line(format!("{}° {}", short(rmse_deg), answer.name), points)
            .coloured(answer.colour);
        let is_baseline = answer.kind == PredictorKind::Baseline;
        series.push(if is_baseline { line.dashed() } else { line });
    }
    series.truncate(SERIES_ALLOWED);
    let shown = context - first;
    let range = range(&series);
    Figure {
        title: title(drawn, answers.first().map_or("", |model| &model.name)),
        x: Axis::linear("Time since the end of the context").in_unit("s"),
        y: Axis {
            range,
            ..Axis::linear(format!("Position of joint {}", drawn.joint)).in_unit("deg")
        },
        series,
        bands: vec![Band {
            from: time(first),
            to: 0.0,
            label: match shown == context {
                true => "context".to_owned(),
                false => format!("context, last {shown} of {context} samples"),
            },
        }],
    }
}

fn title(drawn: &DrawnScenario, model: &str) -> String {
    let rank = match drawn.rank {
        ScenarioRank::Worst => "Worst",
        ScenarioRank::Median => "Median",
        ScenarioRank::Best => "Best",
    };
    let excitation = match (drawn.family, drawn.frequency_hz) {
        (Some(family), Some(frequency_hz)) => format!("{family} {frequency_hz} Hz, "),
        _ => String::new(),
    };
    let noise = at_noise(drawn.position_noise_rad);
    format!("{rank} scenario of {model}{noise}: {excitation}trajectory {}", drawn.trajectory)
}

/// The range of the truth and of the model with some room, where a baseline leaves it; otherwise the data decide.
fn range(series: &[Curve]) -> Option<(f64, f64)> {
    let extent = |series: &[Curve]| {
        let values = series.iter().flat_map(|curve| &curve.points).map(|point| point.y);
        values.filter(|y| y.is_finite()).fold(None, |extent: Option<(f64, f64)>, y| {
            let (low, high) = extent.unwrap_or((y, y));
            Some((low.min(y), high.max(y)))
        })
    };
    let (low, high) = extent(&series[..series.len().min(2)])?;
    let room = (high - low).max(1e-3);
    let (low, high) = (low - room, high + room);
    let (lowest, highest) = extent(series)?;
    (lowest < low || highest > high).then_some((lowest.max(low), highest.min(high)))
}

/// Two decimals, of small numbers four.
fn short(degrees: f64) -> String {
    if degrees >= 0.1 { format!("{degrees:.2}") } else { format!("{degrees:.4}") }
}

#[cfg(test)]
mod tests {
    use series::{Series, Shape};

    use super::*;

    /// Two joints: the first stays, the second moves by 0.01 rad per sample.
    fn motion() -> Series {
        let shape = Shape { robots: 1, samples: 10, joints: 2 };
        let y = (0..10_u8).flat_map(|sample| [0.0, f32::from(sample) * 0.01]).collect();
        Series::new(shape, 10.0, vec![0.0; 20], y).unwrap()
    }

    fn drawn() -> DrawnScenario {
        DrawnScenario {
            rank: ScenarioRank::Worst,
            figure: "prediction-worst.svg".to_owned(),
            family: Some(spec::Family::Chirp),
            frequency_hz: Some(0.5),
            position_noise_rad: 0.0,
            trajectory: 7,
            joint: 2,
            rmse_deg: 1.0,
        }
    }

    fn held(name: &str, kind: PredictorKind, value: f32) -> DrawnAnswer {
        DrawnAnswer { name: name.to_owned(), kind, colour: 0, positions: [0.0, value].repeat(4) }
    }

    #[test]
    fn the_end_of_the_context_is_marked_and_predictions_begin_after_it() {
        let motion = motion();
        let answers = [
            held("model", PredictorKind::Checkpoint, 0.07),
            held("far", PredictorKind::Baseline, 30.0),
        ];
        let figure = prediction_figure(&drawn(), &motion.view(), 6, &answers);
        assert_eq!(figure.title, "Worst scenario of model: chirp 0.5 Hz, trajectory 7");
        assert_eq!(
            (figure.bands[0].to, figure.bands[0].label.as_str()),
            (0.0, "context, last 4 of 6 samples")
        );
        let times =
            |k: usize| figure.series[k].points.iter().map(|point| point.x).collect::<Vec<_>>();
        assert_eq!(times(0), [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4]);
        assert_eq!(times(1), [0.1, 0.2, 0.3, 0.4]);
        // 0.01, 0, 0.01 and 0.02 rad.
        assert_eq!(figure.series[1].name, "0.70° model");
        let (low, high) = figure.y.range.unwrap();
        assert!(low > 0.0 && high < 20.0, "the motion is still seen: {low} to {high}");
        assert!(figure.to_svg(figures::Size::PAGE).is_ok());
    }

    #[test]
    fn errors_are_those_of_each_joint() {
        let motion = motion();
        let answer = held("model", PredictorKind::Checkpoint, 0.07);
        let rmse = answer.joint_rmse_deg(&motion.view(), 6);
        assert_eq!(rmse[0], 0.0);
        assert!((rmse[1] - 0.015_f64.sqrt().to_degrees() * 0.1).abs() < 1e-4, "{rmse:?}");
    }
}
