//! Workers as child processes of the server, so that a job that crashes or is killed never takes the server
//! along.

use std::process::Stdio;
use std::time::{Duration, Instant};

use store::{Store, WorkerEnd};
use tokio::process::{Child, Command};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::WorkerCommand;

/// The exit code of a worker that ended because its task did not, which is no crash: EX_TEMPFAIL of sysexits.h.
pub const GAVE_UP: u8 = 75;

/// How a server runs its workers.
#[derive(Clone, Debug)]
pub struct WorkerProcesses {
    pub store: Store,
    pub command: WorkerCommand,
    pub count: usize,
    /// The beginning of each name, before its number.
    pub name: String,
    /// Of each.
    pub threads: u32,
    /// Flags that say what each offers.
    pub offers: Vec<String>,
}

/// A worker that lived this long was healthy: if it dies, the next one starts at once.
const HEALTHY_AFTER: Duration = Duration::from_secs(30);

const FIRST_PAUSE: Duration = Duration::from_millis(200);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// How long workers may take to put down their task: longer than they give it themselves (`worker/src/stop.rs`), since
/// one that has to be killed here says nothing of why.
const STOP_WITHIN: Duration = Duration::from_secs(25);

impl WorkerProcesses {
    /// Keeps `count` workers running until `shutdown`, then until they have ended.
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

    /// Gives the task of a worker that has ended to another, without waiting for its lease to run out.
    async fn take_back(&self, index: usize, end: &End) {
        let name = self.name(index);
        let taken = match end {
            End::Died(how) => {
                let how = format!("died: {how}");
                self.store.take_back(&name, WorkerEnd::Died(&how)).await
            }
            // It may have been killed before it could put its task down, for which the task is not to blame. One that
            // gave up has ended its attempt, unless the database did not answer.
            End::GaveUp | End::Stopped | End::Killed => {
                self.store.take_back(&name, WorkerEnd::Stopped).await
            }
        };
        if let Err(error) = taken {
            let error = faults::causes(&error);
            tracing::error!(worker = index, error, "cannot take back its task");
        }
    }

    /// As it is shown beside tasks.
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
            .envs(environment)
            // Nothing is ever written: the pipe's closing, with or without a farewell of the
            // server, is what tells the worker to stop.
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            // Ctrl-C in the terminal reaches the server alone, which then stops its workers.
            .process_group(0)
            .kill_on_drop(true)
            .spawn()
    }
}

/// How a worker process came to its end.
enum End {
    /// By itself, and how.
    Died(String),
    /// By itself, because its task did not end when it was told to.
    GaveUp,
    Stopped,
    Killed,
}

/// Waits for a worker; asks it to stop on `shutdown`.
async fn run_to_end(
    index: usize,
    mut child: Child,
    shutdown: &CancellationToken,
    kill: &CancellationToken,
) -> End {
    // Taken out, because waiting for a child closes its standard input.
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
