use std::collections::VecDeque;
use std::time::Instant;

use models::StepReport;
use store::Metric;

use crate::attempt::Attempt;
use crate::error::TaskError;

/// Largest number of recorded values per metric over a whole training.
const RECORDED_STEPS: u64 = 2000;
/// Seconds between two writes of metrics.
const RECORD_INTERVAL: f32 = 1.0;
/// Number of steps over which the pace is averaged.
const PACE_STEPS: usize = 50;

/// Collects metrics and writes them to the store in batches.
pub(super) struct Recorder<'a> {
    attempt: &'a Attempt,
    pending: Vec<Metric>,
    written: Instant,
    /// Metrics of every `every`-th step are recorded.
    every: u64,
    /// The end time of each of the last steps, with its number of trajectories.
    recent: VecDeque<(Instant, usize)>,
}

impl<'a> Recorder<'a> {
    pub fn new(attempt: &'a Attempt, steps: u64) -> Self {
        Self {
            attempt,
            pending: Vec::new(),
            written: Instant::now(),
            every: steps.div_ceil(RECORDED_STEPS),
            recent: VecDeque::new(),
        }
    }

    pub fn add(&mut self, key: &str, step: u64, value: f64) {
        self.pending.push(Metric { key: key.to_owned(), step, value });
    }

    /// Records a step on this many trajectories that began at `began`, and the mean pace of the
    /// last steps.
    pub fn step(&mut self, report: &StepReport, trajectories: usize, began: Instant) {
        self.recent.push_back((Instant::now(), trajectories));
        if self.recent.len() > PACE_STEPS {
            self.recent.pop_front();
        }
        let step = report.step;
        if step != 1 && !step.is_multiple_of(self.every) {
            return;
        }
        self.add("train/loss", step, report.loss);
        self.add("train/gradient_norm", step, report.gradient_norm);
        self.add("train/learning_rate", step, report.learning_rate);
        self.add("train/seconds_per_step", step, began.elapsed().as_secs_f64());
        if let Some(pace) = self.samples_per_second() {
            self.add("train/samples_per_second", step, pace);
        }
        if let Some(bytes) = resident_bytes() {
            self.add("memory/resident_bytes", step, bytes);
        }
    }

    fn samples_per_second(&self) -> Option<f64> {
        let (start, _) = self.recent.front()?;
        let seconds = start.elapsed().as_secs_f64();
        let trajectories: usize = self.recent.iter().skip(1).map(|(_, count)| count).sum();
        (trajectories > 0 && seconds > 0.0).then(|| trajectories as f64 / seconds)
    }

    pub fn write_if_due(&mut self) -> Result<(), TaskError> {
        if self.written.elapsed().as_secs_f32() < RECORD_INTERVAL {
            return Ok(());
        }
        self.write()
    }

    pub fn write(&mut self) -> Result<(), TaskError> {
        self.written = Instant::now();
        if self.pending.is_empty() {
            return Ok(());
        }
        let store = &self.attempt.store;
        self.attempt.wait(store.record_metrics(self.attempt.fence(), &self.pending))?;
        self.pending.clear();
        Ok(())
    }
}

/// Resident memory of this process in bytes, where Linux provides it.
fn resident_bytes() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024.0 * kib)
}

#[cfg(test)]
mod tests {
    #[test]
    #[cfg(target_os = "linux")]
    fn what_this_process_has_in_memory_grows_with_what_it_holds() {
        const BYTES: usize = 256 << 20;
        let before = super::resident_bytes().unwrap();
        let held = vec![1_u8; BYTES];
        let after = super::resident_bytes().unwrap();
        assert!(
            after - before > 0.9 * std::hint::black_box(&held).len() as f64,
            "{before} {after}"
        );
    }
}
