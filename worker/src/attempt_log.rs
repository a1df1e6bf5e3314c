//! The log of this process's attempt. Lines are buffered here and sent to the store.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use store::{Fence, NewLogChunk, Store, StoreError};

/// The log of this process's attempt. A process has only one attempt at a time, so the lines of all
/// threads belong to it. Between attempts, lines are dropped. Clones share it.
///
/// It is a writer for `tracing_subscriber`, which writes each event at once. Writing only adds a
/// line to memory, whatever the database does. The memory has a limit: it keeps the beginning and
/// the end of the log, like the store.
#[derive(Clone, Debug, Default)]
pub struct AttemptLog {
    lines: Arc<Mutex<Option<Lines>>>,
    current: Arc<Mutex<Option<CurrentAttempt>>>,
    /// Held while lines are sent, so that none is sent twice.
    sending: Arc<tokio::sync::Mutex<()>>,
}

/// The current attempt of a process, which marks its lines.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CurrentAttempt {
    /// The id of the task's job.
    pub job: i64,
    /// The task's label.
    pub task: String,
    /// The fencing number of the lease.
    pub epoch: i64,
}

/// Largest number of bytes of one event. A longer one is cut.
const EVENT_BYTES: usize = 8 << 10;

/// Largest number of chunks that are written in one transaction.
const CHUNKS_AT_ONCE: usize = 16;

/// Lines that were not sent to the store yet.
#[derive(Debug, Default)]
struct Lines {
    /// Number of bytes logged so far, including dropped lines.
    logged: u64,
    /// Lines from the beginning of the log.
    head: VecDeque<Line>,
    /// The newest of the later lines.
    tail: VecDeque<Line>,
    tail_bytes: u64,
}

#[derive(Clone, Debug)]
struct Line {
    position: u64,
    text: String,
}

impl AttemptLog {
    /// Begins a log for a new attempt. Later lines belong to it.
    pub(crate) fn begin(&self, attempt: CurrentAttempt) {
        *self.lock() = Some(Lines::default());
        *self.lock_current() = Some(attempt);
    }

    /// Ends the log of the attempt. Lines that were not sent are lost.
    pub(crate) fn end(&self) {
        *self.lock() = None;
        *self.lock_current() = None;
    }

    /// The attempt that lines belong to, if there is one.
    pub fn current(&self) -> Option<CurrentAttempt> {
        self.lock_current().clone()
    }

