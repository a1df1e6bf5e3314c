//! Destinations and formats of log lines.

mod json;

use std::backtrace::Backtrace;
use std::io::{self, IsTerminal};
use std::panic;
use std::thread;

use clap::ValueEnum;
use tracing_subscriber::filter::{FilterExt as _, LevelFilter};
use tracing_subscriber::layer::{Layer as _, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, fmt, registry};
use worker::AttemptLog;

use crate::cli::{Cli, Command};
use json::JsonLines;

/// The variable for the format of log lines.
pub const LOG_FORMAT: &str = "TORQUED_LOG_FORMAT";

/// The format of log lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    #[default]
    Human,
    Json,
}

impl LogFormat {
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Human => "human",
            Self::Json => "json",
        }
    }
}

/// The part of logging that commands need.
pub struct Logging {
    /// The filter and the format in use, for child processes.
    pub filter: String,
    pub format: LogFormat,
    /// Collects the lines of a worker that belong to its attempt.
    pub attempt: AttemptLog,
}

/// Number of lines of a backtrace that are logged.
const BACKTRACE_LINES: usize = 40;

/// Sends log lines to stderr. Commands show their own progress, so only long-running commands log
/// what they do. A worker also keeps the lines of its attempts: those on stderr, and all from
/// `info` on, whatever the filter is.
pub fn start(cli: &Cli) -> Logging {
    let usual = match cli.command {
        Command::Serve(_) | Command::Worker(_) => "info",
        _ => "warn",
    };
    let filter = cli.log.as_deref().unwrap_or(usual);
    let parsed = || EnvFilter::builder().parse_lossy(filter);
    let attempt = AttemptLog::default();
    let stderr = match cli.log_format {
        LogFormat::Human => {
            fmt::layer().with_writer(io::stderr).with_ansi(io::stderr().is_terminal()).boxed()
        }
        LogFormat::Json => JsonLines { attempt: attempt.clone() }.boxed(),
    };
    let subscriber = registry().with(stderr.with_filter(parsed()));
    if matches!(cli.command, Command::Worker(_)) {
        let lines = attempt.clone();
        let lines = fmt::layer().with_writer(move || lines.clone()).with_ansi(false);
        subscriber.with(lines.with_filter(parsed().or(LevelFilter::INFO))).init();
        log_panics();
    } else {
        subscriber.init();
    }
    Logging { filter: filter.to_owned(), format: cli.log_format, attempt }
}

/// Logs panics of every thread, with the beginning of a backtrace.
fn log_panics() {
    panic::set_hook(Box::new(|panic| {
        let thread = thread::current();
        let name = thread.name().unwrap_or("without a name");
        let place = panic.location().map_or_else(String::new, |place| format!(" at {place}"));
        let message = panic.payload_as_str().unwrap_or("a panic without a message");
        let backtrace = Backtrace::force_capture().to_string();
        tracing::error!("thread {name:?} panicked{place}: {message}\n{}", head(&backtrace));
    }));
}

/// The first lines of a backtrace, without those of the panic itself.
fn head(backtrace: &str) -> String {
    let lines: Vec<&str> = backtrace.lines().collect();
    let machinery = |line: &&str| line.contains("core::panicking::") || line.contains("__rustc");
    // A frame is followed by its position in the source.
    let first = lines.iter().rposition(machinery).map_or(0, |last| last + 2);
    let first = if first < lines.len() { first } else { 0 };
    lines[first..].iter().take(BACKTRACE_LINES).copied().collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_backtrace_begins_where_the_panic_was_and_has_an_end() {
        let frame = |k: usize, name: &str| format!("{k:4}: {name}\n             at file.rs:{k}\n");
        let mut text = frame(0, "std::backtrace::Backtrace::force_capture");
        text += &frame(1, "__rustc::rust_begin_unwind");
        text += &frame(2, "core::panicking::panic_fmt");
        text += &(3..100).map(|k| frame(k, "worker::train::step")).collect::<String>();
        let head = head(&text);
        assert!(head.starts_with("   3: worker::train::step\n"), "{head}");
        assert_eq!(head.lines().count(), BACKTRACE_LINES);
    }
}
