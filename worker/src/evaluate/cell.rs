//! Evaluates one cell: asks every predictor about its scenarios, and stores the errors.

use std::time::Instant;

use evaluation::metrics::{band_edge_hz, highest_component_hz, occupied_band_hz};
use evaluation::{
    CellResult, ErrorHorizon, HoldLast, Predictor as _, PredictorErrors, Scoring, Simulated,
    evaluate_cell, measured_jitter_deg, measured_left_limits, within_torque_limits,
};
use models::{ModelError, context_warnings};
use serde::{Deserialize, Serialize};
use series::{Observed, Series, SeriesView};
use spec::{Baseline, DataSpec, EvaluateSpec, Given, Observations, ScenarioCell, SimulateSpec};
use wire::Warning;

use super::checkpoints::LoadedCheckpoint;
use super::pace;
use super::predictions::PredictionFile;
use super::predictors::Predictors;
use super::rows;
use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::stream::Stream;
use crate::trajectories::TrajectorySource;

/// The result of a cell's task, without the values in its table.
#[derive(Serialize, Deserialize)]
pub(super) struct CellRecord {
    #[serde(flatten)]
    pub result: CellResult,
    /// The place of its table: the run of the job that evaluated it, which may be another job.
    pub table: TableAt,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct TableAt {
    pub run: i64,
    pub artifact: String,
}

pub(super) fn cell(attempt: &Attempt, spec: &EvaluateSpec, index: usize) -> Result<(), TaskError> {
    let data = TrajectorySource::open(attempt, &spec.data, spec.given)?;
    let cells = spec.cells(data.spec());
    let missing = || TaskError::Missing { what: "cell", name: index.to_string() };
    let cell = cells.get(index).ok_or_else(missing)?;
    let recorded = scenarios(attempt, &data, spec, cell)?;
    let scenarios = asked_about(spec, &recorded);
    let total = scenarios.robots() as u64;
    if total != attempt.task.total {
        // Recordings that were imported after the submission are counted only now.
        attempt.wait(attempt.store.set_total(attempt.fence(), total))?;
    }
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec.checkpoints)?;
    attempt.check_stop()?;

    let (pre_roll, context) = (spec.rounds() as usize, spec.context as usize);
    let band_edge_hz = band_edge(data.spec(), cell, &scenarios, pre_roll + context);
    let samples = spec.samples as usize;
    let limits_rad = data.spec().limits_rad();
    let horizon = scenarios.samples() - pre_roll - context;
    let horizons = ErrorHorizon::all(&spec.horizons_s, scenarios.rate_hz(), horizon);
    let given = spec.given;
    let scoring = Scoring { pre_roll, context, samples, band_edge_hz, given, limits_rad, horizons };
    let files = PredictionFile::open_all(attempt, spec)?;
    let given = |file: &PredictionFile| file.answer(spec, &data, &scenarios, cell.first);
    let given = files.iter().map(given).collect::<Result<Vec<_>, TaskError>>()?;
    let predictors = Predictors::new(spec, data.spec(), &files, &checkpoints)?;
    let simulated = simulated(attempt, &data, spec, cell, scenarios.robots())?;
    let asked = predictors.of_cell(&scenarios, cell.first, given, simulated.as_ref());
    let mut errors = Vec::with_capacity(asked.len());
    tracing::info!(
        cell = index,
        scenarios = scenarios.robots(),
        predictors = asked.len(),
        "asks predictors"
    );
    attempt.progress.expect(pace::of(attempt.task.job));
    for (number, predictor) in (1_u64..).zip(asked.chunks(1)) {
        let began = Instant::now();
        for asked_now in predictor {
            let name = asked_now.name();
            attempt.progress.say(format!("predictor {number} of {}: {name}", asked.len()));
        }
        let found = attempt.interruptible(|| evaluate_cell(&scenarios, &scoring, predictor))?;
        for PredictorErrors { predictor, rmse_deg, .. } in &found {
            let unanswered = rmse_deg.iter().filter(|rmse| rmse.is_none()).count();
            let seconds = began.elapsed().as_secs_f64();
            tracing::info!(predictor, unanswered, seconds, "answered");
        }
        errors.extend(found);
        attempt.progress.set_done(total * number / asked.len() as u64);
    }
    pace::keep(attempt.task.job, total, attempt.progress.seconds());
    let mut result = CellResult {
        cell: index,
        family: cell.excitation.map(|(family, _)| family),
        frequency_hz: cell.excitation.map(|(_, frequency_hz)| frequency_hz),
        position_noise_rad: cell.position_noise_rad,
        first: cell.first,
        joints: scenarios.joints(),
        horizons_s: scoring.horizons.iter().map(|horizon| horizon.seconds).collect(),
        predictors: errors,
        measured_jitter_deg: measured_jitter_deg(&scenarios, &scoring),
        measured_left_limits: measured_left_limits(&scenarios, &scoring),
        within_torque_limits: match spec.given {
            Given::Torques => within_torque_limits(&scenarios, &data.spec().limits_nm()),
            // A controller has kept its own limits.
            Given::References => Vec::new(),
        },
        warnings: Vec::new(),
    };
    let observed = scenarios.observed(pre_roll, context);
    result.warnings = warnings(&checkpoints, spec, &observed, &result.predictors)?;
    let seed = data.spec().simulation().map(|spec| spec.seed);
    let artifact = format!("cell-{index:03}.parquet");
    let table = vec![rows::record_batch(&result, &result.horizons_s, seed)?];
    let footer = rows::footer(&attempt.task.spec, scenarios.joints(), &result.horizons_s);
    let written = attempt.store.put_table(attempt.fence(), &artifact, table, &footer);
    let run = attempt.wait(written)?.0;
    attempt.complete(&CellRecord { result, table: TableAt { run, artifact } })
}

