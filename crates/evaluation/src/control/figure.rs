//! Figures of robots that follow reference paths.

use figures::{Axis, Curve, Figure, FigureError, Point, Size, stacked};
use wire::ControlReport;

use super::trial::{RobotTrials, Trace};

/// Tracking error over time: at each sample, the mean over robots of controllers that did not fail.
pub fn tracking_figure(report: &ControlReport, robots: &[RobotTrials]) -> Figure {
    let names: Vec<&str> =
        report.controllers.iter().map(|controller| controller.info.name.as_str()).collect();
    let series =
        report.controllers.iter().filter(|summary| summary.failed == 0).map(|controller| {
            let name = &controller.info.name;
            let errors: Vec<&[f64]> = robots
                .iter()
                .flat_map(|robot| &robot.trials)
                .filter(|trial| trial.controller == *name)
                .map(|trial| trial.error_deg.as_slice())
                .collect();
            let points = (0..report.steps as usize).filter_map(|step| {
                let at: Option<Vec<f64>> =
                    errors.iter().map(|errors| errors.get(step).copied()).collect();
                let at = at.filter(|at| !at.is_empty())?;
                let mean = at.iter().sum::<f64>() / at.len() as f64;
                Some(Point::new((step + 1) as f64 / report.rate_hz, mean))
            });
            Curve::line(name, points.collect()).of_predictor(name, &names)
        });
    Figure {
        title: "Tracking error in closed loop".to_owned(),
        x: Axis::linear("Time since control began").in_unit("s"),
        y: Axis::log("RMS over joints, mean over robots").in_unit("deg"),
        series: series.collect(),
        bands: Vec::new(),
    }
}

/// The positions of three joints with their paths, one panel each: the first joint, one in the
/// middle and the last. `traces` has one trace for each controller.
///
/// # Errors
/// Those of [`figures::stacked`].
pub fn robot_figure(
    robot: u64,
    rate_hz: f64,
    traces: &[(String, Trace)],
) -> Result<String, FigureError> {
    let over_time = |degrees: &mut dyn Iterator<Item = f64>| -> Vec<Point> {
        let times = (1_u32..).map(|step| f64::from(step) / rate_hz);
        times.zip(degrees).map(|(time, degrees)| Point::new(time, degrees)).collect()
    };
    let joints = traces.iter().flat_map(|(_, trace)| trace.path.first()).map(|q| q.len()).max();
    let last = joints.unwrap_or(1) - 1;
    let mut shown = vec![0, last / 2, last];
    shown.dedup();
    let names: Vec<&str> = traces.iter().map(|(name, _)| name.as_str()).collect();
    let panels = shown.into_iter().map(|joint| {
        let longest = traces.iter().map(|(_, trace)| &trace.path).max_by_key(|path| path.len());
        let path = longest.map(|path| {
            let points = over_time(&mut path.iter().map(|q| q[joint].to_degrees()));
            Curve::line("path", points).measured()
        });
        let followed = traces.iter().map(|(name, trace)| {
            let degrees = trace.positions.iter().map(|q| f64::from(q[joint]).to_degrees());
            Curve::line(name, over_time(&mut { degrees })).of_predictor(name, &names)
        });
        Figure {
            title: format!("Joint {}", joint + 1),
            x: Axis::linear("Time since control began").in_unit("s"),
            y: Axis::linear("Position").in_unit("deg"),
            series: path.into_iter().chain(followed).collect(),
            bands: Vec::new(),
        }
    });
    let size = Size { width: 760, height: 260 };
    stacked(&format!("Robot {robot} in closed loop"), &panels.collect::<Vec<_>>(), size)
}

#[cfg(test)]
mod tests {
    use figures::Stroke;
    use serde_json::json;

    use super::super::trial::Trial;
    use super::*;

    /// The colour of a controller was that of its place in the job.
    #[test]
    fn a_controller_has_the_colour_of_its_predictor_in_evaluations() {
        let names = ["zero-torque", "oracle", "lagrangian", "robomorph"];
        let controllers: Vec<_> = names
            .iter()
            .map(|name| {
                let kind = if figures::is_baseline(name) { "baseline" } else { "checkpoint" };
                json!({"name": name, "kind": kind, "failed": 0})
            })
            .collect();
        let report = json!({"robots": 1, "steps": 2, "rate_hz": 60.0, "context": 10, "bootstrap": {},
            "controllers": controllers, "paired": []});
        let report: ControlReport = serde_json::from_value(report).unwrap();
        let trial = |name: &&str| Trial {
            controller: (*name).to_owned(),
            tracking: None,
            failure: None,
            error_deg: vec![1.0, 2.0],
            plan_ms: Vec::new(),
        };
        let robot = RobotTrials {
            robot: 0,
            joints: 7,
            threads: 1,
            trials: names.iter().map(trial).collect(),
            warnings: Vec::new(),
        };
        let figure = tracking_figure(&report, &[robot]);
        let colours: Vec<Option<usize>> = figure.series.iter().map(|curve| curve.colour).collect();
        let expected = names.map(|name| Some(figures::predictor_colour(name, &[])));
        assert_eq!(colours, expected);
        let dashed = [Stroke::Dashed, Stroke::Dashed, Stroke::Solid, Stroke::Solid];
        assert!(figure.series.iter().map(|curve| curve.stroke).eq(dashed));
    }
}
