//! Workers as child processes of the server. A job that crashes or is killed never ends the server.

use std::process::Stdio;
use std::time::{Duration, Instant};

use store::{Store, WorkerEnd};
use tokio::process::{Child, Command};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::{SERVERS_TOKEN, WorkerCommand};

/// The exit code of a worker that ended because its task did not. It is no crash: EX_TEMPFAIL of
/// sysexits.h.
pub const GAVE_UP: u8 = 75;

/// Options of a server's own workers.
#[derive(Clone, Debug)]
pub struct WorkerProcesses {
    /// The store whose leases are taken back when a worker ends.
    pub store: Store,
    /// How each worker is started.
    pub command: WorkerCommand,
    /// Number of workers that are kept running.
    pub count: usize,
    /// The prefix of each name, before its number.
    pub name: String,
    /// Threads of each worker.
    pub threads: u32,
    /// Flags with the offer of each worker.
    pub offers: Vec<String>,
}

/// A worker that lived this long was healthy. If it dies, the next one starts at once.
const HEALTHY_AFTER: Duration = Duration::from_secs(30);

const FIRST_PAUSE: Duration = Duration::from_millis(200);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// How long workers may take to give their tasks back. It is longer than the limit that they set
/// themselves (`worker/src/stop.rs`), because a worker that is killed here gives no reason.
const STOP_WITHIN: Duration = Duration::from_secs(25);

impl WorkerProcesses {
    /// Keeps `count` workers running until `shutdown`, and then waits until they have ended.
    pub fn spawn(
        self,
        tracker: &TaskTracker,
        shutdown: &CancellationToken,
        kill: &CancellationToken,
    ) {
        for index in 1..=self.count {
            tracker.spawn(self.clone().keep_running(index, shutdown.clone(), kill.clone()));
        }
    }

    async fn keep_running(
        self,
        index: usize,
        shutdown: CancellationToken,
        kill: CancellationToken,
    ) {
        let mut pause = FIRST_PAUSE;
        while !shutdown.is_cancelled() {
            let started = Instant::now();
            match self.start(index) {
                Ok(child) => {
                    tracing::info!(worker = index, pid = child.id(), "worker started");
                    let end = run_to_end(index, child, &shutdown, &kill).await;
                    self.take_back(index, &end).await;
                    match end {
                        End::Died(_) => {}
                        End::GaveUp => continue,
                        End::Stopped | End::Killed => return,
                    }
                }
                Err(error) => tracing::error!(worker = index, %error, "cannot start a worker"),
            }
            if started.elapsed() > HEALTHY_AFTER {
                pause = FIRST_PAUSE;
            }
            tokio::select! {
                () = tokio::time::sleep(pause) => pause = (pause * 2).min(LONGEST_PAUSE),
                () = shutdown.cancelled() => {}
            }
        }
    }

    /// Gives the task of an ended worker to another one, without waiting for its lease to expire.
    async fn take_back(&self, index: usize, end: &End) {
        let name = self.name(index);
        let taken = match end {
            End::Died(how) => {
                let how = format!("died: {how}");
                self.store.take_back(&name, WorkerEnd::Died(&how)).await
            }
            // It may have been killed before it could give its task back, so the task is not to
            // blame. A worker that gave up has ended its attempt, unless the database did not
            // answer.
            End::GaveUp | End::Stopped | End::Killed => {
                self.store.take_back(&name, WorkerEnd::Stopped).await
            }
        };
        if let Err(error) = taken {
            let error = spec::causes(&error);
            tracing::error!(worker = index, error, "cannot take back its task");
        }
    }

    /// The worker's name, as it is shown beside tasks.
    fn name(&self, index: usize) -> String {
        format!("{}{index}", self.name)
    }

    fn start(&self, index: usize) -> std::io::Result<Child> {
        let environment = self.command.environment.iter().map(|(name, value)| (name, value));
        Command::new(&self.command.program)
            .arg0("torqued")
            .arg("worker")
            .args(&self.command.store)
            .args(self.command.flags(&self.name(index), self.threads, &self.command.device))
            .args(&self.offers)
            .arg("--stop-with-stdin")
            .env_remove(SERVERS_TOKEN)
            .envs(environment)
            // Nothing is ever written to the pipe. The worker stops when it is closed, which
            // happens even if the server is killed.
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            // Ctrl-C in the terminal reaches only the server, which then stops its workers.
            .process_group(0)
            .kill_on_drop(true)
            .spawn()
    }
}

/// How a worker process ended.
enum End {
    /// By itself, with this description.
    Died(String),
    /// By itself, because its task did not end when it was told to.
    GaveUp,
    Stopped,
    Killed,
}

/// Waits for a worker to end. Asks it to stop on `shutdown`.
async fn run_to_end(
    index: usize,
    mut child: Child,
    shutdown: &CancellationToken,
    kill: &CancellationToken,
) -> End {
    // Standard input is taken out, because waiting for a child closes it.
    let stdin = child.stdin.take();
    tokio::select! {
        status = child.wait() => {
            if status.as_ref().is_ok_and(|status| status.code() == Some(GAVE_UP.into())) {
                tracing::warn!(worker = index, "worker ended to end its task, starting another");
                return End::GaveUp;
            }
            let how = status.map_or_else(|error| error.to_string(), |status| status.to_string());
            tracing::warn!(worker = index, how, "worker died, starting another");
            return End::Died(how);
        }
        () = shutdown.cancelled() => {}
    }
    drop(stdin);
    let ended = tokio::select! {
        ended = tokio::time::timeout(STOP_WITHIN, child.wait()) => ended.is_ok(),
        () = kill.cancelled() => false,
    };
    if ended {
        tracing::info!(worker = index, "worker stopped");
        return End::Stopped;
    }
    tracing::warn!(worker = index, "worker killed");
    if let Err(error) = child.kill().await {
        tracing::error!(worker = index, %error, "cannot kill the worker");
    }
    End::Killed
}
