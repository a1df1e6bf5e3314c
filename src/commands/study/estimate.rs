//! Estimates the cost of a study before it runs, by doing a little of everything on this machine.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt::{self, Display, Formatter};

use anyhow::{Context, bail};
use indicatif::BinaryBytes;
use models::TrainingMemory;
use reports::study::Plan;
use reports::{Align, Table};
use spec::{
    CheckpointRef, DataSource, EvaluateSpec, JobSpec, PipelineSpec, SimulateSpec, Start,
    StudyScale, TrainSpec,
};
use worker::{DeviceKind, TrainingTimes};

use crate::process::memory_bytes;

/// An estimate for every job.
#[derive(Debug)]
pub struct Estimate {
    scale: StudyScale,
    rows: Vec<Row>,
    available: Option<u64>,
}

#[derive(Debug)]
struct Row {
    job: String,
    what: String,
    seconds: f64,
    /// Highest resident memory in bytes.
    memory: Option<u64>,
    disk: u64,
}

/// Does a little of every kind of job in the plan on this machine.
///
/// # Errors
/// When a job itself would fail.
pub fn estimate(plan: &Plan, device: DeviceKind) -> anyhow::Result<Estimate> {
    let mut rehearsal = Rehearsal {
        pipeline: &plan.pipeline,
        device,
        trainings: BTreeMap::new(),
        simulations: BTreeMap::new(),
        baselines: BTreeMap::new(),
    };
    let mut rows = Vec::new();
    for name in plan.pipeline.order().context("jobs in a circle")? {
        let row = rehearsal.row(name, &plan.pipeline.jobs[name].spec);
        rows.push(row.with_context(|| format!("cannot estimate {name}"))?);
    }
    Ok(Estimate { scale: plan.scale, rows, available: memory_bytes() })
}

/// Measurements so far. Similar jobs are measured once.
struct Rehearsal<'a> {
    pipeline: &'a PipelineSpec,
    device: DeviceKind,
    /// Training times, by the spec without its data.
    trainings: BTreeMap<String, TrainingTimes>,
    /// Times of a trajectory, by the spec without numbers of robots and seeds.
    simulations: BTreeMap<String, f64>,
    /// Baselines' times, by name, context, samples and joints.
    baselines: BTreeMap<(spec::Baseline, u32, u32, usize), f64>,
}

impl Rehearsal<'_> {
    fn row(&mut self, name: &str, spec: &JobSpec) -> anyhow::Result<Row> {
        let row = |what: String, seconds: f64| Row {
            job: name.to_owned(),
            what,
            seconds,
            memory: None,
            disk: 0,
        };
        match spec {
            JobSpec::Simulate(spec) => {
                let seconds = self.simulation(spec)? * spec.trajectories as f64;
                let disk = spec.estimated_bytes();
                let row = row(format!("{} trajectories", spec.trajectories), seconds);
                Ok(Row { disk, ..row })
            }
            JobSpec::Train(spec) => {
                let data = self.data_of(spec)?;
                let memory = TrainingMemory::of(spec, data.samples, data.joints())?;
                let seconds = self.training(spec)?.step * spec.steps as f64;
                let what = format!(
                    "{} steps of {}, {:.1} M parameters",
                    spec.steps,
                    spec.batch_size,
                    memory.parameters as f64 / 1e6
                );
                // Weights and moments of each kept checkpoint, and of one more that is being
                // written.
                let disk = memory.parameters * 4 * 3 * u64::from(1 + spec.keep_checkpoints);
                Ok(Row { memory: Some(memory.peak_bytes), disk, ..row(what, seconds) })
            }
            JobSpec::Evaluate(spec) => {
                let (what, seconds) = self.evaluation(spec)?;
                Ok(row(what, seconds))
            }
            other => bail!("{} is not part of a study", other.kind()),
        }
    }

    fn simulation(&mut self, spec: &SimulateSpec) -> anyhow::Result<f64> {
        let one = SimulateSpec { seed: 0, trajectories: 1, ..spec.clone() };
        match self.simulations.entry(serde_json::to_string(&one)?) {
            Entry::Occupied(known) => Ok(*known.get()),
            Entry::Vacant(new) => Ok(*new.insert(worker::simulation_seconds(spec)?)),
        }
    }

    fn training(&mut self, spec: &TrainSpec) -> anyhow::Result<TrainingTimes> {
        let data = self.data_of(spec)?.clone();
        let sizes = (spec.batch_size, spec.context, data.samples);
        let key = serde_json::to_string(&(&spec.model, sizes))?;
        if let Some(times) = self.trainings.get(&key) {
            return Ok(*times);
        }
        eprintln!("trying {}", spec.model.architecture());
        let times = worker::training_times(spec, &data, self.device)?;
        self.trainings.insert(key, times);
        Ok(times)
    }

    /// Estimates the passes of networks, the baselines and the simulation. The time for measuring
    /// latencies is left out.
    fn evaluation(&mut self, spec: &EvaluateSpec) -> anyhow::Result<(String, f64)> {
        let data = self.simulation_of(&spec.data)?.clone();
        let scenarios = data.trajectories as f64;
        let mut seconds = self.simulation(&data)?;
        for &name in &spec.baselines {
            seconds += match self.baselines.entry((name, spec.context, data.samples, data.joints()))
            {
                Entry::Occupied(known) => *known.get(),
                Entry::Vacant(new) => {
                    *new.insert(worker::baseline_seconds(name, &data, spec.context)?)
                }
            };
        }
        let mut passes = 0.0;
        for checkpoint in &spec.checkpoints {
            let training = self.training_of(checkpoint)?.clone();
            let times = self.training(&training)?;
            let of_model = passes_per_scenario(spec, &training);
            passes += of_model;
            seconds += of_model * times.pass;
        }
        let what = format!("{scenarios} scenarios, {passes} passes each");
        Ok((what, seconds * scenarios))
    }

    fn training_of(&self, checkpoint: &CheckpointRef) -> anyhow::Result<&TrainSpec> {
        let name = checkpoint.job().context("a checkpoint from elsewhere")?;
        match self.pipeline.jobs.get(name).map(|member| &member.spec) {
            Some(JobSpec::Train(spec)) => Ok(spec),
            _ => bail!("{name} is no training of this pipeline"),
        }
    }

    /// The first data of a training. Others have the same shape.
    fn data_of<'a>(&'a self, training: &'a TrainSpec) -> anyhow::Result<&'a SimulateSpec> {
        self.simulation_of(training.data.each().first().context("a training without data")?)
    }

    fn simulation_of<'a>(&'a self, data: &'a DataSource) -> anyhow::Result<&'a SimulateSpec> {
        match data {
            DataSource::Stream(spec) => Ok(spec),
            DataSource::Job(name) => match self.pipeline.jobs.get(name).map(|job| &job.spec) {
                Some(JobSpec::Simulate(spec)) => Ok(spec),
                _ => bail!("{name} is no simulation of this pipeline"),
            },
            DataSource::Dataset(_) | DataSource::Digest(_) => bail!("data from elsewhere"),
        }
    }
}

