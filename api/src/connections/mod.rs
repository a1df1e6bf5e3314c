//! Connections: where they come from, how many there are, and how long each may be silent.

mod places;
mod request_body;

use std::convert::Infallible;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::Request;
use http_body_util::BodyExt as _;
use hyper::body::{Body as _, Incoming};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use places::{ClientConnection, Places};
use request_body::RequestBody;
use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream, UnixListener, UnixStream};
use tokio::sync::Semaphore;
use tokio::time::Instant;
use tokio_io_timeout::TimeoutStream;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::ServiceExt as _;

use crate::limits::{HEAD_BYTES, HEAD_FIELDS, HEAD_WITHIN, WRITE_STALL, share_of_connections};
use crate::remote::TrustedProxies;

/// Pause before the next try if a connection could not be accepted, e.g. because no descriptors are
/// left.
const RETRY: Duration = Duration::from_secs(1);

/// How long the end of an answer may take if its connection gives its place to another one.
const LAST_BYTES: Duration = Duration::from_millis(100);

/// How long a new connection always keeps its place, so that a request that came with it is read.
const ARRIVAL: Duration = Duration::from_millis(50);

/// The listener of a server.
#[derive(Debug)]
pub enum Listener {
    /// A TCP socket, for everybody who can reach its address.
    Tcp(TcpListener),
    /// A Unix socket, for every user who may open its file.
    Unix(UnixListener),
}

impl From<TcpListener> for Listener {
    fn from(listener: TcpListener) -> Self {
        Self::Tcp(listener)
    }
}

impl From<UnixListener> for Listener {
    fn from(listener: UnixListener) -> Self {
        Self::Unix(listener)
    }
}

/// The address of a request's client, if it came over a network.
#[derive(Clone, Copy, Debug)]
pub struct Peer(pub IpAddr);

/// The connection of a request.
#[derive(Clone)]
pub struct Connection(Arc<ClientConnection>);

impl Connection {
    /// Lets the present request keep its place while its body arrives, however long that takes.
    pub fn keep(&self) {
        self.0.keep();
    }
}

enum Stream {
    Tcp(TcpStream, Peer),
    Unix(UnixStream),
}

impl Stream {
    fn address(&self) -> Option<IpAddr> {
        match self {
            Self::Tcp(_, Peer(address)) => Some(*address),
            Self::Unix(_) => None,
        }
    }

    /// Tells the client that it has as many connections as it may have, if it reads that.
    async fn refuse(self, answer: &str) {
        let written = async {
            match self {
                Self::Tcp(mut stream, _) => stream.write_all(answer.as_bytes()).await,
                Self::Unix(mut stream) => stream.write_all(answer.as_bytes()).await,
            }
        };
        // A new connection has room for it.
        let _ = tokio::time::timeout(LAST_BYTES, written).await;
    }
}

/// How many connections there may be.
pub struct ConnectionLimits {
    pub connections: usize,
    /// Proxies, which have no share because they have many clients.
    pub proxies: TrustedProxies,
    /// The answer to an address with too many connections.
    pub refusal: String,
}

impl Listener {
    /// The address that other machines can reach, if there is one.
    pub fn open_address(&self) -> io::Result<Option<SocketAddr>> {
        match self {
            Self::Tcp(listener) => {
                Ok(Some(listener.local_addr()?).filter(|address| !address.ip().is_loopback()))
            }
            Self::Unix(_) => Ok(None),
        }
    }

    async fn accept(&self) -> io::Result<Stream> {
        match self {
            Self::Tcp(listener) => {
                let (stream, from) = listener.accept().await?;
                // Otherwise a prediction of a stream would be delayed, to be sent together with the
                // next one.
                let _ = stream.set_nodelay(true);
                Ok(Stream::Tcp(stream, Peer(from.ip().to_canonical())))
            }
            Self::Unix(listener) => Ok(Stream::Unix(listener.accept().await?.0)),
        }
    }
}

