//! Rows of progress: bars on a terminal, and plain lines otherwise.

use std::collections::VecDeque;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use console::Term;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use wire::{JobState, Progress};

use super::measure;

/// Where progress is shown.
pub enum Display {
    Bars(Bars),
    Lines(Lines),
    Nothing,
}

impl Display {
    pub fn new() -> Self {
        if std::io::stderr().is_terminal() {
            Self::Bars(Bars::new())
        } else {
            Self::Lines(Lines::default())
        }
    }

    /// Bars on a terminal, and nothing otherwise.
    pub fn on_terminal() -> Self {
        match Self::new() {
            Self::Bars(bars) => Self::Bars(bars),
            _ => Self::Nothing,
        }
    }

    pub fn show(&mut self, rows: &[Row]) {
        match self {
            Self::Nothing => {}
            Self::Bars(bars) => bars.show(rows),
            Self::Lines(lines) => {
                for line in lines.changes(rows, Instant::now()) {
                    eprintln!("{line}");
                }
            }
        }
    }

    pub fn finish(self) {
        if let Self::Bars(bars) = self {
            bars.finish();
        }
    }
}

/// One line of the display: a job, or one member of a pipeline.
#[derive(Clone, Debug)]
pub struct Row {
    pub name: String,
    pub state: JobState,
    pub reused: bool,
    pub error: Option<String>,
    /// Why queued tasks wait, besides waiting for their turn.
    pub waits_for: Option<String>,
    pub progress: Progress,
    /// In units of `progress` per second.
    pub rate_per_second: Option<f64>,
}

impl Row {
    /// The description beside the name: state, amount, rate, time left.
    pub fn describe(&self) -> String {
        if self.reused && self.state == JobState::Succeeded {
            return "reused, computed before".to_owned();
        }
        if self.state.is_final()
            && let Some(error) = &self.error
        {
            return format!("{}: {error}", self.state);
        }
        match self.state {
            JobState::Waiting | JobState::Queued | JobState::Cancelled | JobState::Failed => {
                let waits_for = self.waits_for.iter().map(|reason| format!(", {reason}"));
                self.state.to_string() + &waits_for.collect::<String>()
            }
            JobState::Succeeded => format!("done, {}", self.amount()),
            JobState::Running => {
                let mut parts = vec![self.amount()];
                if let Some(rate) = self.rate_per_second.filter(|rate| *rate > 0.0) {
                    parts.push(format!("{}/s", measure::rounded(rate)));
                    let left = self.progress.total.saturating_sub(self.progress.done) as f64 / rate;
                    if let Ok(left) = Duration::try_from_secs_f64(left) {
                        parts.push(format!("ETA {}", measure::duration(left)));
                    }
                }
                parts.extend(self.progress.message.clone());
                parts.extend(self.waits_for.clone());
                parts.join(", ")
            }
        }
    }

    /// For example "8 192 of 16 384 trajectories".
    pub fn amount(&self) -> String {
        let Progress { done, total, unit, .. } = &self.progress;
        let done_of_total = if self.state == JobState::Succeeded || *total == 0 {
            measure::count(*done)
        } else {
            format!("{} of {}", measure::count(*done), measure::count(*total))
        };
        format!("{done_of_total} {unit}").trim_end().to_owned()
    }

    /// Share done, 0 to 1.
    pub fn fraction(&self) -> f64 {
        let Progress { done, total, .. } = self.progress;
        if self.state == JobState::Succeeded {
            1.0
        } else if total > 0 {
            (done as f64 / total as f64).min(1.0)
        } else {
            0.0
        }
    }
}

/// Progress for a terminal: one bar per row, redrawn in place.
pub struct Bars {
    all: MultiProgress,
    bars: Vec<ProgressBar>,
}

/// Number of positions of a bar. It is finer than any terminal is wide.
const RESOLUTION: u64 = 1000;

impl Bars {
    fn new() -> Self {
        Self { all: MultiProgress::new(), bars: Vec::new() }
    }

