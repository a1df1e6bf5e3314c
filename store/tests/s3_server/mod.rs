//! An S3 server on a loopback port, with a temporary folder for its buckets. Tests choose its
//! faults.
//!
//! It runs on its own threads, so that a test may block while it waits.

use std::collections::{HashMap, VecDeque};
use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use bytes::Bytes;
use futures::StreamExt;
use http_body_util::{BodyExt, StreamBody};
use hyper::body::{Frame, Incoming};
use hyper::header::{CONTENT_LENGTH, LAST_MODIFIED};
use hyper::rt::{Read, Write};
use hyper::{Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use s3s::Body;
use s3s::auth::SimpleAuth;
use s3s::service::{S3Service, S3ServiceBuilder};
use store::{ObjectsUrl, Patience, RemoteObjects, S3Options};
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio_rustls::TlsAcceptor;

pub const BUCKET: &str = "lab";
pub const KEY: &str = "torqued-tests";
pub const SECRET: &str = "not much of a secret";

/// The kind of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Asked {
    List,
    Get,
    Head,
    /// An upload of a whole object.
    Put,
    Copy,
    BeginParts,
    Part,
    Complete,
    Abort,
    Delete,
}

/// The fault of a request.
#[derive(Clone, Copy, Debug)]
pub enum Fault {
    /// Answers 503 instead.
    Busy,
    /// Answers 403 instead.
    Denied,
    /// Answers 404 instead, as if the bucket were gone.
    NoBucket,
    /// Closes the connection in the middle of the request's body.
    BreakOff,
    /// Does the work, and closes the connection without an answer.
    LoseAnswer,
    /// Sends this many bytes of the answer's body and closes the connection.
    CutAnswer(usize),
    /// Sends this many bytes of the answer's body, and then nothing.
    StallAnswer(usize),
    /// Sends this many bytes of the answer's body as if they were all.
    ShortenAnswer(usize),
    /// Flips one bit of the answer's body.
    GarbleAnswer,
    /// Sends the answer's body in small pieces.
    DripAnswer,
    /// Uses a clock that is 28 years behind. The days of the week were the same then.
    OtherClock,
}

/// The protocol of its connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    Plain,
    /// TLS with a certificate of an unknown authority.
    Tls,
}

pub struct S3Server {
    folder: TempDir,
    transport: Transport,
    faults: Arc<Faults>,
    address: SocketAddr,
    /// `None` while the server is down.
    running: Option<Runtime>,
}

#[derive(Default)]
struct Faults {
    planned: Mutex<HashMap<Asked, VecDeque<Fault>>>,
    asked: Mutex<HashMap<Asked, usize>>,
}

impl S3Server {
    /// Starts the server with one empty bucket.
    pub fn start() -> Self {
        Self::start_with(Transport::Plain)
    }

