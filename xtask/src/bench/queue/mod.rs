//! The queue: tasks claimed and completed per second, the delay between a job's submission and its
//! start on an idle worker, and the cost of idle workers. It runs on SQLite and on a PostgreSQL of
//! its own that syncs every commit.
//!
//! Workers run in separate processes, as torqued's do. There are up to four processes, so that 64
//! workers are 16 in each. Every worker has its own connections.

pub(super) mod cluster;
mod processor_time;
pub(super) mod program;
pub(super) mod workers;

use std::fs;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use series::measured_quantile;

use super::measurement::{Goal, Measurement, Peer};
use super::wanted::{BenchmarkResults, Peers, Wanted};
use crate::places::target;
use crate::{peers, product};
use cluster::Cluster;
use program::{Program, QueueLocation, SQLITE};
use workers::Workers;

const WORKERS: [u32; 3] = [1, 8, 64];
const IDLE_WORKERS: u32 = 64;
const TRAININGS: [u32; 2] = [1, 8];

/// Time for workers to open connections and plan statements, before tasks count.
const WARM_UP: Duration = Duration::from_secs(2);
const COUNTED: Duration = Duration::from_secs(3);
/// Pause between two readings of the number of finished tasks.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// Number of jobs that idle workers are offered, one at a time.
const OFFERS: u32 = 600;
const OFFER_EVERY_MS: u32 = 25;
/// One over the share of waits that do not count, because the first tasks of a worker plan its
/// statements.
const WARM_UP_SHARE: usize = 3;

const SETTLE: Duration = Duration::from_secs(2);
/// Longer than the time during which idle workers still ask often.
const FALL_ASLEEP: Duration = Duration::from_secs(15);
const IDLE: Duration = Duration::from_secs(10);

/// The largest number of tasks that torqued allows in a job.
const TASKS_OF_A_JOB: u32 = 10_000;
const JOBS: u32 = 3000;
/// Number of tasks for queues that fetch several at once.
const TASKS_OF_PEERS: u32 = 60_000;

/// Ratio of tasks per second to apalis, which fetches and acknowledges one task at a time like us.
const GOAL_RATE: Goal = Goal::AtLeast(1.0);
/// Percent of a core.
const GOAL_IDLE_PERCENT: Goal = Goal::AtMost(2.0);

/// The default of apalis.
const APALIS_BATCH: u32 = 10;

/// The kind of submitted jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Work {
    /// Jobs of many tasks.
    Many,
    /// Jobs of one task.
    Each,
}

struct Database {
    name: &'static str,
    /// Bound on the 99th percentile of the time from a submission to the start of its task, ms.
    goal_wait_ms: Goal,
    cluster: Option<Cluster>,
}

/// Another queue, on one database.
struct ComparedQueue {
    program: Program,
    name: String,
    /// Whether our rate has a goal relative to its rate.
    is_bound: bool,
    /// Whether its waits are measured, too.
    waits: bool,
}

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    let ours = Program::new(product::build_example("queue_rates")?, []);
    let folder = tempfile::Builder::new().prefix("bench-queue-").tempdir_in(target())?;
    let postgres = Cluster::start(&ours)?;
    let databases = [
        Database { name: "SQLite", goal_wait_ms: Goal::AtMost(100.0), cluster: None },
        Database { name: "PostgreSQL", goal_wait_ms: Goal::AtMost(50.0), cluster: Some(postgres) },
    ];
    let mut measurements = Vec::new();
    for mut database in databases {
        let rivals = match wanted.peers {
            Peers::LeftOut => Vec::new(),
            Peers::Measured => rivals(&database)?,
        };
        measurements.extend(measure(&mut database, &ours, &rivals, folder.path())?);
    }
    let mut notes = vec![
        "workers: in up to four processes, each worker with connections of its own".to_owned(),
        "every commit is synced to the disk, by peers as well".to_owned(),
    ];
    if wanted.peers == Peers::Measured {
        notes.push("apalis looks into SQLite every 50 ms; PostgreSQL notifies it".to_owned());
        notes.push("Graphile Worker keeps 500 tasks in each process (localQueue)".to_owned());
    }
    Ok(BenchmarkResults { notes, measurements })
}

