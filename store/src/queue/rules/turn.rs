//! The order of the queue: the place of a task among the waiting tasks.
//!
//! A submission sets a task's place in line, which never changes: `waits_since` less an hour for
//! each point of priority. So all tasks age at the same rate. While a job is open, `waits_since`
//! follows no clock backwards. Among tasks of one priority those of the older job go first.
//!
//! A claim hands out the first task in line that asks for no more than the worker offers. Each
//! combination of requested resources is one row of `resources`, and its first task is at the
//! beginning of an index. So a claim passes over no task, however many wait that this worker cannot
//! take.

use spec::Moment;

use crate::Timestamp;

/// How much longer a task must have waited to make up for one point of priority. So no task waits
/// for ever, and the order does not change while tasks wait.
const POINT_MS: i64 = 60 * 60 * 1000;

/// The place in line of a job's tasks; the smaller goes first. The job has waited since
/// `waits_since`. A job with a start time queues up at that time.
pub(crate) fn turn(waits_since: Timestamp, not_before: Option<Moment>, priority: i32) -> i64 {
    let from = waits_since.milliseconds().max(not_before.map_or(i64::MIN, Moment::milliseconds));
    from.saturating_sub(i64::from(priority) * POINT_MS)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: i64 = 3_600_000;

    fn at(hour: i64, priority: i32) -> i64 {
        turn(Timestamp::from_milliseconds(hour * HOUR), None, priority)
    }

    #[test]
    fn a_point_of_priority_is_worth_an_hour() {
        assert!(at(5, 1) < at(5, 0), "of one moment the higher goes first");
        assert!(at(9, 10) < at(0, 0), "ten points make up for nine hours");
        assert!(at(11, 10) > at(0, 0), "and not for eleven");
        assert!(at(201, 100) > at(0, -100), "nobody is passed by all that come");
    }

    #[test]
    fn a_job_that_begins_later_queues_up_then() {
        let later = Moment::from_milliseconds(8 * HOUR);
        let since = Timestamp::from_milliseconds(HOUR);
        assert_eq!(turn(since, Some(later), 0), at(8, 0));
        assert_eq!(turn(since, Some(Moment::from_milliseconds(0)), 3), at(1, 3));
    }
}