    pub fn start_with(transport: Transport) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join(BUCKET)).unwrap();
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let faults = Arc::default();
        let mut server = Self { folder, transport, faults, address, running: None };
        server.come_back();
        server
    }

    /// Ends the server and all its connections at once.
    pub fn die(&mut self) {
        self.running.take().expect("a server that runs").shutdown_background();
    }

    /// Starts the server again on the same port.
    pub fn come_back(&mut self) {
        let mut runtime = tokio::runtime::Builder::new_multi_thread();
        let runtime = runtime.worker_threads(1).enable_all().build().unwrap();
        let service = {
            let mut service =
                S3ServiceBuilder::new(s3s_fs::FileSystem::new(self.folder.path()).unwrap());
            service.set_auth(SimpleAuth::from_single(KEY, SECRET));
            service.build()
        };
        let address = self.address;
        let bind = async move {
            loop {
                match TcpListener::bind(address).await {
                    // The earlier server may still be closing.
                    Err(error) if error.kind() == ErrorKind::AddrInUse => {
                        tokio::time::sleep(Duration::from_millis(1)).await;
                    }
                    bound => return bound.unwrap(),
                }
            }
        };
        let listener =
            std::thread::scope(|scope| scope.spawn(|| runtime.block_on(bind)).join().unwrap());
        self.address = listener.local_addr().unwrap();
        runtime.spawn(serve(listener, service, self.transport, Arc::clone(&self.faults)));
        self.running = Some(runtime);
    }

    /// The next requests of this kind get these faults, one after the other.
    pub fn fail(&self, asked: Asked, faults: impl IntoIterator<Item = Fault>) {
        lock(&self.faults.planned).entry(asked).or_default().extend(faults);
    }

    /// Number of planned faults of this kind that are left.
    pub fn faults_left(&self, asked: Asked) -> usize {
        lock(&self.faults.planned).get(&asked).map_or(0, VecDeque::len)
    }

    /// Number of requests of this kind so far.
    pub fn count(&self, asked: Asked) -> usize {
        lock(&self.faults.asked).get(&asked).copied().unwrap_or_default()
    }

    pub fn endpoint(&self) -> String {
        match self.transport {
            Transport::Plain => format!("http://{}", self.address),
            Transport::Tls => format!("https://{}", self.address),
        }
    }

    /// The file with the certificate of the server's authority.
    pub fn authority() -> PathBuf {
        PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/s3_server/authority.pem"))
    }

    /// The environment variables with which a program reaches the server.
    pub fn variables(&self) -> Vec<(String, String)> {
        [
            ("TORQUED_S3_ENDPOINT", self.endpoint().as_str()),
            ("AWS_ACCESS_KEY_ID", KEY),
            ("AWS_SECRET_ACCESS_KEY", SECRET),
        ]
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
        .to_vec()
    }

    /// The server's options and `more`, for a client with short timeouts.
    pub fn options(&self, more: &[(&str, &str)]) -> S3Options {
        let owned = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        let mut options =
            S3Options::new(self.variables().into_iter().chain(more.iter().map(owned))).unwrap();
        options.patience = Patience {
            retry_for: Duration::from_secs(20),
            connect_within: Duration::from_secs(5),
            silence: Duration::from_secs(1),
        };
        options
    }

    /// A place for objects in the server's bucket.
    pub fn url(prefix: &str) -> ObjectsUrl {
        format!("s3://{BUCKET}/{prefix}").parse().unwrap()
    }

    /// A prefix of the server's bucket.
    pub async fn objects(&self, prefix: &str) -> RemoteObjects {
        Self::url(prefix).connect(&self.options(&[])).await.unwrap()
    }

    /// The file of an object, or its folder.
    pub fn file(&self, path: &str) -> PathBuf {
        self.folder.path().join(BUCKET).join(path)
    }

    /// Number of parts of uploads that were neither completed nor aborted.
    pub fn parts_left(&self) -> usize {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.starts_with(".upload_id-")).count()
    }
}

impl Drop for S3Server {
    fn drop(&mut self) {
        if let Some(runtime) = self.running.take() {
            runtime.shutdown_background();
        }
    }
}

async fn serve(
    listener: TcpListener,
    service: S3Service,
    transport: Transport,
    faults: Arc<Faults>,
) {
    let tls = TlsAcceptor::from(Arc::new(tls()));
    loop {
        let (socket, _) = listener.accept().await.unwrap();
        let (service, faults, tls) = (service.clone(), Arc::clone(&faults), tls.clone());
        // The end of a connection is the client's business.
        tokio::spawn(async move {
            match transport {
                Transport::Plain => talk(TokioIo::new(socket), service, faults).await,
                Transport::Tls => {
                    let Ok(socket) = tls.accept(socket).await else { return };
                    talk(TokioIo::new(socket), service, faults).await;
                }
            }
        });
    }
}

async fn talk(socket: impl Read + Write + Unpin + Send, service: S3Service, faults: Arc<Faults>) {
    let answer = hyper::service::service_fn(move |request| {
        let (service, faults) = (service.clone(), Arc::clone(&faults));
        async move { answer(request, &service, &faults).await.ok_or(Closed) }
    });
    drop(hyper::server::conn::http1::Builder::new().serve_connection(socket, answer).await);
}

/// A certificate for 127.0.0.1 by [`S3Server::authority`]. Its key is public, and no system trusts
/// its authority.
pub fn tls() -> ServerConfig {
    let certificate = CertificateDer::from_pem_slice(include_bytes!("server.pem")).unwrap();
    let key = PrivateKeyDer::from_pem_slice(include_bytes!("server.key")).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_no_client_auth()
        .with_single_cert(vec![certificate], key)
        .unwrap()
}

/// An error that closes a connection without an answer.
#[derive(Debug, thiserror::Error)]
#[error("closed on purpose")]
struct Closed;

