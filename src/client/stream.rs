//! A prediction stream: a WebSocket to the server.

use futures::{SinkExt as _, StreamExt as _};
use reqwest::header::{CONNECTION, SEC_WEBSOCKET_KEY, SEC_WEBSOCKET_VERSION, UPGRADE};
use reqwest::{Method, StatusCode, Upgraded};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::handshake::client::generate_key;
use tokio_tungstenite::tungstenite::protocol::Role;
use tokio_tungstenite::tungstenite::{Error, Message};

use super::{Client, ClientError};
use crate::resource::Reference;

/// An open stream. Its messages are JSON; docs/prediction.md describes them.
pub struct Stream {
    server: String,
    socket: WebSocketStream<Upgraded>,
}

impl Client {
    /// Opens a prediction stream with a checkpoint.
    pub async fn stream(&self, checkpoint: &Reference) -> Result<Stream, ClientError> {
        let request = self
            .request(Method::GET, &format!("/v1/checkpoints/{checkpoint}/stream"))
            .header(CONNECTION, "Upgrade")
            .header(UPGRADE, "websocket")
            .header(SEC_WEBSOCKET_VERSION, "13")
            .header(SEC_WEBSOCKET_KEY, generate_key());
        let response = request.send().await.map_err(self.unreachable())?;
        let status = response.status();
        if status != StatusCode::SWITCHING_PROTOCOLS {
            let problem = response.text().await.map_err(self.unreachable())?;
            return Err(ClientError::refused(status, &problem));
        }
        let connection = response.upgrade().await.map_err(self.unreachable())?;
        let socket = WebSocketStream::from_raw_socket(connection, Role::Client, None).await;
        Ok(Stream { server: self.server(), socket })
    }
}

impl Stream {
    pub async fn send(&mut self, message: String) -> Result<(), ClientError> {
        let sent = self.socket.send(Message::text(message)).await;
        sent.map_err(|reason| self.broken(reason.to_string()))
    }

    /// The next message. Pings of the server are answered meanwhile.
    ///
    /// # Errors
    /// When the server closes the stream, or the connection breaks off.
    pub async fn receive(&mut self) -> Result<String, ClientError> {
        loop {
            match self.socket.next().await {
                Some(Ok(Message::Text(text))) => return Ok(text.as_str().to_owned()),
                Some(Ok(Message::Close(Some(frame)))) => {
                    let code = u16::from(frame.code);
                    return Err(self.broken(format!("closed with {code}, {}", frame.reason)));
                }
                Some(Ok(Message::Close(None))) | None | Some(Err(Error::ConnectionClosed)) => {
                    return Err(self.broken("closed".to_owned()));
                }
                Some(Ok(_)) => {}
                Some(Err(reason)) => return Err(self.broken(reason.to_string())),
            }
        }
    }

    /// Closes the stream in order.
    pub async fn close(mut self) {
        // An error does not matter, because the server is gone then.
        let _ = self.socket.close(None).await;
    }

    fn broken(&self, reason: String) -> ClientError {
        ClientError::Stream { server: self.server.clone(), reason }
    }
}
