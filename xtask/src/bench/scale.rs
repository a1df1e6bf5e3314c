//! A study of a lab: 10^4 jobs and 100 workers. The cost of the queue is measured with tasks that
//! do nothing. Its share beside tasks that take time is simulated from this.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::ensure;
use series::measured_quantile;

use super::measurement::Measurement;
use super::queue::cluster::Cluster;
use super::queue::program::{Program, QueueLocation};
use super::queue::workers::Workers;
use super::wanted::{BenchmarkResults, Wanted};
use crate::places::target;
use crate::product;

const JOBS: u32 = 10_000;
const WORKERS: u32 = 100;

const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Far longer than the jobs take.
const PATIENCE: Duration = Duration::from_secs(300);

/// Mean durations of simulated tasks, s.
const TASK_SECONDS: [f64; 4] = [0.1, 1.0, 10.0, 600.0];

pub(super) fn run(_: Wanted) -> anyhow::Result<BenchmarkResults> {
    let ours = Program::new(product::build_example("queue_rates")?, []);
    let folder = tempfile::Builder::new().prefix("bench-scale-").tempdir_in(target())?;
    let mut cluster = Cluster::start(&ours)?;
    let place =
        QueueLocation { folder: folder.path().to_owned(), database: cluster.database("scale")? };
    ours.run("setup", &place, &[])?;
    let empty = megabytes(&place)?;
    eprintln!("submitting {JOBS} jobs");
    let began = Instant::now();
    ours.run("submit", &place, &["each", &JOBS.to_string()])?;
    let submitted = began.elapsed().as_secs_f64();

    eprintln!("{WORKERS} workers");
    let mut workers = Workers::start(&ours, &place, WORKERS)?;
    let began = Instant::now();
    workers.go()?;
    while workers.count()? < u64::from(JOBS) {
        ensure!(began.elapsed() < PATIENCE, "the jobs do not end");
        sleep(LOOK_EVERY);
    }
    let drained = began.elapsed().as_secs_f64();
    workers.end()?;

    let kilobytes = (megabytes(&place)? - empty) * 1e3 / f64::from(JOBS);
    let mut measurements = vec![
        Measurement::alone("jobs submitted one by one", f64::from(JOBS) / submitted, "1/s", None),
        Measurement::alone(
            "jobs of one task that does nothing",
            f64::from(JOBS) / drained,
            "1/s",
            None,
        ),
        Measurement::alone("a job's room in the database", kilobytes, "kB", None),
    ];
    for mean in TASK_SECONDS {
        let study = simulate(JOBS, WORKERS, mean, drained / f64::from(JOBS));
        let what = |what: &str| format!("simulated, tasks of {mean} s: {what}");
        measurements.extend([
            Measurement::alone(what("all jobs"), study.hours, "h", None),
            Measurement::alone(what("workers busy"), 100.0 * study.busy, "%", None),
            Measurement::alone(
                what("p99 of a worker's wait for a task"),
                study.wait_s * 1e3,
                "ms",
                None,
            ),
        ]);
    }
    Ok(BenchmarkResults {
        notes: vec![
            format!("{JOBS} jobs, {WORKERS} workers in four processes, PostgreSQL on the same cores"),
            "simulated: lengths are exponential, the queue hands out one task at a time as fast as measured".to_owned(),
        ],
        measurements,
    })
}

/// The size of a database.
fn megabytes(place: &QueueLocation) -> anyhow::Result<f64> {
    let mut psql = Command::new("psql");
    let statement = "SELECT pg_database_size(current_database()) / 1e6";
    psql.arg(&place.database).args(["--tuples-only", "--no-align", "--command", statement]);
    super::dynamics::answer(&mut psql)
}

#[derive(Debug, PartialEq)]
struct Study {
    hours: f64,
    /// The share of their time that workers spend on tasks.
    busy: f64,
    /// The 99th percentile of the time from the end of a worker's task to the start of its next.
    wait_s: f64,
}

/// Simulates workers that do jobs which all wait at the beginning. The queue hands out one job
/// after the other and needs `handover_s` for each. A job takes `mean_s` on average.
fn simulate(jobs: u32, workers: u32, mean_s: f64, handover_s: f64) -> Study {
    // Times are in nanoseconds, because integers can be ordered.
    let mut free: BinaryHeap<Reverse<u64>> = (0..workers).map(|_| Reverse(0)).collect();
    let (mut queue_free, mut end, mut worked) = (0.0_f64, 0.0_f64, 0.0);
    let mut waits = Vec::new();
    for job in 0..jobs {
        let Some(Reverse(at)) = free.pop() else { break };
        let at = seconds(at);
        let begins = at.max(queue_free) + handover_s;
        let lasts = mean_s * exponential(job, jobs);
        queue_free = begins;
        end = end.max(begins + lasts);
        worked += lasts;
        waits.push(begins - at);
        free.push(Reverse(nanoseconds(begins + lasts)));
    }
    waits.sort_by(f64::total_cmp);
    Study {
        hours: end / 3600.0,
        busy: worked / (end * f64::from(workers)),
        wait_s: measured_quantile(&waits, 0.99),
    }
}

/// A quantile of the exponential distribution with mean 1. Each of `jobs` gets a different one, in
/// an order without a pattern.
fn exponential(job: u32, jobs: u32) -> f64 {
    /// The fractional part of the golden ratio. Its multiples are evenly spread.
    const STEP: f64 = 0.618_033_988_749_895;
    let share = (f64::from(job) * STEP).fract();
    let half = 0.5 / f64::from(jobs);
    -(1.0 - share.clamp(half, 1.0 - half)).ln()
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a study lasts less than 500 years"
)]
fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9) as u64
}

#[expect(clippy::cast_precision_loss, reason = "a nanosecond more or less")]
fn seconds(nanoseconds: u64) -> f64 {
    nanoseconds as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_exponential() {
        let lengths: Vec<f64> = (0..10_000).map(|job| exponential(job, 10_000)).collect();
        let mean = lengths.iter().sum::<f64>() / 1e4;
        assert!((mean - 1.0).abs() < 0.01, "{mean}");
        let longer = lengths.iter().filter(|length| **length > 2.0).count();
        assert!((1340..1367).contains(&longer), "{longer} of 1353 are longer than 2");
    }

    #[test]
    fn one_worker_does_all_and_waits_for_each_handover() {
        let study = simulate(1000, 1, 1.0, 0.5);
        assert!((study.hours * 3600.0 - 1500.0).abs() < 10.0, "{study:?}");
        assert!((study.wait_s - 0.5).abs() < 1e-6, "{study:?}");
    }

    #[test]
    fn a_slow_queue_is_what_all_wait_for_and_a_fast_one_is_not_noticed() {
        let slow = simulate(10_000, 100, 0.1, 0.01);
        assert!((slow.hours * 3600.0 - 100.0).abs() < 2.0, "{slow:?}");
        assert!((slow.busy - 0.1).abs() < 0.01, "{slow:?}");
        let fast = simulate(10_000, 100, 10.0, 0.001);
        assert!(fast.busy > 0.93 && fast.wait_s < 0.11, "{fast:?}");
    }
}
