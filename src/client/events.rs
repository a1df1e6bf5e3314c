//! Follows server-sent events, across lost connections and restarts of the server.

use std::time::{Duration, Instant};

use reqwest::header::ACCEPT;
use reqwest::{Method, Response, StatusCode};
use wire::Event;

use super::{Client, ClientError};

/// How long to wait for a server that does not answer. It may be restarting.
const PATIENCE: Duration = Duration::from_secs(30);

/// Pause before connecting again.
const PAUSE: Duration = Duration::from_millis(400);

/// A silent connection counts as lost after this time. A server sends something at least every 15
/// s.
const SILENCE: Duration = Duration::from_secs(45);

/// A stream lasts as long as its job, so the time limit is long.
const TIMEOUT: Duration = Duration::from_secs(365 * 24 * 60 * 60);

/// The largest number of bytes of a line. An event has one line, and none is that long.
const LONGEST_LINE: usize = 16 << 20;

/// The events at a path of the API. After a lost connection, the next one continues after the last
/// event.
pub struct Events<'a> {
    client: &'a Client,
    path: String,
    /// The id of the last event that had one.
    last: Option<i64>,
    open: Option<(Response, Lines)>,
    was_open: bool,
    /// The time when a connection was last lost.
    lost_at: Instant,
}

impl Client {
    /// The events at `path`: those after the id `after`, or new ones.
    pub fn events(&self, path: String, after: Option<i64>) -> Events<'_> {
        let lost_at = Instant::now();
        Events { client: self, path, last: after, open: None, was_open: false, lost_at }
    }
}

impl Events<'_> {
    /// The next event that this version knows. A job's stream ends with [`Event::End`]; do not call
    /// this after it.
    ///
    /// # Errors
    /// When the server refuses or does not answer. After its first answer, when it does not answer
    /// for 30 s.
    pub async fn next(&mut self) -> Result<Event, ClientError> {
        loop {
            if let Some((_, lines)) = &mut self.open
                && let Some(data) = lines.next_data()
            {
                let Ok(event) = serde_json::from_str::<Event>(&data) else { continue };
                self.last = event.id().or(self.last);
                return Ok(event);
            }
            if self.receive().await {
                continue;
            }
            if self.was_open {
                tokio::time::sleep(PAUSE).await;
            }
            match self.connect().await {
                Ok(response) => {
                    self.open = Some((response, Lines::default()));
                    self.was_open = true;
                }
                Err(error) if self.is_passing(&error) => tokio::time::sleep(PAUSE).await,
                Err(error) => return Err(error),
            }
        }
    }

    /// Whether a server that answered before may answer again soon. A restarted server may have no
    /// room, or no database, for a while.
    fn is_passing(&self, error: &ClientError) -> bool {
        const BUSY: [StatusCode; 2] =
            [StatusCode::SERVICE_UNAVAILABLE, StatusCode::TOO_MANY_REQUESTS];
        let may_pass = match error {
            ClientError::Refused { status, .. } => BUSY.contains(status),
            other => other.is_unreachable(),
        };
        may_pass && self.was_open && self.lost_at.elapsed() < PATIENCE
    }

    /// Receives more of the open stream. Returns false if there is no stream, or it ended.
    async fn receive(&mut self) -> bool {
        let Some((response, lines)) = &mut self.open else { return false };
        match tokio::time::timeout(SILENCE, response.chunk()).await {
            Ok(Ok(Some(chunk))) if lines.take(&chunk) => true,
            _ => {
                self.open = None;
                self.lost_at = Instant::now();
                false
            }
        }
    }

    async fn connect(&self) -> Result<Response, ClientError> {
        let request = self.client.request(Method::GET, &self.path).timeout(TIMEOUT);
        let request = request.header(ACCEPT, "text/event-stream");
        let request = match self.last {
            Some(id) => request.header("last-event-id", id),
            None => request,
        };
        self.client.answer_within(PATIENCE, request).await
    }
}

/// The lines of a stream as they arrive.
#[derive(Debug, Default)]
struct Lines {
    bytes: Vec<u8>,
}

impl Lines {
    /// Adds bytes. Returns false if there was no room.
    fn take(&mut self, chunk: &[u8]) -> bool {
        self.bytes.extend_from_slice(chunk);
        self.bytes.len() <= LONGEST_LINE
    }

    /// The data of the next event, which the API writes in one line. The data also has the event's
    /// id and type.
    fn next_data(&mut self) -> Option<String> {
        while let Some(end) = self.bytes.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.bytes.drain(..=end).collect();
            if let Some(data) = line.strip_prefix(b"data:") {
                return Some(String::from_utf8_lossy(data).trim().to_owned());
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_is_read_whole_however_it_is_cut() {
        let stream =
            b"retry: 1000\n\nid: 7\nevent: gap\ndata: {\"a\": 1}\n\n:\n\ndata:{\"b\": 2}\n\n";
        for cut in 0..stream.len() {
            let (mut lines, mut found) = (Lines::default(), Vec::new());
            for part in [&stream[..cut], &stream[cut..]] {
                assert!(lines.take(part));
                found.extend(std::iter::from_fn(|| lines.next_data()));
            }
            assert_eq!(found, [r#"{"a": 1}"#, r#"{"b": 2}"#], "cut at {cut}");
        }
    }
}