    fn show(&mut self, rows: &[Row]) {
        let widest = rows.iter().map(|row| row.name.chars().count()).max().unwrap_or_default();
        while self.bars.len() < rows.len() {
            self.bars.push(self.all.add(ProgressBar::new(RESOLUTION)));
        }
        let texts: Vec<String> = rows.iter().map(Row::describe).collect();
        let longest = texts.iter().map(|text| text.chars().count()).max().unwrap_or_default();
        let (_, columns) = Term::stderr().size();
        let style = style(bar_width(columns.into(), widest + longest));
        for ((row, text), bar) in rows.iter().zip(texts).zip(&self.bars) {
            bar.set_style(style.clone());
            bar.set_prefix(format!("{:widest$}", row.name));
            bar.set_message(text);
            bar.set_position(position(row.fraction()));
        }
    }

    /// Leaves the bars on the screen.
    fn finish(self) {
        for bar in &self.bars {
            bar.abandon();
        }
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a fraction of 0 to 1 gives a position of 0 to 1000"
)]
fn position(fraction: f64) -> u64 {
    (fraction * RESOLUTION as f64).round() as u64
}

/// The width of bars beside names and texts that together have `words` characters.
fn bar_width(columns: usize, words: usize) -> usize {
    /// The spaces between name, bar and text.
    const SPACES: usize = 4;

    columns.saturating_sub(words + SPACES).clamp(8, 32)
}

fn style(width: usize) -> ProgressStyle {
    ProgressStyle::with_template(&format!("{{prefix}}  {{bar:{width}.cyan/blue}}  {{wide_msg}}"))
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .progress_chars("━╸─")
}

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
    fn changes(&mut self, rows: &[Row], now: Instant) -> Vec<String> {
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

/// Progress per second over the last half minute, as observed by this client.
#[derive(Debug, Default)]
pub struct Rate {
    seen: VecDeque<(Instant, u64)>,
}

const WINDOW: Duration = Duration::from_secs(30);

impl Rate {
    /// Records `done` at `now`. Returns the rate as soon as there is progress.
    pub fn observe(&mut self, done: u64, now: Instant) -> Option<f64> {
        // Work that was lost with a killed worker is done again, so the measurement begins anew.
        if self.seen.back().is_some_and(|(_, before)| done < *before) {
            self.seen.clear();
        }
        self.seen.push_back((now, done));
        while self.seen.front().is_some_and(|(at, _)| now.duration_since(*at) > WINDOW) {
            self.seen.pop_front();
        }
        let (since, before) = *self.seen.front()?;
        let seconds = now.duration_since(since).as_secs_f64();
        if seconds > 0.0 && done > before { Some((done - before) as f64 / seconds) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, state: JobState, done: u64) -> Row {
        let progress =
            Progress { done, total: 2000, unit: "steps".to_owned(), ..Progress::default() };
        Row {
            name: name.to_owned(),
            state,
            reused: false,
            error: None,
            waits_for: None,
            progress,
            rate_per_second: None,
        }
    }

    #[test]
    fn bars_leave_room_for_the_words_beside_them() {
        let words =
            "train".len() + "178 of 400 steps, 88.1/s, ETA 2s, validation 1.234°".chars().count();
        assert_eq!(bar_width(80, words), 80 - words - 4);
        assert_eq!([bar_width(40, words), bar_width(200, words)], [8, 32]);
    }

    #[test]
    fn a_running_job_shows_amount_rate_and_time_left() {
        let mut running = row("train", JobState::Running, 500);
        running.rate_per_second = Some(12.5);
        assert_eq!(running.describe(), "500 of 2 000 steps, 12.5/s, ETA 2m 00s");
    }

    #[test]
    fn a_queued_job_shows_why_it_waits() {
        let mut queued = row("train", JobState::Queued, 0);
        queued.waits_for = Some("from 2026-12-01T08:00:00Z on".to_owned());
        assert_eq!(queued.describe(), "queued, from 2026-12-01T08:00:00Z on");
    }

    #[test]
    fn a_failed_job_shows_its_reason() {
        let mut failed = row("train", JobState::Failed, 500);
        failed.error = Some("loss is not finite".to_owned());
        assert_eq!(failed.describe(), "failed: loss is not finite");
    }

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

    #[test]
    fn work_done_again_after_a_kill_gives_no_negative_rate() {
        let mut rate = Rate::default();
        let start = Instant::now();
        assert_eq!(rate.observe(100, start), None);
        assert_eq!(rate.observe(200, start + Duration::from_secs(10)), Some(10.0));
        assert_eq!(rate.observe(150, start + Duration::from_secs(11)), None);
        assert_eq!(rate.observe(155, start + Duration::from_secs(12)), Some(5.0));
    }
}
