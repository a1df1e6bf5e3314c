//! How fast this process evaluates cells. A cell's predictors take from microseconds to minutes per
//! scenario, so only a cell that all of them have answered says how long the next one takes.

use std::sync::{Mutex, PoisonError};

use store::JobId;

/// The job of the newest cell of this process, and its scenarios per second.
static NEWEST: Mutex<Option<(JobId, f64)>> = Mutex::new(None);

/// Scenarios per second that all predictors answered in an earlier cell of `job`.
pub(super) fn of(job: JobId) -> Option<f64> {
    let newest = *NEWEST.lock().unwrap_or_else(PoisonError::into_inner);
    newest.filter(|(of, _)| *of == job).map(|(_, rate)| rate)
}

/// Keeps the pace of a cell of `job`.
pub(super) fn keep(job: JobId, scenarios: u64, seconds: f64) {
    if scenarios > 0 && seconds > 0.0 {
        let pace = (job, scenarios as f64 / seconds);
        *NEWEST.lock().unwrap_or_else(PoisonError::into_inner) = Some(pace);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pace_of_another_job_says_nothing() {
        let [first, second] = [JobId(1), JobId(2)];
        assert_eq!(of(first), None);
        keep(first, 100, 20.0);
        assert_eq!((of(first), of(second)), (Some(5.0), None));
        keep(second, 0, 1.0);
        assert_eq!(of(first), Some(5.0), "a cell without scenarios has no pace");
        keep(second, 10, 1.0);
        assert_eq!((of(first), of(second)), (None, Some(10.0)));
    }
}
