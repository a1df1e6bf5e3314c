//! Which events have settled. Transactions commit in another order than that in which their events were given ids: who sees
//! number 7 may see number 6 later.

use std::collections::VecDeque;

use super::Database;

/// Marks that wait for transactions to end. While more would wait no new ones are made, and events come later.
const MARKS: usize = 64;

/// How far events have settled, learned from look to look.
///
/// A transaction has its number before its events have ids (`next_event_id`). At a look, the last id that was given is read
/// first, and then the number that the next transaction will have: together a mark. Once all transactions with smaller numbers
/// have ended, those that are open began after the mark, and their events have ids after the mark's.
#[derive(Debug, Default)]
pub(crate) struct Horizon {
    marks: VecDeque<Mark>,
    settled: Option<i64>,
}

#[derive(Debug)]
struct Mark {
    last_event: i64,
    next_transaction: i64,
}

impl Database {
    /// The id up to which no event will appear any more that cannot be read now; `None` as long as that is not known of any.
    pub async fn settled_event(&self, horizon: &mut Horizon) -> Result<Option<i64>, sqlx::Error> {
        // Two statements: a snapshot is older than the rest of its statement.
        let last_event: i64 =
            sqlx::query_scalar("SELECT last_value FROM event_id").fetch_one(&self.reader).await?;
        let (oldest_open, next_transaction): (i64, i64) = sqlx::query_as(
            "SELECT CAST(CAST(pg_snapshot_xmin(present) AS TEXT) AS BIGINT), \
             CAST(CAST(pg_snapshot_xmax(present) AS TEXT) AS BIGINT) \
             FROM pg_current_snapshot() AS present",
        )
        .fetch_one(&self.reader)
        .await?;
        Ok(horizon.look(Mark { last_event, next_transaction }, oldest_open))
    }
}

impl Horizon {
    fn look(&mut self, mark: Mark, oldest_open: i64) -> Option<i64> {
        let newest = self.marks.back().map(|newest| newest.last_event).or(self.settled);
        if newest.is_none_or(|newest| newest < mark.last_event) && self.marks.len() < MARKS {
            self.marks.push_back(mark);
        }
        while let Some(mark) = self.marks.pop_front_if(|mark| mark.next_transaction <= oldest_open)
        {
            self.settled = Some(mark.last_event);
        }
        self.settled
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_settle_when_all_that_were_open_at_their_mark_have_ended() {
        let mut horizon = Horizon::default();
        let mut look = |last_event, next_transaction, oldest_open| {
            horizon.look(Mark { last_event, next_transaction }, oldest_open)
        };
        assert_eq!(look(5, 100, 98), None, "98 may write an event up to 5");
        assert_eq!(look(7, 103, 101), Some(5), "101 began after the first mark");
        assert_eq!(look(7, 103, 101), Some(5));
        assert_eq!(look(7, 103, 103), Some(7), "nobody writes");
        assert_eq!(look(9, 110, 103), Some(7));
    }

    #[test]
    fn a_transaction_that_stays_open_holds_events_up_and_no_memory() {
        let mut horizon = Horizon::default();
        for id in 0..1000 {
            assert_eq!(horizon.look(Mark { last_event: id, next_transaction: id + 2 }, 1), None);
        }
        assert_eq!(horizon.marks.len(), MARKS);
        let mark = Mark { last_event: 1000, next_transaction: 1002 };
        assert_eq!(horizon.look(mark, 1002), Some(63));
        let mark = Mark { last_event: 1000, next_transaction: 1002 };
        assert_eq!(horizon.look(mark, 1002), Some(1000));
    }
}