async fn answer(
    request: Request<Incoming>,
    service: &S3Service,
    faults: &Faults,
) -> Option<Response<Body>> {
    let asked = asked(&request);
    *lock(&faults.asked).entry(asked).or_default() += 1;
    let fault = lock(&faults.planned).get_mut(&asked).and_then(VecDeque::pop_front);
    let refused = match fault {
        Some(Fault::Busy) => Some(refusal(StatusCode::SERVICE_UNAVAILABLE, "SlowDown")),
        Some(Fault::Denied) => Some(refusal(StatusCode::FORBIDDEN, "AccessDenied")),
        Some(Fault::NoBucket) => Some(refusal(StatusCode::NOT_FOUND, "NoSuchBucket")),
        Some(Fault::BreakOff) => {
            let _ = request.into_body().frame().await;
            return None;
        }
        _ => None,
    };
    if refused.is_some() {
        // Closing before the whole request is read would look like a broken connection to the
        // client.
        let _ = BodyExt::collect(request.into_body()).await;
        return refused;
    }
    let answer = service.call(request.map(Body::from)).await.ok()?;
    let (mut head, body) = answer.into_parts();
    let Some(fault) = fault else { return Some(Response::from_parts(head, body)) };
    let whole = BodyExt::collect(body).await.ok()?.to_bytes();
    let pieces = match fault {
        Fault::CutAnswer(length) => vec![Ok(whole.slice(..length)), Err(Closed)],
        Fault::StallAnswer(length) => vec![Ok(whole.slice(..length))],
        Fault::ShortenAnswer(length) => {
            head.headers.insert(CONTENT_LENGTH, length.into());
            vec![Ok(whole.slice(..length))]
        }
        Fault::GarbleAnswer => {
            let mut garbled = whole.to_vec();
            garbled[whole.len() / 2] ^= 1;
            vec![Ok(garbled.into())]
        }
        Fault::DripAnswer => whole.chunks(1000).map(|chunk| Ok(whole.slice_ref(chunk))).collect(),
        Fault::OtherClock => {
            if let Some(modified) = head.headers.get_mut(LAST_MODIFIED) {
                let text = earlier(modified.to_str().unwrap(), "");
                *modified = text.parse().unwrap();
            }
            vec![Ok(earlier(std::str::from_utf8(&whole).unwrap(), "<LastModified>").into())]
        }
        Fault::Busy | Fault::Denied | Fault::NoBucket | Fault::BreakOff | Fault::LoseAnswer => {
            return None;
        }
    };
    let frames = pieces.into_iter().map(|piece: Result<Bytes, Closed>| piece.map(Frame::data));
    let frames = futures::stream::iter(frames);
    let body = if matches!(fault, Fault::StallAnswer(_)) {
        Body::http_body_unsync(StreamBody::new(frames.chain(futures::stream::pending())))
    } else {
        Body::http_body_unsync(StreamBody::new(frames))
    };
    Some(Response::from_parts(head, body))
}

/// The same text with years reduced by 28: the first number of four digits after each `mark`.
fn earlier(text: &str, mark: &str) -> String {
    let mut parts: Vec<String> = if mark.is_empty() {
        vec![String::new(), text.to_owned()]
    } else {
        text.split(mark).map(str::to_owned).collect()
    };
    for part in parts.iter_mut().skip(1) {
        let is_year = |at: &usize| {
            let digits = part.get(*at..at + 4);
            digits.is_some_and(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()))
        };
        if let Some(at) = (0..part.len()).find(is_year) {
            let year: u32 = part[at..at + 4].parse().unwrap();
            part.replace_range(at..at + 4, &(year - 28).to_string());
        }
    }
    parts.join(mark)
}

fn asked(request: &Request<Incoming>) -> Asked {
    let query = request.uri().query().unwrap_or_default();
    let has = |name: &str| query.split('&').any(|pair| pair.split('=').next() == Some(name));
    match request.method().as_str() {
        "GET" if has("list-type") => Asked::List,
        "GET" => Asked::Get,
        "HEAD" => Asked::Head,
        "PUT" if has("partNumber") => Asked::Part,
        "PUT" if request.headers().contains_key("x-amz-copy-source") => Asked::Copy,
        "PUT" => Asked::Put,
        "POST" if has("uploads") => Asked::BeginParts,
        "POST" if has("uploadId") => Asked::Complete,
        "DELETE" if has("uploadId") => Asked::Abort,
        "POST" | "DELETE" => Asked::Delete,
        other => panic!("{other}"),
    }
}

fn refusal(status: StatusCode, code: &str) -> Response<Body> {
    let text = format!("<Error><Code>{code}</Code><Message>as planned</Message></Error>");
    Response::builder().status(status).body(Body::from(text)).unwrap()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap()
}
