//! Destinations and formats of log lines.

use std::backtrace::Backtrace;
use std::fmt::Debug;
use std::io::{self, IsTerminal, Write};
use std::panic;
use std::thread;
use std::time::SystemTime;

use clap::ValueEnum;
use serde_json::{Map, Value};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Subscriber};
use tracing_subscriber::filter::{FilterExt as _, LevelFilter};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt as _};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, fmt, registry};
use worker::AttemptLog;

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

/// The part that this process plays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    Server,
    Worker,
    Command,
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
pub fn start(program: Program, filter: Option<&str>, format: LogFormat) -> Logging {
    let usual = match program {
        Program::Server | Program::Worker => "info",
        Program::Command => "warn",
    };
    let filter = filter.unwrap_or(usual);
    let parsed = || EnvFilter::builder().parse_lossy(filter);
    let attempt = AttemptLog::default();
    let stderr = match format {
        LogFormat::Human => {
            fmt::layer().with_writer(io::stderr).with_ansi(io::stderr().is_terminal()).boxed()
        }
        LogFormat::Json => JsonLines { attempt: attempt.clone() }.boxed(),
    };
    let subscriber = registry().with(stderr.with_filter(parsed()));
    if program == Program::Worker {
        let lines = attempt.clone();
        let lines = fmt::layer().with_writer(move || lines.clone()).with_ansi(false);
        subscriber.with(lines.with_filter(parsed().or(LevelFilter::INFO))).init();
        log_panics();
    } else {
        subscriber.init();
    }
    Logging { filter: filter.to_owned(), format, attempt }
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

/// Writes events to stderr. An event includes the fields of the spans around it, such as the
/// `request`. A worker's events have the `job`, `task` and `epoch` of its attempt.
pub struct JsonLines {
    pub attempt: AttemptLog,
}

/// The fields of a span, kept while it is open.
#[derive(Default)]
struct Fields(Map<String, Value>);

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for JsonLines {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        let mut fields = Fields::default();
        attributes.record(&mut fields);
        if let Some(span) = context.span(id) {
            span.extensions_mut().insert(fields);
        }
    }

    fn on_record(&self, id: &Id, values: &Record<'_>, context: Context<'_, S>) {
        if let Some(span) = context.span(id)
            && let Some(fields) = span.extensions_mut().get_mut::<Fields>()
        {
            values.record(fields);
        }
    }

    fn on_event(&self, event: &Event<'_>, context: Context<'_, S>) {
        let metadata = event.metadata();
        let mut line = Map::new();
        let now = humantime::format_rfc3339_micros(SystemTime::now()).to_string();
        line.insert("time".to_owned(), now.into());
        line.insert("level".to_owned(), metadata.level().as_str().to_lowercase().into());
        line.insert("target".to_owned(), metadata.target().into());
        if let Some(attempt) = self.attempt.current() {
            line.insert("job".to_owned(), attempt.job.into());
            line.insert("task".to_owned(), attempt.task.into());
            line.insert("epoch".to_owned(), attempt.epoch.into());
        }
        for span in
            context.event_scope(event).into_iter().flatten().collect::<Vec<_>>().iter().rev()
        {
            if let Some(fields) = span.extensions().get::<Fields>() {
                line.extend(fields.0.clone());
            }
        }
        let mut fields = Fields(line);
        event.record(&mut fields);
        let mut text = Value::Object(fields.0).to_string();
        text.push('\n');
        // An error is ignored, because stderr is closed then.
        let _ = io::stderr().lock().write_all(text.as_bytes());
    }
}

impl Visit for Fields {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        self.0.insert(field.name().to_owned(), format!("{value:?}").into());
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        self.0.insert(field.name().to_owned(), value.into());
    }

    fn record_i64(&mut self, field: &Field, value: i64) {
        self.0.insert(field.name().to_owned(), value.into());
    }

    fn record_u64(&mut self, field: &Field, value: u64) {
        self.0.insert(field.name().to_owned(), value.into());
    }

    fn record_f64(&mut self, field: &Field, value: f64) {
        self.0.insert(field.name().to_owned(), value.into());
    }

    fn record_bool(&mut self, field: &Field, value: bool) {
        self.0.insert(field.name().to_owned(), value.into());
    }
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
