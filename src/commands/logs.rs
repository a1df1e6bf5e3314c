//! `torqued logs`: prints the logs of attempts, and follows them.

use std::collections::HashMap;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Args;
use wire::{LogChunk, Logs, left_out};

use crate::arguments::{OutputArguments, ServerArguments};
use crate::client::{Client, ClientError};
use crate::output::write_json;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The job, or a pipeline for all of its jobs
    #[arg(value_name = "JOB")]
    job: i64,

    /// Print lines as they are logged, until the job ends
    #[arg(long, short)]
    follow: bool,

    /// Only logs of this task
    #[arg(long, value_name = "LABEL|ID")]
    task: Option<String>,

    /// Only the log of this attempt; `torqued attempts` lists them
    #[arg(long, value_name = "ID")]
    attempt: Option<i64>,

    /// Number of last lines to begin with
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    lines: u32,

    #[command(flatten)]
    output: OutputArguments,

    #[command(flatten)]
    server: ServerArguments,
}

/// How many seconds the server may wait for a line before it answers.
const WAIT_S: u32 = 20;

/// How long to wait for a server that does not answer. It may be restarting.
const PATIENCE: Duration = Duration::from_secs(30);

/// Pause between two requests that were answered at once.
const PAUSE: Duration = Duration::from_millis(400);

