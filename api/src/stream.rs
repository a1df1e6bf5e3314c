//! A WebSocket and what is said on it: one message, one answer, in this order.
//!
//! The next message is read when the answer to the one before was accepted, so a client that sends
//! faster than it is answered fills its own connection and nothing of ours.

use std::borrow::Cow;
use std::future::Future;

use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use spec::SpecError;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::{Instant, timeout};
use wire::StreamReply;

use crate::app::streams::PredictionStream;
use crate::error::ApiError;
use crate::limits::{STREAM_PING, STREAM_SILENCE, STREAM_WRITE};

/// Answers until the client goes, is silent for too long, or `closing` is done. `_place` is one of
/// the streams that may be open.
pub async fn serve(
    mut socket: WebSocket,
    mut stream: PredictionStream,
    closing: impl Future<Output = ()>,
    _place: OwnedSemaphorePermit,
) {
    let conversation = converse(&mut socket, &mut stream);
    let farewell = tokio::select! {
        farewell = conversation => farewell,
        () = closing => Some((close_code::AWAY, "the server stops".into())),
    };
    if let Some((code, reason)) = farewell {
        let reason = Utf8Bytes::from(reason.into_owned());
        // Who does not take it is gone already.
        let _ = send(&mut socket, Message::Close(Some(CloseFrame { code, reason }))).await;
    }
}

/// Why a stream is closed by us, in numbers of RFC 6455 and in words.
type Farewell = (u16, Cow<'static, str>);

async fn converse(socket: &mut WebSocket, stream: &mut PredictionStream) -> Option<Farewell> {
    let mut heard = Instant::now();
    loop {
        let message = match timeout(STREAM_PING, socket.recv()).await {
            Ok(None) => return None,
            Ok(Some(Ok(message))) => message,
            // Of what tungstenite says, a client can only mend the size.
            Ok(Some(Err(error))) => return Some((close_code::SIZE, error.to_string().into())),
            Err(_) if heard.elapsed() > STREAM_SILENCE => {
                return Some((close_code::POLICY, "nothing was heard for too long".into()));
            }
            Err(_) => {
                send(socket, Message::Ping(axum::body::Bytes::new())).await?;
                continue;
            }
        };
        heard = Instant::now();
        let reply = match message {
            Message::Text(text) => stream.answer(text.as_bytes()).await,
            Message::Binary(_) => {
                let error = SpecError::one("the message", "binary", "text");
                PredictionStream::refusal(&ApiError::Question(error))
            }
            Message::Ping(_) | Message::Pong(_) => continue,
            Message::Close(_) => return None,
        };
        send(socket, Message::Text(text_of(&reply))).await?;
    }
}

/// `None` when the client does not accept it in time, or is gone.
async fn send(socket: &mut WebSocket, message: Message) -> Option<()> {
    timeout(STREAM_WRITE, socket.send(message)).await.ok()?.ok()
}

fn text_of(reply: &StreamReply) -> Utf8Bytes {
    // Strings and finite numbers only, so this cannot fail.
    serde_json::to_string(reply).unwrap_or_default().into()
}