/// Passes through a network per scenario, over all samples and ways of sampling.
fn passes_per_scenario(spec: &EvaluateSpec, training: &TrainSpec) -> f64 {
    let samples = f64::from(spec.samples);
    let model = &training.model;
    let Some((own, generation)) = model.sampler().zip(model.generation()) else { return samples };
    let all = own.steps.unwrap_or(generation.all_steps());
    let runs = spec.sampling_runs(&training.model);
    if runs.is_empty() {
        return samples * f64::from(all);
    }
    let of_run = |run: &spec::SamplingRun| match run.start {
        Start::Cold | Start::Oracle => f64::from(run.steps),
        // The first window starts cold, and the last one is scored.
        Start::Shifted => f64::from(all) + f64::from(spec.rounds()) * f64::from(run.steps),
    };
    samples * runs.iter().map(of_run).sum::<f64>()
}

impl Display for Estimate {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut table = Table::new([
            ("job", Align::Left),
            ("what", Align::Left),
            ("time", Align::Right),
            ("memory", Align::Right),
            ("disk", Align::Right),
        ]);
        let in_words = |bytes: u64| BinaryBytes(bytes).to_string();
        for row in &self.rows {
            let disk = if row.disk == 0 { String::new() } else { in_words(row.disk) };
            table.push(vec![
                row.job.clone(),
                row.what.clone(),
                duration(row.seconds),
                row.memory.map_or_else(String::new, in_words),
                disk,
            ]);
        }
        let seconds = self.rows.iter().map(|row| row.seconds).sum();
        let memory = self.rows.iter().filter_map(|row| row.memory).max().unwrap_or(0);
        let disk = self.rows.iter().map(|row| row.disk).sum();
        table.push(vec![
            "all".to_owned(),
            format!("scale {}, one job after the other", self.scale.name()),
            duration(seconds),
            in_words(memory),
            in_words(disk),
        ]);
        f.write_str(&table.render())?;
        match self.available {
            Some(available) if memory > available => writeln!(
                f,
                "memory: {} needed, {} here: it does not fit; a training's gradient_accumulation \
                 divides what its batch takes",
                in_words(memory),
                in_words(available)
            ),
            Some(available) => {
                writeln!(
                    f,
                    "memory: {} needed, {} here: it fits",
                    in_words(memory),
                    in_words(available)
                )
            }
            None => {
                writeln!(
                    f,
                    "memory: {} needed; this machine's memory is not known",
                    in_words(memory)
                )
            }
        }
    }
}

fn duration(seconds: f64) -> String {
    const DAY: f64 = 86_400.0;
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s if s < 2.0 * DAY => format!("{:.1} h", s / 3600.0),
        s => format!("{:.0} days", s / DAY),
    }
}
