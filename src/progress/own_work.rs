//! Progress of work in this process, shown like a job of a server, or like the members of a pipeline if
//! it has several parts.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use anyhow::Context;
use wire::{JobState, Progress};

use super::POLL_EVERY;
use super::display::{Display, Rate, Row};
use crate::process::Interrupts;

/// A callback that gets the amount of finished work, and breaks when the work has to stop.
pub type ProgressCallback<'a> = &'a (dyn Fn(u64) -> ControlFlow<()> + Sync);

/// A kind of work in this process.
#[derive(Clone, Copy, Debug)]
pub struct OwnWork {
    name: &'static str,
    total: u64,
    unit: &'static str,
    shown: Shown,
}

/// The outputs that show progress.
#[derive(Clone, Copy, Debug)]
enum Shown {
    Everywhere,
    OnTerminal,
}

impl OwnWork {
    /// Work on this many trajectories.
    pub const fn on_trajectories(name: &'static str, total: u64) -> Self {
        Self { name, total, unit: "trajectories", shown: Shown::Everywhere }
    }

    /// A search of at most this many steps. It is short, so that only a terminal shows its progress.
    pub const fn search(name: &'static str, total: u64) -> Self {
        Self { name, total, unit: "steps", shown: Shown::OnTerminal }
    }
}

/// Does `work` on a thread of its own, and shows its progress. The first interrupt asks it to stop, and
/// the second ends the process.
///
/// # Errors
/// When the work panics, or listening for signals fails.
pub async fn follow_own<T, E>(
    OwnWork { name, total, unit, shown }: OwnWork,
    work: impl FnOnce(ProgressCallback<'_>) -> Result<T, E> + Send + 'static,
) -> anyhow::Result<Result<T, E>>
where
    T: Send + 'static,
    E: Send + 'static,
{
    let mut interrupts = Interrupts::new()?;
    let state = Arc::new(State::default());
    let shared = Arc::clone(&state);
    let mut working = tokio::task::spawn_blocking(move || work(&|done| shared.report(done)));
    let mut display = match shown {
        Shown::Everywhere => Display::new(),
        Shown::OnTerminal => Display::on_terminal(),
    };
    let mut rate = Rate::default();
    let mut show = |state: JobState, done: u64| {
        let progress = Progress { done, total, unit: unit.to_owned(), ..Progress::default() };
        display.show(&[Row {
            name: name.to_owned(),
            state,
            reused: false,
            // The command prints it after the last line.
            error: None,
            waits_for: None,
            rate_per_second: rate.observe(done, Instant::now()),
            progress,
        }]);
    };
    let done = loop {
        show(JobState::Running, state.done.load(Ordering::Relaxed));
        tokio::select! {
            done = &mut working => break done.context("a fault of torqued, please report it")?,
            () = interrupts.next() => {
                if state.stop.swap(true, Ordering::Relaxed) {
                    std::process::exit(1);
                }
            }
            () = tokio::time::sleep(POLL_EVERY) => {}
        }
    };
    let final_state = if done.is_ok() { JobState::Succeeded } else { JobState::Failed };
    show(final_state, state.done.load(Ordering::Relaxed));
    display.finish();
    Ok(done)
}

#[derive(Debug, Default)]
struct State {
    done: AtomicU64,
    stop: AtomicBool,
}

impl State {
    fn report(&self, done: u64) -> ControlFlow<()> {
        self.done.fetch_max(done, Ordering::Relaxed);
        if self.stop.load(Ordering::Relaxed) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }
}

/// A part of the work and its progress.
pub struct Part {
    pub name: &'static str,
    pub unit: &'static str,
    pub done: u64,
    pub total: u64,
}

/// Waits for `work` and shows the progress of its `parts`. The first interrupt drops the work and
/// returns nothing.
///
/// # Errors
/// When listening for signals fails.
pub async fn follow_parts<T, E>(
    work: impl Future<Output = Result<T, E>>,
    parts: impl Fn() -> Vec<Part>,
) -> anyhow::Result<Option<Result<T, E>>> {
    let mut interrupts = Interrupts::new()?;
    let mut display = Display::new();
    let mut rates: Vec<Rate> = Vec::new();
    let mut work = std::pin::pin!(work);
    let ended = loop {
        let parts = parts();
        rates.resize_with(parts.len(), Rate::default);
        let rows = parts.into_iter().zip(&mut rates).map(|(part, rate)| row(&part, rate));
        display.show(&rows.collect::<Vec<_>>());
        tokio::select! {
            ended = &mut work => break Some(ended),
            () = interrupts.next() => break None,
            () = tokio::time::sleep(POLL_EVERY) => {}
        }
    };
    if matches!(ended, Some(Ok(_))) {
        let rows = parts().into_iter().zip(&mut rates).map(|(part, rate)| row(&part, rate));
        display.show(&rows.collect::<Vec<_>>());
    }
    display.finish();
    Ok(ended)
}

fn row(part: &Part, rate: &mut Rate) -> Row {
    let Part { name, unit, done, total } = *part;
    let state = match done {
        _ if done >= total => JobState::Succeeded,
        0 => JobState::Waiting,
        _ => JobState::Running,
    };
    Row {
        name: name.to_owned(),
        state,
        reused: false,
        error: None,
        waits_for: None,
        rate_per_second: rate.observe(done, Instant::now()),
        progress: Progress { done, total, unit: unit.to_owned(), ..Progress::default() },
    }
}