pub async fn run(arguments: Arguments) -> anyhow::Result<ExitCode> {
    let client = arguments.server.client()?;
    let asked = LogRequest {
        client: &client,
        job: arguments.job,
        task: arguments.task.as_deref(),
        attempt: arguments.attempt,
    };
    let (newest, mut next, mut complete) = asked.newest(arguments.lines as usize).await?;
    let mut printer = Printer::new(arguments.output);
    newest.iter().try_for_each(|chunk| printer.print(chunk))?;
    if !arguments.follow {
        if newest.is_empty() && arguments.lines > 0 {
            eprintln!("nothing was logged yet, or the log was deleted");
        }
        return Ok(ExitCode::SUCCESS);
    }
    while !complete {
        let began = Instant::now();
        let page = asked.after(next).await?;
        page.chunks.iter().try_for_each(|chunk| printer.print(chunk))?;
        (next, complete) = (page.next, page.complete);
        if page.chunks.is_empty() && !complete {
            tokio::time::sleep(PAUSE.saturating_sub(began.elapsed())).await;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The requested logs.
struct LogRequest<'a> {
    client: &'a Client,
    job: i64,
    task: Option<&'a str>,
    attempt: Option<i64>,
}

impl LogRequest<'_> {
    /// The last `lines` lines, the `after` for the following ones, and whether the logs are
    /// complete.
    async fn newest(&self, lines: usize) -> Result<(Vec<LogChunk>, i64, bool), ClientError> {
        let mut page = self.page(&[]).await?;
        let (next, complete) = (page.next, page.complete);
        let mut chunks = std::mem::take(&mut page.chunks);
        while let Some(before) = page.previous.filter(|_| count_lines(&chunks) < lines) {
            page = self.page(&[("before", before.to_string())]).await?;
            let mut earlier = std::mem::take(&mut page.chunks);
            earlier.append(&mut chunks);
            chunks = earlier;
        }
        keep_last(&mut chunks, lines);
        Ok((chunks, next, complete))
    }

    /// The next lines, when there are any. Waits for a server that is restarting.
    async fn after(&self, next: i64) -> Result<Logs, ClientError> {
        let parameters = [("after", next.to_string()), ("wait", WAIT_S.to_string())];
        let began = Instant::now();
        loop {
            match self.page(&parameters).await {
                Err(ClientError::Unreachable { .. }) if began.elapsed() < PATIENCE => {
                    tokio::time::sleep(PAUSE).await;
                }
                answer => return answer,
            }
        }
    }

    async fn page(&self, more: &[(&str, String)]) -> Result<Logs, ClientError> {
        let task = self.task.map(|task| ("task", task.to_owned()));
        let attempt = self.attempt.map(|attempt| ("attempt", attempt.to_string()));
        let parameters: Vec<(&str, String)> =
            task.into_iter().chain(attempt).chain(more.iter().cloned()).collect();
        self.client.logs(self.job, &parameters).await
    }
}

fn count_lines(chunks: &[LogChunk]) -> usize {
    chunks.iter().map(|chunk| chunk.text.lines().count()).sum()
}

/// Drops all but the last `lines` lines.
fn keep_last(chunks: &mut Vec<LogChunk>, lines: usize) {
    let mut to_drop = count_lines(chunks).saturating_sub(lines);
    chunks.retain_mut(|chunk| {
        let dropped = chunk.text.lines().count().min(to_drop);
        to_drop -= dropped;
        let bytes: usize = chunk.text.split_inclusive('\n').take(dropped).map(str::len).sum();
        chunk.text.drain(..bytes);
        chunk.position += bytes as u64;
        !chunk.text.is_empty()
    });
}

/// Prints chunks of several attempts. A line before each change of attempt names it. With JSON it
/// prints each chunk as one line.
struct Printer {
    output: OutputArguments,
    /// The last printed attempt.
    last: Option<i64>,
    /// The end of each attempt's last chunk.
    ends: HashMap<i64, u64>,
}

impl Printer {
    fn new(output: OutputArguments) -> Self {
        Self { output, last: None, ends: HashMap::new() }
    }

    fn print(&mut self, chunk: &LogChunk) -> serde_json::Result<()> {
        if self.output.json {
            return write_json(chunk);
        }
        print!("{}", self.render(chunk));
        Ok(())
    }

    fn render(&mut self, chunk: &LogChunk) -> String {
        let mut text = String::new();
        let before = self.last.replace(chunk.attempt);
        if before != Some(chunk.attempt) {
            let gap = if before.is_some() { "\n" } else { "" };
            let LogChunk { label, attempt, worker, .. } = chunk;
            text = format!("{gap}==> {label}, attempt {attempt} on {worker} <==\n");
        }
        if let Some(end) = self.ends.insert(chunk.attempt, chunk.end())
            && end < chunk.position
        {
            text.push_str(&left_out(chunk.position - end));
        }
        text + &chunk.text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(attempt: i64, position: u64, text: &str) -> LogChunk {
        LogChunk {
            id: 1,
            attempt,
            task: attempt,
            label: format!("shard {attempt}"),
            worker: "w1".to_owned(),
            position,
            text: text.to_owned(),
            written_at: String::new(),
        }
    }

    #[test]
    fn lines_of_another_attempt_are_announced_and_gaps_shown() {
        let mut printer = Printer::new(OutputArguments { json: false });
        let chunks =
            [chunk(1, 0, "a\n"), chunk(1, 2, "b\n"), chunk(2, 7, "c\n"), chunk(1, 9, "d\n")];
        let text: String = chunks.iter().map(|chunk| printer.render(chunk)).collect();
        assert_eq!(
            text,
            "==> shard 1, attempt 1 on w1 <==\na\nb\n\n==> shard 2, attempt 2 on w1 <==\nc\n\n\
             ==> shard 1, attempt 1 on w1 <==\n... 5 bytes were left out here ...\nd\n"
        );
    }

    #[test]
    fn the_last_lines_may_begin_in_the_middle_of_a_chunk() {
        let all = || vec![chunk(1, 0, "a\nb\n"), chunk(1, 4, "c\nd\n")];
        let kept = |lines| {
            let mut chunks = all();
            keep_last(&mut chunks, lines);
            chunks
        };
        assert_eq!(kept(3), [chunk(1, 2, "b\n"), chunk(1, 4, "c\nd\n")]);
        assert_eq!(kept(1), [chunk(1, 6, "d\n")]);
        assert_eq!((kept(0), kept(9)), (vec![], all()));
    }
}