/// Answers requests on a limited number of connections until `stop`. An address has a share of
/// them, unless it is a proxy or this machine. After that, running requests
/// are answered and idle connections are closed. Returns when the last connection has ended.
pub async fn serve(
    listener: Listener,
    router: Router,
    limits: ConnectionLimits,
    stop: CancellationToken,
) {
    let ConnectionLimits { connections, proxies, refusal } = limits;
    let free = Arc::new(Semaphore::new(connections));
    let (open, places) = (TaskTracker::new(), Places::new(share_of_connections(connections)));
    let accept = async {
        loop {
            let stream = match listener.accept().await {
                Ok(stream) => stream,
                Err(error) if is_of_one_connection(&error) => continue,
                Err(error) => {
                    tracing::error!(%error, "cannot accept a connection");
                    tokio::time::sleep(RETRY).await;
                    continue;
                }
            };
            let network = proxies.network(stream.address());
            if network.is_some_and(|network| !places.admit(network)) {
                stream.refuse(&refusal).await;
                continue;
            }
            if free.available_permits() == 0 {
                places.close_one();
            }
            // The semaphore is never closed.
            let Ok(place) = Arc::clone(&free).acquire_owned().await else { return };
            // Registered before the next connection comes, which may need this one's place.
            let client = places.register(network);
            let (router, stop) = (router.clone(), stop.clone());
            open.spawn(async move {
                match stream {
                    Stream::Tcp(stream, peer) => {
                        answer(stream, Some(peer), router, client, stop).await;
                    }
                    Stream::Unix(stream) => answer(stream, None, router, client, stop).await,
                }
                drop(place);
            });
        }
    };
    let _ = stop.run_until_cancelled(accept).await;
    drop(listener);
    open.close();
    open.wait().await;
}

fn is_of_one_connection(error: &io::Error) -> bool {
    use io::ErrorKind as K;
    matches!(error.kind(), K::ConnectionAborted | K::ConnectionRefused | K::ConnectionReset)
}

/// Answers the requests of one connection.
async fn answer<S>(
    stream: S,
    peer: Option<Peer>,
    router: Router,
    client: Arc<ClientConnection>,
    stop: CancellationToken,
) where
    S: AsyncRead + AsyncWrite + Send + 'static,
{
    let arrived = Instant::now() + ARRIVAL;
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(WRITE_STALL));
    let request_client = Arc::clone(&client);
    let service = tower::service_fn(move |mut request: Request<Incoming>| {
        let has_body = !request.body().is_end_stream();
        let (router, request_guard) = (router.clone(), request_client.begin_request(has_body));
        if let Some(peer) = peer {
            request.extensions_mut().insert(peer);
        }
        let connection = Connection(Arc::clone(&request_client));
        request.extensions_mut().insert(connection.clone());
        let request = request.map(|body| Body::new(RequestBody::new(body, connection)));
        async move {
            let answer = router.oneshot(request).await?;
            // The request is running until its answer is sent.
            Ok::<_, Infallible>(answer.map(|body| {
                body.map_frame(move |frame| {
                    let _held = &request_guard;
                    frame
                })
            }))
        }
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_WITHIN)
        .max_buf_size(HEAD_BYTES)
        .max_headers(HEAD_FIELDS)
        .serve_connection(TokioIo::new(Box::pin(stream)), TowerToHyperService::new(service))
        .with_upgrades();
    let mut connection = pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => ended,
        () = client.close_requested() => match tokio::time::timeout_at(arrived, connection.as_mut()).await {
            Ok(ended) => ended,
            Err(_) if client.has_running_request() => {
                connection.as_mut().graceful_shutdown();
                connection.as_mut().await
            }
            Err(_) if client.is_receiving() => Ok(()),
            Err(_) if client.has_had_request() => {
                connection.as_mut().graceful_shutdown();
                tokio::time::timeout(LAST_BYTES, connection.as_mut()).await.unwrap_or(Ok(()))
            }
            Err(_) => Ok(()),
        },
        () = stop.cancelled() => {
            connection.as_mut().graceful_shutdown();
            connection.as_mut().await
        }
    };
    client.end();
    if let Err(error) = ended {
        tracing::debug!(%error, "a connection broke off");
    }
}