/// Warnings about the contexts, about each checkpoint that knows its training, and about predictors
/// that hold the last position.
fn warnings(
    checkpoints: &[LoadedCheckpoint],
    spec: &EvaluateSpec,
    observed: &Observed<'_>,
    predictors: &[PredictorErrors],
) -> Result<Vec<Warning>, ModelError> {
    let mut warnings = context_warnings(observed);
    let holds = predictors.iter().filter(|errors| !errors.held.is_empty());
    for errors in holds.filter(|errors| errors.predictor != HoldLast.name()) {
        warnings.push(Warning::held(errors.held.len() as u64).of(&errors.predictor));
    }
    for checkpoint in checkpoints {
        if checkpoint.was_trained_on(&spec.data) {
            let scenarios = observed.robots() as u64;
            warnings.push(Warning::training_data(scenarios).of(&checkpoint.info.name));
        }
        let found = checkpoint.model.warnings(observed)?;
        warnings.extend(found.into_iter().map(|warning| warning.of(&checkpoint.info.name)));
    }
    Ok(warnings)
}

/// The trajectories of a cell, or as many as there are. The positions of their contexts have the
/// cell's noise. The torques of the horizon are planned, so they have none.
pub(super) fn scenarios(
    attempt: &Attempt,
    data: &TrajectorySource,
    spec: &EvaluateSpec,
    cell: &ScenarioCell,
) -> Result<Series, TaskError> {
    let end = data.count().map_or(cell.first + cell.count, |all| all.min(cell.first + cell.count));
    let mut recorded = data.read(attempt, cell.first..end)?;
    let known = (spec.rounds() + spec.context) as usize;
    let level = cell.position_noise_rad;
    dynamics::add_position_noise(&mut recorded, level, known, spec.seed, cell.first);
    recorded.plan_from(known);
    Ok(recorded)
}

/// Simulates a cell's first `count` scenarios again, because a dataset need not have velocities. The
/// result is `None` unless a baseline needs it.
pub(super) fn simulated(
    attempt: &Attempt,
    data: &TrajectorySource,
    spec: &EvaluateSpec,
    cell: &ScenarioCell,
    count: usize,
) -> Result<Option<Simulated>, TaskError> {
    let asks = |name| spec.baselines.contains(&name);
    let is_needed = asks(Baseline::Oracle)
        || (spec.given == Given::References && asks(Baseline::NominalSimulator));
    let (true, Some(simulation)) = (is_needed, data.spec().simulation()) else {
        return Ok(None);
    };
    let observations = Observations { joint_velocities: true, ..simulation.observations };
    let simulation = SimulateSpec { observations, ..simulation.clone() };
    let simulated =
        Stream::new(&simulation).trajectories(attempt, cell.first..cell.first + count as u64)?;
    let joints = simulated.series.joints();
    let known = (spec.rounds() + spec.context) as usize;
    let velocities = simulated.qd.unwrap_or_default();
    let of_robot = |robot: usize| {
        let at = (robot * simulated.series.samples() + known - 1) * joints;
        velocities[at..at + joints].iter().copied().map(f64::from).collect()
    };
    let velocities = (0..simulated.scenarios.len()).map(of_robot).collect();
    Ok(Some(Simulated { spec: simulation, scenarios: simulated.scenarios, velocities }))
}

/// The samples of trajectories that an evaluation uses: pre-roll, context and horizon.
pub(super) fn asked_about<'a>(spec: &EvaluateSpec, recorded: &'a Series) -> SeriesView<'a> {
    let samples = u32::try_from(recorded.samples()).unwrap_or(u32::MAX);
    let end = spec.rounds() + spec.context + spec.horizon(samples);
    recorded.view().window(0..end as usize)
}

/// The frequency above which torques count as jitter. It lies above the cell's excitation or, where
/// that is not known, above the torques' own spectrum.
fn band_edge(
    data: &DataSpec,
    cell: &ScenarioCell,
    scenarios: &SeriesView<'_>,
    known: usize,
) -> Option<f64> {
    let (recorded, rate_hz) = (scenarios.samples(), scenarios.rate_hz());
    let of_family =
        data.simulation().zip(cell.excitation).and_then(|(spec, (family, frequency_hz))| {
            let duration_s = recorded as f64 / rate_hz;
            highest_component_hz(&spec.excitation, family, frequency_hz, duration_s)
        });
    let highest = of_family.or_else(|| occupied_band_hz(scenarios));
    band_edge_hz(highest?, recorded - known, rate_hz)
}
