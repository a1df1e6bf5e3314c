//! A WebSocket and its messages: one message, one answer, in this order.
//!
//! The server reads from the client while it computes an answer, so a client that leaves interrupts
//! the computation. Messages that arrive meanwhile wait for their turn, up to a limit. Beyond it, a
//! client that sends faster than it gets answers fills its own connection, and no memory of the
//! server.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::future::Future;

use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use spec::SpecError;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::{Instant, sleep, timeout};
use tungstenite::error::ProtocolError;
use wire::StreamReply;

use crate::app::streams::PredictionStream;
use crate::error::ApiError;
use crate::limits::{
    STREAM_BACKLOG, STREAM_BACKLOG_BYTES, STREAM_PING, STREAM_PROBE, STREAM_SILENCE, STREAM_WRITE,
};

/// Answers until the client leaves, is silent for too long, or `closing` completes. `_place` is the
/// permit of an open stream.
pub async fn serve(
    socket: WebSocket,
    mut stream: PredictionStream,
    closing: impl Future<Output = ()>,
    _place: OwnedSemaphorePermit,
) {
    let mut client = Client::new(socket);
    let End(farewell) = tokio::select! {
        end = converse(&mut client, &mut stream) => end,
        () = closing => End(Some((close_code::AWAY, "the server stops".into()))),
    };
    if let Some((code, reason)) = farewell {
        let reason = Utf8Bytes::from(reason.into_owned());
        // If the client does not accept it, it is gone already.
        let _ = client.send(Message::Close(Some(CloseFrame { code, reason }))).await;
    }
}

/// The end of a stream. If the server closes it, it has the reason: a code of RFC 6455, and words.
/// Otherwise the client has left.
struct End(Option<(u16, Cow<'static, str>)>);

async fn converse(client: &mut Client, stream: &mut PredictionStream) -> End {
    loop {
        let message = match client.next().await {
            Ok(message) => message,
            Err(end) => return end,
        };
        let reply = match message {
            Message::Text(text) => tokio::select! {
                biased;
                reply = stream.answer(text.into()) => reply,
                end = client.leaves() => return end,
            },
            _ => {
                let error = SpecError::one("the message", "binary", "text");
                PredictionStream::refusal(&ApiError::Question(error))
            }
        };
        if let Err(end) = client.send(Message::Text(text_of(&reply))).await {
            return end;
        }
    }
}

/// The client of a stream.
struct Client {
    socket: WebSocket,
    /// Messages that came while an answer was computed, in order.
    backlog: VecDeque<Message>,
    backlog_bytes: usize,
    heard: Instant,
}

impl Client {
    fn new(socket: WebSocket) -> Self {
        Self { socket, backlog: VecDeque::new(), backlog_bytes: 0, heard: Instant::now() }
    }

    /// The next message with content.
    async fn next(&mut self) -> Result<Message, End> {
        loop {
            if let Some(message) = self.backlog.pop_front() {
                self.backlog_bytes -= length(&message);
                return Ok(message);
            }
            self.listen().await?;
        }
    }

    /// Completes when the client leaves, and never otherwise.
    async fn leaves(&mut self) -> End {
        loop {
            let has_room =
                self.backlog.len() < STREAM_BACKLOG && self.backlog_bytes < STREAM_BACKLOG_BYTES;
            let heard = if has_room {
                self.listen().await
            } else {
                // There is no room to read its close message, but a ping to a closed connection
                // fails.
                sleep(STREAM_PROBE).await;
                self.ping().await
            };
            if let Err(end) = heard {
                return end;
            }
        }
    }

    /// Reads one message into the backlog. If the client is silent, sends it a ping. Pings of the
    /// client are answered meanwhile.
    async fn listen(&mut self) -> Result<(), End> {
        let message = match timeout(STREAM_PING, self.socket.recv()).await {
            Ok(None) => return Err(End(None)),
            Ok(Some(Ok(Message::Close(_)))) => {
                // The answer to a close message is ready, and the next read sends it.
                let _ = timeout(STREAM_WRITE, self.socket.recv()).await;
                return Err(End(None));
            }
            Ok(Some(Ok(message))) => message,
            Ok(Some(Err(error))) => return Err(ended_by(error)),
            Err(_) if self.heard.elapsed() > STREAM_SILENCE => {
                let reason = "nothing was heard for too long";
                return Err(End(Some((close_code::POLICY, reason.into()))));
            }
            Err(_) => return self.ping().await,
        };
        self.heard = Instant::now();
        if matches!(message, Message::Text(_) | Message::Binary(_)) {
            self.backlog_bytes += length(&message);
            self.backlog.push_back(message);
        }
        Ok(())
    }

    async fn ping(&mut self) -> Result<(), End> {
        self.send(Message::Ping(axum::body::Bytes::new())).await
    }

    /// Fails if the client does not accept the message in time, or is gone.
    async fn send(&mut self, message: Message) -> Result<(), End> {
        match timeout(STREAM_WRITE, self.socket.send(message)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) | Err(_) => Err(End(None)),
        }
    }
}

/// The end of a stream whose client violated the protocol (RFC 6455, section 7.4.1).
fn ended_by(error: axum::Error) -> End {
    let error = error.into_inner();
    let code = match error.downcast_ref::<tungstenite::Error>() {
        Some(tungstenite::Error::Capacity(_)) => close_code::SIZE,
        Some(tungstenite::Error::Utf8(_)) => close_code::INVALID,
        Some(tungstenite::Error::Protocol(ProtocolError::ResetWithoutClosingHandshake)) => {
            return End(None);
        }
        Some(tungstenite::Error::Protocol(_)) => close_code::PROTOCOL,
        _ => return End(None),
    };
    let mut reason = error.to_string();
    // A control frame has at most 125 bytes, and the code takes two of them.
    reason.truncate(reason.floor_char_boundary(123));
    End(Some((code, reason.into())))
}

fn length(message: &Message) -> usize {
    match message {
        Message::Text(text) => text.as_str().len(),
        Message::Binary(bytes) => bytes.len(),
        Message::Ping(_) | Message::Pong(_) | Message::Close(_) => 0,
    }
}

fn text_of(reply: &StreamReply) -> Utf8Bytes {
    // It has only strings and finite numbers, so this cannot fail.
    serde_json::to_string(reply).unwrap_or_default().into()
}
