use evaluation::control::{RobotTrials, summarize, tracking_figure};
use figures::Size;
use spec::ControlSpec;

use super::{controllers, simulation, table};
use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::evaluate::LoadedCheckpoint;

/// Combines the robots: writes `report.json`, `trials.csv`, `tracking.svg` and `tracking.csv`.
pub(super) fn report(attempt: &Attempt, spec: &ControlSpec) -> Result<(), TaskError> {
    let simulation = simulation(attempt, spec)?;
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec.checkpoints)?;
    let robots = trials(attempt)?;
    let report = summarize(spec, &simulation, controllers(spec, &checkpoints), &robots);
    attempt.put("report.json", "application/json", serde_json::to_vec_pretty(&report)?)?;
    attempt.put("trials.csv", "text/csv", table::trials_csv(&robots)?)?;
    let figure = tracking_figure(&report, &robots);
    attempt.put("tracking.svg", "image/svg+xml", figure.to_svg(Size::PAGE)?.into_bytes())?;
    attempt.put("tracking.csv", "text/csv", figure.to_csv().into_bytes())?;
    attempt.complete(&report)
}

/// The results of the tasks before this one, sorted by robot.
fn trials(attempt: &Attempt) -> Result<Vec<RobotTrials>, TaskError> {
    let tasks = attempt.wait(attempt.store.tasks(attempt.task.job))?;
    tasks
        .into_iter()
        .filter(|task| task.stage == 0)
        .filter_map(|task| task.result)
        .map(|result| Ok(serde_json::from_value(result)?))
        .collect()
}
