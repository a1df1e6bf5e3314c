//! Measures the latency of predictions: of one robot, one after the other. With a warm start each
//! prediction starts from the one before.

use std::time::Instant;

use models::{Sampling, WarmStart};
use serde::{Deserialize, Serialize};
use series::Observed;
use series::measured_quantile;
use spec::{EvaluateSpec, Start};
use wire::Latency;

use super::cell::{asked_about, scenarios};
use super::checkpoints::LoadedCheckpoint;
use super::predictors::{LearnedRun, Predictors, SHIFT};
use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::trajectories::TrajectorySource;

/// The result of the task, by predictor.
#[derive(Default, Serialize, Deserialize)]
pub(super) struct LatencyRecord {
    pub latencies: Vec<(String, Latency)>,
}

/// Number of predictions before the first timed one. Things that are made only once are made in
/// them.
const WARM_UP: usize = 3;

pub(super) fn latency(attempt: &Attempt, spec: &EvaluateSpec) -> Result<(), TaskError> {
    let data = TrajectorySource::open(attempt, &spec.data, spec.given)?;
    let checkpoints = LoadedCheckpoint::load_all(attempt, &spec.checkpoints)?;
    let cells = spec.cells(data.spec());
    let missing = || TaskError::Missing { what: "cell", name: "0".to_owned() };
    let mut cell = cells.into_iter().next().ok_or_else(missing)?;
    cell.count = 1;
    let recorded = scenarios(attempt, &data, spec, &cell)?;
    let (pre_roll, context) = (spec.rounds() as usize, spec.context as usize);
    let observed = asked_about(spec, &recorded).observed(pre_roll, context);
    // Windows in the order of time. After the last, the loop begins again with the first.
    let windows: Vec<Observed<'_>> = (0..=observed.pre_roll() / SHIFT)
        .rev()
        .filter_map(|back| observed.earlier(back * SHIFT))
        .collect();
    let repeats = spec.latency.unwrap_or_default().repeats as usize;
    let mut latencies = Vec::new();
    let predictors = Predictors::new(spec, data.spec(), &[], &checkpoints)?;
    let runs: Vec<&LearnedRun<'_>> = predictors
        .learned
        .iter()
        .filter(|predictor| !predictor.checkpoint.model.needs_leak())
        .collect();
    for (done, run) in (1_u64..).zip(&runs) {
        attempt.progress.say(format!("times {}", run.info.name));
        let load = load();
        let times_ms =
            attempt.interruptible(|| times_ms(attempt, spec, run, &windows, repeats))??;
        let latency = Latency {
            median_ms: measured_quantile(&times_ms, 0.5),
            p99_ms: measured_quantile(&times_ms, 0.99),
            repeats: repeats as u64,
            threads: rayon::current_num_threads() as u64,
            device: attempt.device.kind().to_string(),
            load,
        };
        let (predictor, median_ms) = (&run.info.name, latency.median_ms);
        tracing::info!(predictor, median_ms, repeats, load, "timed");
        latencies.push((run.info.name.clone(), latency));
        attempt.progress.set_done(attempt.task.total * done / runs.len() as u64);
    }
    attempt.complete(&LatencyRecord { latencies })
}

/// Latencies in ascending order.
fn times_ms(
    attempt: &Attempt,
    spec: &EvaluateSpec,
    learned: &LearnedRun<'_>,
    windows: &[Observed<'_>],
    repeats: usize,
) -> Result<Vec<f64>, TaskError> {
    let model = &learned.checkpoint.model;
    let start = learned.run.as_ref().map_or((Start::Cold, 0), |run| (run.start, run.steps));
    let mut times_ms = Vec::with_capacity(repeats);
    let mut previous: Option<Vec<f32>> = None;
    let mut asked = 0;
    while times_ms.len() < repeats {
        attempt.check_stop()?;
        let window = &windows[asked % windows.len()];
        asked += 1;
        let ask = |warm_start: Option<WarmStart>| match model.architecture().sampler() {
            None => model.predict(window),
            Some(_) => model.sample(window, &Sampling { warm_start, ..learned.sampling(spec, 0) }),
        };
        let warm_start = match (start, previous.take()) {
            ((Start::Cold, _), _) => None,
            // The start of a prediction does not change its latency. The truth is not known here,
            // so the oracle also starts from an earlier prediction.
            ((_, steps), Some(previous)) => Some(WarmStart { previous, shift: SHIFT, steps }),
            (_, None) => {
                previous = Some(ask(None)?);
                continue;
            }
        };
        let begin = Instant::now();
        let predicted = ask(warm_start)?;
        let time_ms = begin.elapsed().as_secs_f64() * 1e3;
        if asked > WARM_UP {
            times_ms.push(time_ms);
        }
        // The window after the last one is an earlier one, so its prediction cannot start from the
        // one before.
        let goes_on = asked % windows.len() != 0 || windows.len() == 1;
        previous = goes_on.then_some(predicted);
    }
    times_ms.sort_by(f64::total_cmp);
    Ok(times_ms)
}

/// Mean number of running threads on this machine over the last minute, where the system provides
/// it.
fn load() -> Option<f64> {
    std::fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}
