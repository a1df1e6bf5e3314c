//! Progress of work with several parts in this process, shown like the members of a pipeline.

use std::time::Instant;

use wire::{JobState, Progress};

use super::rate::Rate;
use super::row::Row;
use super::{Display, POLL_EVERY};
use crate::server::Interrupts;

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
