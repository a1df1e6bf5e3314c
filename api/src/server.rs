//! Listening, and ending in time.

use std::future::{Future, IntoFuture as _};
use std::io;
use std::net::SocketAddr;

use axum::serve::ListenerExt as _;
use thiserror::Error;
use tokio::net::TcpListener;
use tokio::sync::oneshot;

use crate::app::App;
use crate::limits::SHUTDOWN_GRACE;
use crate::routes;

#[derive(Debug, Error)]
pub enum ServeError {
    #[error(
        "listening on {address} is open to the network and needs a token; \
         set one, or listen on 127.0.0.1"
    )]
    OpenWithoutToken { address: SocketAddr },

    #[error("serving HTTP failed")]
    Io(#[from] io::Error),
}

/// Answers requests until `shutdown` is done, and the requests then under way for
/// [`SHUTDOWN_GRACE`] more.
///
/// # Errors
/// [`ServeError::OpenWithoutToken`] when `listener` can be reached from other machines and `app`
/// has no token.
pub async fn serve(
    listener: TcpListener,
    app: App,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> Result<(), ServeError> {
    let address = listener.local_addr()?;
    if app.token().is_none() && !address.ip().is_loopback() {
        return Err(ServeError::OpenWithoutToken { address });
    }
    let (stop, stopped) = oneshot::channel::<()>();
    let streams = app.clone();
    // A prediction of a stream is small and late if it waits to be sent together with the next.
    let listener = listener.tap_io(|connection| {
        let _ = connection.set_nodelay(true);
    });
    let server = axum::serve(listener, routes::router(app)).with_graceful_shutdown(async {
        // A dropped sender means that this function was dropped: stop as well.
        let _ = stopped.await;
    });
    let deadline = async {
        shutdown.await;
        streams.close_streams();
        let _ = stop.send(());
        tokio::time::sleep(SHUTDOWN_GRACE).await;
    };
    // Streams are no connections to the server any more.
    let served = async {
        let ended = server.into_future().await;
        streams.streams_closed().await;
        ended
    };
    tokio::select! {
        ended = served => Ok(ended?),
        () = deadline => Ok(()),
    }
}
