//! Settled events. Transactions do not commit in the order in which their events got ids: a reader
//! that sees event 7 may see event 6 later.

use std::collections::VecDeque;

use super::Database;

/// Number of marks that wait for transactions to end. At this number no new marks are made, and
/// events come later.
const MARKS: usize = 64;

/// How far events have settled. Each look updates it.
///
/// A transaction gets its number before its events get ids (`next_event_id`). A look at new ids
/// reads the last id first, and then takes a transaction number for itself: together they form a
/// mark. Once all transactions up to that number have ended, every open transaction got its number
/// after the mark, and its events got larger ids than the mark's. A snapshot's upper bound cannot
/// serve as that number, because open transactions may be beyond it.
#[derive(Debug, Default)]
pub(crate) struct Horizon {
    marks: VecDeque<Mark>,
    settled: Option<i64>,
}

#[derive(Debug)]
struct Mark {
    last_event: i64,
    transaction: i64,
}

impl Database {
    /// The id up to which all events can be read, so none will appear later. `None` as long as it
    /// is not known.
    pub async fn settled_event(&self, horizon: &mut Horizon) -> Result<Option<i64>, sqlx::Error> {
        let last_event: i64 =
            sqlx::query_scalar("SELECT last_value FROM event_id").fetch_one(&self.reader).await?;
        if horizon.needs_mark(last_event) {
            let transaction: i64 =
                sqlx::query_scalar("SELECT CAST(CAST(pg_current_xact_id() AS TEXT) AS BIGINT)")
                    .fetch_one(&self.reader)
                    .await?;
            horizon.marks.push_back(Mark { last_event, transaction });
        }
        if !horizon.marks.is_empty() {
            let oldest_open: i64 = sqlx::query_scalar(
                "SELECT CAST(CAST(pg_snapshot_xmin(pg_current_snapshot()) AS TEXT) AS BIGINT)",
            )
            .fetch_one(&self.reader)
            .await?;
            horizon.settle(oldest_open);
        }
        Ok(horizon.settled)
    }
}

impl Horizon {
    /// Whether there are ids that no mark covers, and room for another mark.
    fn needs_mark(&self, last_event: i64) -> bool {
        let newest = self.marks.back().map(|newest| newest.last_event).or(self.settled);
        newest.is_none_or(|newest| newest < last_event) && self.marks.len() < MARKS
    }

    /// Settles the marks before `oldest_open`: all earlier transactions have ended.
    fn settle(&mut self, oldest_open: i64) {
        while let Some(mark) = self.marks.pop_front_if(|mark| mark.transaction < oldest_open) {
            self.settled = Some(mark.last_event);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(
        horizon: &mut Horizon,
        last_event: i64,
        transaction: i64,
        oldest_open: i64,
    ) -> Option<i64> {
        if horizon.needs_mark(last_event) {
            horizon.marks.push_back(Mark { last_event, transaction });
        }
        horizon.settle(oldest_open);
        horizon.settled
    }

    #[test]
    fn events_settle_when_all_that_were_open_at_their_mark_have_ended() {
        let mut horizon = Horizon::default();
        assert_eq!(look(&mut horizon, 5, 100, 98), None, "98 may write an event up to 5");
        assert_eq!(look(&mut horizon, 7, 103, 101), Some(5), "101 began after the first mark");
        assert!(!horizon.needs_mark(7), "nobody has written since");
        assert_eq!(look(&mut horizon, 7, 104, 103), Some(5));
        assert_eq!(look(&mut horizon, 7, 104, 104), Some(7));
        assert_eq!(look(&mut horizon, 9, 110, 105), Some(7));
    }

    #[test]
    fn a_transaction_that_stays_open_holds_events_up_and_takes_no_memory() {
        let mut horizon = Horizon::default();
        for id in 0..1000 {
            assert_eq!(look(&mut horizon, id, id + 2, 1), None);
        }
        assert_eq!(horizon.marks.len(), MARKS);
        assert_eq!(look(&mut horizon, 1000, 1002, 1003), Some(63));
        assert_eq!(look(&mut horizon, 1000, 1004, 1005), Some(1000));
    }
}