    fn lock_current(&self) -> MutexGuard<'_, Option<CurrentAttempt>> {
        self.current.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends all lines to the store.
    ///
    /// # Errors
    /// When the database fails or the lease is lost. Unwritten lines are kept for another try.
    pub(crate) async fn send(&self, store: &Store, fence: Fence) -> Result<(), StoreError> {
        let _sending = self.sending.lock().await;
        loop {
            let chunks = self.lock().as_ref().map(Lines::chunks).unwrap_or_default();
            let Some(last) = chunks.last() else { return Ok(()) };
            store.append_log(fence, &chunks).await?;
            if let Some(lines) = &mut *self.lock() {
                lines.forget_until(last.end());
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Option<Lines>> {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl io::Write for AttemptLog {
    fn write(&mut self, event: &[u8]) -> io::Result<usize> {
        if let Some(lines) = &mut *self.lock() {
            lines.add(text_of(event));
        }
        Ok(event.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The lines of an event, without characters that a terminal or a database could not handle.
fn text_of(event: &[u8]) -> String {
    let text = String::from_utf8_lossy(event);
    let mut text: String = text
        .trim_end()
        .chars()
        .map(|c| if c.is_control() && !matches!(c, '\n' | '\t') { '\u{fffd}' } else { c })
        .collect();
    if text.len() > EVENT_BYTES {
        let kept = text.floor_char_boundary(EVENT_BYTES);
        let cut = text.len() - kept;
        text.truncate(kept);
        text.push_str(&format!(" ... {cut} bytes more"));
    }
    text.push('\n');
    text
}

impl Lines {
    fn add(&mut self, text: String) {
        let line = Line { position: self.logged, text };
        self.logged = line.end();
        if line.position < Store::LOG_HEAD_BYTES {
            self.head.push_back(line);
            return;
        }
        self.tail_bytes += line.text.len() as u64;
        self.tail.push_back(line);
        while self.tail_bytes > Store::LOG_TAIL_BYTES {
            self.forget_first_of_tail();
        }
    }

    /// The oldest lines, in chunks.
    fn chunks(&self) -> Vec<NewLogChunk> {
        let mut chunks: Vec<NewLogChunk> = Vec::new();
        for line in self.head.iter().chain(&self.tail) {
            let are_enough = chunks.len() == CHUNKS_AT_ONCE;
            match chunks.last_mut() {
                Some(chunk)
                    if chunk.end() == line.position
                        && chunk.text.len() + line.text.len() <= Store::LOG_CHUNK_BYTES =>
                {
                    chunk.text.push_str(&line.text);
                }
                _ if are_enough => break,
                _ => chunks.push(NewLogChunk { position: line.position, text: line.text.clone() }),
            }
        }
        chunks
    }

    /// Drops the lines that end at `position` or before.
    fn forget_until(&mut self, position: u64) {
        while self.head.front().is_some_and(|line| line.end() <= position) {
            self.head.pop_front();
        }
        while self.tail.front().is_some_and(|line| line.end() <= position) {
            self.forget_first_of_tail();
        }
    }

    fn forget_first_of_tail(&mut self) {
        if let Some(line) = self.tail.pop_front() {
            self.tail_bytes -= line.text.len() as u64;
        }
    }
}

impl Line {
    fn end(&self) -> u64 {
        self.position + self.text.len() as u64
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn unsent(log: &AttemptLog) -> Vec<NewLogChunk> {
        log.lock().as_ref().unwrap().chunks()
    }

    #[test]
    fn lines_between_attempts_belong_to_none() {
        let mut log = AttemptLog::default();
        log.write_all(b"before\n").unwrap();
        log.begin(CurrentAttempt::default());
        log.write_all(b"during\n").unwrap();
        assert_eq!(unsent(&log), [NewLogChunk { position: 0, text: "during\n".to_owned() }]);
        log.end();
        log.write_all(b"after\n").unwrap();
        log.begin(CurrentAttempt::default());
        assert_eq!(unsent(&log), []);
    }

    #[test]
    fn lines_of_all_threads_belong_to_the_attempt() {
        let log = AttemptLog::default();
        log.begin(CurrentAttempt::default());
        std::thread::scope(|scope| {
            for _ in 0..4 {
                let mut log = log.clone();
                scope.spawn(move || (0..100).for_each(|_| log.write_all(b"line\n").unwrap()));
            }
        });
        assert_eq!(unsent(&log)[0].text, "line\n".repeat(400));
    }

    /// Tests the limit without a database that takes the lines.
    #[test]
    fn memory_for_lines_has_a_limit_and_what_is_left_out_shows() {
        let mut log = AttemptLog::default();
        log.begin(CurrentAttempt::default());
        let line = format!("{}\n", "x".repeat(999));
        for _ in 0..5000 {
            log.write_all(line.as_bytes()).unwrap();
        }
        let mut lines = log.lock().take().unwrap();
        let held: u64 =
            lines.head.iter().chain(&lines.tail).map(|line| line.text.len() as u64).sum();
        assert!(held <= Store::LOG_HEAD_BYTES + Store::LOG_TAIL_BYTES + 1000, "{held}");
        assert_eq!(lines.logged, 5_000_000);
        let mut gaps = 0;
        let mut end = 0;
        while let Some(chunk) = lines.chunks().first() {
            assert!(chunk.text.len() <= Store::LOG_CHUNK_BYTES && chunk.text.ends_with('\n'));
            gaps += usize::from(chunk.position != end);
            end = chunk.end();
            lines.forget_until(end);
        }
        assert_eq!((gaps, end), (1, 5_000_000));
    }

    #[test]
    fn a_long_event_is_cut_and_its_control_characters_are_replaced() {
        assert_eq!(text_of(b"a\x1b[31mb\0c\td\ne\r\n"), "a\u{fffd}[31mb\u{fffd}c\td\ne\n");
        let long = "ä".repeat(EVENT_BYTES);
        let text = text_of(long.as_bytes());
        assert!(text.ends_with(&format!("ä ... {EVENT_BYTES} bytes more\n")), "{}", &text[8100..]);
        assert!(text.len() < Store::LOG_CHUNK_BYTES);
    }
}
