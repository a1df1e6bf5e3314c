use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use super::row::Row;

/// Progress for a terminal: one bar per row, redrawn in place.
pub struct Bars {
    all: MultiProgress,
    bars: Vec<ProgressBar>,
}

/// Number of positions of a bar. It is finer than any terminal is wide.
const RESOLUTION: u64 = 1000;

impl Bars {
    pub fn new() -> Self {
        Self { all: MultiProgress::new(), bars: Vec::new() }
    }

    pub fn show(&mut self, rows: &[Row]) {
        let widest = rows.iter().map(|row| row.name.chars().count()).max().unwrap_or_default();
        while self.bars.len() < rows.len() {
            let bar = ProgressBar::new(RESOLUTION).with_style(style());
            self.bars.push(self.all.add(bar));
        }
        for (row, bar) in rows.iter().zip(&self.bars) {
            bar.set_prefix(format!("{:widest$}", row.name));
            bar.set_message(row.describe());
            bar.set_position(position(row.fraction()));
        }
    }

    /// Leaves the bars on the screen.
    pub fn finish(self) {
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

fn style() -> ProgressStyle {
    ProgressStyle::with_template("{prefix}  {bar:32.cyan/blue}  {wide_msg}")
        .unwrap_or_else(|_| ProgressStyle::default_bar())
        .progress_chars("━╸─")
}
