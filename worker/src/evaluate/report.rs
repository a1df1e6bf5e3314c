use evaluation::{
    CellResult, NominalArm, PredictorInfo, PredictorKind, Setting, rmse_figure, summarize,
};
use figures::Size;
use spec::EvaluateSpec;
use store::NewArtifact;

use super::checkpoints::LoadedCheckpoint;
use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::trajectories::TrajectorySource;

/// Puts the cells together: `report.json`, `rmse.svg`, `rmse.csv`.
pub(crate) fn report(attempt: &Attempt) -> Result<(), TaskError> {
    let spec: EvaluateSpec = attempt.spec()?;
    let data = TrajectorySource::open(attempt, &spec.data)?;
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec)?;
    let cells = cell_results(attempt)?;

    let arm = NominalArm::of(data.spec());
    let baselines = spec.baselines.iter().map(|&baseline| PredictorInfo {
        name: evaluation::baseline(baseline, &arm).name().to_owned(),
        kind: PredictorKind::Baseline,
        digest: None,
        normalization: None,
        sampling: None,
        latency: None,
    });
    let learned = checkpoints.iter().map(|checkpoint| checkpoint.info.clone());
    let setting = Setting {
        context: spec.context,
        samples: data.spec().samples(),
        rate_hz: data.spec().rate_hz(),
        seed: data.spec().simulation().map(|spec| spec.seed),
        bootstrap: spec.bootstrap,
        predictors: baselines.chain(learned).collect(),
        trained_on: checkpoints.iter().map(|checkpoint| checkpoint.trained_on.clone()).collect(),
    };
    let report = summarize(setting, &cells)?;

    let report_json = serde_json::to_value(&report)?;
    put(attempt, "report.json", "application/json", serde_json::to_vec_pretty(&report)?)?;
    if let Some(cell) = report.cells.first() {
        let figure = rmse_figure(&report, cell.family);
        put(attempt, "rmse.svg", "image/svg+xml", figure.to_svg(Size::PAGE)?.into_bytes())?;
        put(attempt, "rmse.csv", "text/csv", figure.to_csv().into_bytes())?;
    }
    attempt.wait(attempt.store.complete(attempt.fence(), Some(&report_json)))?;
    Ok(())
}

/// The results of the tasks before this one, by cell.
fn cell_results(attempt: &Attempt) -> Result<Vec<CellResult>, TaskError> {
    let tasks = attempt.wait(attempt.store.tasks(attempt.task.job))?;
    tasks
        .into_iter()
        .filter(|task| task.stage == 0)
        .filter_map(|task| task.result)
        .map(|result| Ok(serde_json::from_value(result)?))
        .collect()
}

fn put(attempt: &Attempt, name: &str, media_type: &str, bytes: Vec<u8>) -> Result<(), TaskError> {
    let artifact = NewArtifact { name, media_type, bytes: bytes.into() };
    attempt.wait(attempt.store.put_artifact(attempt.fence(), artifact))?;
    Ok(())
}