fn rivals(database: &Database) -> anyhow::Result<Vec<ComparedQueue>> {
    let apalis = peers::apalis()?;
    let of_apalis = |batch: u32| ComparedQueue {
        program: Program::new(apalis.clone(), [batch.to_string()]),
        name: format!("apalis 1.0.0, batches of {batch}"),
        is_bound: batch == 1,
        waits: batch == 1,
    };
    let mut rivals = vec![of_apalis(1), of_apalis(APALIS_BATCH)];
    if database.cluster.is_some() {
        let script = peers::graphile()?.to_string_lossy().into_owned();
        rivals.push(ComparedQueue {
            program: Program::new("node".into(), [script]),
            name: "Graphile Worker 0.17.3".to_owned(),
            is_bound: false,
            waits: true,
        });
    }
    Ok(rivals)
}

fn measure(
    database: &mut Database,
    ours: &Program,
    rivals: &[ComparedQueue],
    folder: &Path,
) -> anyhow::Result<Vec<Measurement>> {
    let mut rows = Vec::new();
    let (name, goal) = (database.name, database.goal_wait_ms);
    let mut many = Queue::new(database, ours, folder, Work::Many, TASKS_OF_A_JOB)?;
    let mut each = Queue::new(database, ours, folder, Work::Each, JOBS)?;
    for workers in WORKERS {
        eprintln!("{name}, tasks per second of {workers} workers");
        let what = format!("{name}, tasks of large jobs, {workers} workers");
        let rate = many.rate(workers)?;
        rows.push(Measurement::alone(&what, rate, "1/s", None));
        for rival in rivals {
            // Some rivals become slower with the rows that killed workers leave, and with a long
            // queue. A rival for which we have a goal gets a queue as long as ours.
            let fill = if rival.is_bound { TASKS_OF_A_JOB } else { TASKS_OF_PEERS };
            let mut queue = Queue::new(database, &rival.program, folder, Work::Many, fill)?;
            let peer = Peer { value: queue.rate(workers)?, version: rival.name.clone() };
            let goal = rival.is_bound.then_some(GOAL_RATE);
            rows.push(Measurement::compared(&what, rate, Some(peer), "1/s", goal));
        }
        let what = format!("{name}, jobs of one task, {workers} workers");
        rows.push(Measurement::alone(what, each.rate(workers)?, "1/s", None));
    }

    let mut empty = Queue::new(database, ours, folder, Work::Each, 0)?;
    let mut theirs = Vec::new();
    for rival in rivals.iter().filter(|rival| rival.waits) {
        let queue = Queue::new(database, &rival.program, folder, Work::Each, 0)?;
        theirs.push((rival, queue));
    }
    for workers in WORKERS {
        eprintln!("{name}, from submit to start with {workers} workers");
        let [p50, p99] = empty.waits_ms(workers)?;
        let what = |quantile| format!("{name}, submit to start, {workers} workers, {quantile}");
        rows.push(Measurement::alone(what("p50"), p50, "ms", None));
        rows.push(Measurement::alone(what("p99"), p99, "ms", Some(goal)));
        for (rival, queue) in &mut theirs {
            let waits = queue.waits_ms(workers)?;
            for (quantile, ours, theirs) in [("p50", p50, waits[0]), ("p99", p99, waits[1])] {
                let peer = Some(Peer { value: theirs, version: rival.name.clone() });
                rows.push(Measurement::compared(what(quantile), ours, peer, "ms", None));
            }
        }
    }

    for trainings in TRAININGS {
        eprintln!("{name}, metrics of {trainings} trainings");
        let queue = Queue::new(database, ours, folder, Work::Each, 0)?;
        let printed = ours.run("metrics", &queue.place, &[&trainings.to_string()])?;
        let what = format!("{name}, metrics, 100 at a time, {trainings} trainings");
        rows.push(Measurement::alone(what, printed.trim().parse()?, "1/s", None));
    }

    eprintln!("{name}, {IDLE_WORKERS} idle workers");
    let server = database.cluster.as_ref().map(|cluster| cluster.server);
    let what = format!("{name}, {IDLE_WORKERS} idle workers");
    let idle = empty.idle_percent(server)?;
    rows.push(Measurement::alone(&what, idle, "% of a core", Some(GOAL_IDLE_PERCENT)));
    for (rival, queue) in &mut theirs {
        let peer = Peer { value: queue.idle_percent(server)?, version: rival.name.clone() };
        rows.push(Measurement::compared(&what, idle, Some(peer), "% of a core", None));
    }
    Ok(rows)
}

