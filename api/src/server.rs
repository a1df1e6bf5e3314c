//! Listens for requests, and stops in time.

use std::future::Future;
use std::io;
use std::net::SocketAddr;

use store::StoreError;
use thiserror::Error;
use tokio_util::sync::CancellationToken;

use crate::app::App;
use crate::connections::{self, ConnectionLimits, Listener};
use crate::error::ApiError;
use crate::limits::SHUTDOWN_GRACE;
use crate::remote::TrustedProxies;
use crate::routes;

/// Why a server does not start, or ends.
#[derive(Debug, Error)]
pub enum ServeError {
    /// Everybody who can reach the address could use the server.
    #[error(
        "other machines can reach {address}, so the server needs a token; set one, or listen on \
         127.0.0.1"
    )]
    OpenWithoutToken {
        /// The address that the server should listen on.
        address: SocketAddr,
    },

    /// The system refuses connections.
    #[error("serving HTTP failed")]
    Io(#[from] io::Error),

    /// The database failed.
    #[error("cannot tell whether the server requires a token")]
    Store(#[from] StoreError),
}

/// Answers requests until `shutdown` completes. Running requests then have another
/// [`SHUTDOWN_GRACE`].
///
/// # Errors
/// [`ServeError::OpenWithoutToken`] when other machines can reach `listener` and `app` requires no
/// token. Also when the database fails.
pub async fn serve(
    listener: impl Into<Listener>,
    app: App,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> Result<(), ServeError> {
    let listener = listener.into();
    if app.access().is_open().await?
        && let Some(address) = listener.open_address()?
    {
        return Err(ServeError::OpenWithoutToken { address });
    }
    let stop = CancellationToken::new();
    // When this function is dropped, connections end too.
    let _stop = stop.clone().drop_guard();
    // WebSocket streams no longer count as connections of the server.
    let served = async {
        let router = routes::router(app.clone());
        let limits = ConnectionLimits {
            connections: app.options().connections,
            proxies: TrustedProxies::new(&app.options().trusted_proxies),
            refusal: refusal(),
        };
        connections::serve(listener, router, limits, stop.clone()).await;
        app.places().streams_closed().await;
    };
    let deadline = async {
        shutdown.await;
        app.places().close();
        stop.cancel();
        tokio::time::sleep(SHUTDOWN_GRACE).await;
    };
    tokio::select! {
        () = served => {}
        () = deadline => {}
    }
    Ok(())
}

/// The answer to an address with too many connections. No request was read.
fn refusal() -> String {
    let problem = ApiError::AddressCrowded.to_problem();
    let body = serde_json::to_string(&problem).unwrap_or_default();
    format!(
        "HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/problem+json\r\n\
         Retry-After: 1\r\nConnection: close\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    )
}
