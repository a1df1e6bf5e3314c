use std::time::{Duration, Instant};

use wire::JobState;

use super::row::Row;

/// Progress for logs and pipes: a line for each change of state, and one every few seconds while
/// work runs.
#[derive(Debug, Default)]
pub struct Lines {
    said: Vec<LastLine>,
}

/// The last message about a row.
#[derive(Clone, Debug)]
struct LastLine {
    state: JobState,
    at: Instant,
    text: String,
}

const SPEAK_EVERY: Duration = Duration::from_secs(5);

impl Lines {
    /// The lines to print at `now`.
    pub fn changes(&mut self, rows: &[Row], now: Instant) -> Vec<String> {
        let mut lines = Vec::new();
        let widest = rows.iter().map(|row| row.name.chars().count()).max().unwrap_or_default();
        for (k, row) in rows.iter().enumerate() {
            let text = row.describe();
            let news = self.said.get(k).is_none_or(|said| {
                let due = now.duration_since(said.at) >= SPEAK_EVERY;
                said.state != row.state || (due && said.text != text)
            });
            if !news {
                continue;
            }
            let percent = match row.state {
                JobState::Running => format!("{:3.0} %  ", row.fraction() * 100.0),
                _ => String::new(),
            };
            lines.push(format!("{:widest$}  {percent}{text}", row.name));
            let said = LastLine { state: row.state, at: now, text };
            match self.said.get_mut(k) {
                Some(slot) => *slot = said,
                None => self.said.push(said),
            }
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::super::row::row;
    use super::*;

    #[test]
    fn a_line_appears_for_a_new_state_at_once_and_for_progress_only_now_and_then() {
        let mut lines = Lines::default();
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        let running = |done| [row("train", JobState::Running, done)];
        assert_eq!(lines.changes(&[row("train", JobState::Queued, 0)], at(0)), ["train  queued"]);
        assert_eq!(lines.changes(&running(20), at(1)), ["train    1 %  20 of 2 000 steps"]);
        assert!(lines.changes(&running(40), at(2)).is_empty());
        assert_eq!(lines.changes(&running(200), at(7)), ["train   10 %  200 of 2 000 steps"]);
        let done = [row("train", JobState::Succeeded, 2000)];
        assert_eq!(lines.changes(&done, at(8)), ["train  done, 2 000 steps"]);
    }
}