/// The queue of a program, in its own database.
struct Queue<'a> {
    program: &'a Program,
    place: QueueLocation,
    work: Work,
    /// Least number of queued tasks at the beginning of a measurement.
    fill: u32,
    queued: u64,
}

impl<'a> Queue<'a> {
    fn new(
        database: &mut Database,
        program: &'a Program,
        folder: &Path,
        work: Work,
        fill: u32,
    ) -> anyhow::Result<Self> {
        let number = fs::read_dir(folder)?.count();
        let folder = folder.join(format!("queue{number}"));
        fs::create_dir(&folder)?;
        let database = match &mut database.cluster {
            None => SQLITE.to_owned(),
            Some(cluster) => cluster.database(&format!("queue{number}"))?,
        };
        let place = QueueLocation { folder, database };
        program.run("setup", &place, &[])?;
        Ok(Self { program, place, work, fill, queued: 0 })
    }

    fn refill(&mut self) -> anyhow::Result<()> {
        let wanted = u64::from(self.fill);
        let (word, count) = match self.work {
            Work::Many if self.queued < wanted => ("many", wanted),
            Work::Each => ("each", wanted.saturating_sub(self.queued)),
            Work::Many => return Ok(()),
        };
        self.program.run("submit", &self.place, &[word, &count.to_string()])?;
        self.queued += count;
        Ok(())
    }

    /// Tasks claimed and completed per second.
    fn rate(&mut self, workers: u32) -> anyhow::Result<f64> {
        self.refill()?;
        let mut workers = Workers::start(self.program, &self.place, workers)?;
        workers.go()?;
        sleep(WARM_UP);
        let (first, began) = (workers.count()?, Instant::now());
        let (mut last, mut seconds) = (first, 0.0);
        // A measurement ends early if the queue is empty.
        while began.elapsed() < COUNTED && last < self.queued {
            sleep(LOOK_EVERY);
            last = workers.count()?;
            seconds = began.elapsed().as_secs_f64();
        }
        self.queued = self.queued.saturating_sub(workers.count()?);
        workers.end()?;
        Ok(per_second(last - first, seconds))
    }

    /// Median and 99th percentile of the time from a submission to the start of its task, in ms.
    fn waits_ms(&mut self, workers: u32) -> anyhow::Result<[f64; 2]> {
        let mut workers = Workers::start(self.program, &self.place, workers)?;
        workers.go()?;
        sleep(SETTLE);
        let numbers = [OFFERS.to_string(), OFFER_EVERY_MS.to_string()];
        self.program.run("offer", &self.place, &numbers.each_ref().map(String::as_str))?;
        let began = Instant::now();
        while workers.count()? < u64::from(OFFERS) && began.elapsed() < IDLE {
            sleep(LOOK_EVERY);
        }
        let waits = workers.end()?;
        let counted = waits.iter().flat_map(|waits| &waits[waits.len() / WARM_UP_SHARE..]);
        let mut waits: Vec<f64> = counted.copied().collect();
        anyhow::ensure!(!waits.is_empty(), "no worker got a task");
        waits.sort_by(f64::total_cmp);
        Ok([0.5, 0.99].map(|share| measured_quantile(&waits, share)))
    }

    /// The processor time of idle workers and of the server of their database, in percent of a core.
    fn idle_percent(&mut self, server: Option<u32>) -> anyhow::Result<f64> {
        let mut workers = Workers::start(self.program, &self.place, IDLE_WORKERS)?;
        workers.go()?;
        sleep(FALL_ASLEEP);
        let processes = workers.processes();
        let spent = || {
            let of_workers = processes.iter().map(|process| processor_time::of(*process));
            let of_server = server.map(processor_time::with_children);
            of_workers.chain(of_server).sum::<Duration>()
        };
        let (before, began) = (spent(), Instant::now());
        sleep(IDLE);
        let (after, elapsed) = (spent(), began.elapsed());
        workers.end()?;
        Ok(100.0 * after.saturating_sub(before).as_secs_f64() / elapsed.as_secs_f64())
    }
}

#[expect(clippy::cast_precision_loss, reason = "far fewer tasks than 2^52")]
fn per_second(tasks: u64, seconds: f64) -> f64 {
    tasks as f64 / seconds
}
