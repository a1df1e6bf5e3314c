//! Clients that send nothing, half a request, too much, or too many requests.

use std::net::SocketAddr;
use std::num::NonZero;
use std::time::{Duration, Instant};

use api::limits::{BODY_WITHIN, CONCURRENT_DOWNLOADS, HEAD_WITHIN};
use api::{App, Options};
use axum::body::Body;
use axum::http::Request;
use store::{Access, Store};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use crate::fixture::Server;

const REQUEST: &[u8] = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n";
const HALF: &[u8] = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n";
/// More than any deadline, for a busy machine.
const LATE: Duration = Duration::from_secs(10);

struct Listening {
    address: SocketAddr,
    _folder: tempfile::TempDir,
}

impl Listening {
    async fn with(options: &Options) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Access::Server).await.unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let app = App::new(store, options);
        tokio::spawn(api::serve(listener, app, std::future::pending()));
        Self { address, _folder: folder }
    }

    async fn connect(&self) -> TcpStream {
        TcpStream::connect(self.address).await.unwrap()
    }

    /// A connection on which `said` was sent.
    async fn having_said(&self, said: &[u8]) -> TcpStream {
        let mut connection = self.connect().await;
        connection.write_all(said).await.unwrap();
        connection
    }
}

/// The head of an answer.
async fn head(connection: &mut TcpStream) -> String {
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        head.push(connection.read_u8().await.unwrap());
    }
    String::from_utf8(head).unwrap()
}

async fn everything(mut connection: TcpStream) -> String {
    let mut text = Vec::new();
    // The connection is closed, either normally or by a reset.
    let _ = connection.read_to_end(&mut text).await;
    String::from_utf8(text).unwrap()
}

async fn is_closed(connection: &mut TcpStream) -> bool {
    let mut byte = [0];
    let read = tokio::time::timeout(Duration::from_millis(50), connection.read(&mut byte)).await;
    read.is_ok_and(|read| read.map_or(true, |bytes| bytes == 0))
}

#[tokio::test]
async fn a_connection_is_closed_on_which_no_request_comes_in_time() {
    let server = Listening::with(&Options::default()).await;
    let began = Instant::now();
    let mut idle = server.having_said(REQUEST).await;
    assert!(head(&mut idle).await.starts_with("HTTP/1.1 200"));
    let (silent, half) = (server.connect().await, server.having_said(HALF).await);
    let mut trickling = server.having_said(HALF).await;
    let trickle = async {
        while trickling.write_all(b"X-A: b\r\n").await.is_ok() {
            tokio::time::sleep(Duration::from_millis(500)).await;
        }
    };
    let all =
        async { tokio::join!(everything(idle), everything(silent), everything(half), trickle) };
    tokio::time::timeout(HEAD_WITHIN + LATE, all).await.unwrap();
    assert!(began.elapsed() >= HEAD_WITHIN);
}

#[tokio::test]
async fn many_half_requests_keep_nobody_out() {
    let connections = 8;
    let server = Listening::with(&Options { connections, ..with_token() }).await;
    let begun = format!("POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\n{ADMIN}");
    let mut asking = server.having_said(begun.as_bytes()).await;
    asking
        .write_all(b"Content-Type: application/json\r\nContent-Length: 20\r\n\r\n")
        .await
        .unwrap();
    let mut half = Vec::new();
    for _ in 0..10 * connections {
        half.push(server.having_said(HALF).await);
    }
    let mut late = server.having_said(REQUEST).await;
    assert!(head(&mut late).await.starts_with("HTTP/1.1 200"));
    assert!(is_closed(&mut half[0]).await, "the oldest is not closed");
    // An administrator's running request is not closed.
    asking.write_all(b"{\"kind\": \"nothing\"}\n").await.unwrap();
    let head = head(&mut asking).await;
    assert!(head.starts_with("HTTP/1.1 422"), "{head}");
}

#[tokio::test]
async fn a_connection_that_is_answered_makes_room_for_one_that_waits() {
    let options = Options { connections: 1, ..with_token() };
    let server = Listening::with(&options).await;
    let begun = b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n\
                  Authorization: Bearer secret\r\nContent-Length: 20\r\n\r\n";
    let mut first = server.having_said(begun).await;
    // The request is running when the others come.
    tokio::time::sleep(Duration::from_millis(200)).await;
    let (second, third) = (server.having_said(REQUEST).await, server.having_said(REQUEST).await);
    let began = Instant::now();
    first.write_all(b"{\"kind\": \"nothing\"}\n").await.unwrap();
    assert!(everything(first).await.starts_with("HTTP/1.1 422"));
    for mut waited in [second, third] {
        assert!(head(&mut waited).await.starts_with("HTTP/1.1 200"));
    }
    assert!(began.elapsed() < HEAD_WITHIN);
}

/// Half of a request with a body.
fn half(path: &str, media_type: &str, more: &str) -> String {
    format!(
        "POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {media_type}\r\n{more}\
         Content-Length: 20\r\n\r\nx"
    )
}

const FORM: &str = "application/x-www-form-urlencoded";
const JSON: &str = "application/json";
const ADMIN: &str = "Authorization: Bearer secret\r\n";

fn with_token() -> Options {
    Options { token: Some("secret".to_owned()), ..Options::default() }
}

/// Waits for the head of an answer, as long as a body may take.
async fn late_head(half: String, server: &Listening) -> String {
    let mut slow = server.having_said(half.as_bytes()).await;
    tokio::time::timeout(BODY_WITHIN + LATE, head(&mut slow)).await.unwrap()
}

/// Forms and the bodies of MLflow's clients had no time of their own: a form was waited for until
/// the whole request timed out after 30 s, with 503.
#[tokio::test]
async fn a_body_that_does_not_come_is_a_timeout_whatever_it_is() {
    let server = Listening::with(&with_token()).await;
    let began = Instant::now();
    let halves = [
        half("/v1/jobs", JSON, ADMIN),
        half("/v1/jobs/1", JSON, ADMIN).replace("POST", "PATCH"),
        half("/v1/checkpoints/1/predict", JSON, ADMIN),
        half("/api/2.0/mlflow/runs/create", JSON, ADMIN),
        half("/jobs/1", FORM, ADMIN),
        half("/login", FORM, ""),
    ];
    for head in futures::future::join_all(halves.map(|half| late_head(half, &server))).await {
        assert!(head.starts_with("HTTP/1.1 408"), "{head}");
    }
    assert!(began.elapsed() >= BODY_WITHIN);
}

/// The attack: half-sent logins held every connection, and `/healthz` timed out.
#[tokio::test]
async fn half_sent_forms_of_strangers_give_their_places_to_others() {
    let options = Options { connections: 16, ..with_token() };
    let server = Listening::with(&options).await;
    let begun = half("/v1/jobs", JSON, ADMIN);
    let mut admins = server.having_said(begun.as_bytes()).await;
    // The request is running when the others come.
    tokio::time::sleep(Duration::from_millis(200)).await;
    let mut strangers = Vec::new();
    for _ in 0..100 {
        strangers.push(server.having_said(half("/login", FORM, "").as_bytes()).await);
    }
    let began = Instant::now();
    let mut watching = server.having_said(REQUEST).await;
    assert!(head(&mut watching).await.starts_with("HTTP/1.1 200"));
    let ask = format!("GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\n{ADMIN}\r\n");
    let mut asking = server.having_said(ask.as_bytes()).await;
    assert!(head(&mut asking).await.starts_with("HTTP/1.1 200"));
    let login = format!(
        "POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Type: {FORM}\r\n\
         Content-Length: 12\r\n\r\ntoken=secret"
    );
    let mut logging_in = server.having_said(login.as_bytes()).await;
    assert!(head(&mut logging_in).await.starts_with("HTTP/1.1 303"));
    assert!(began.elapsed() < Duration::from_secs(5), "{:?}", began.elapsed());
    assert!(is_closed(&mut strangers[0]).await, "the oldest is not closed");
    // An administrator's body may take its time.
    admins.write_all(b"{\"kind\": \"nothing\"}").await.unwrap();
    let head = head(&mut admins).await;
    assert!(head.starts_with("HTTP/1.1 400"), "{head}");
}

/// Without tokens everybody is an administrator, and half bodies still keep nobody out.
#[tokio::test]
async fn half_bodies_on_a_server_without_tokens_keep_nobody_out() {
    let server = Listening::with(&Options { connections: 16, ..Options::default() }).await;
    let mut halves = Vec::new();
    for _ in 0..100 {
        halves.push(server.having_said(half("/v1/jobs", JSON, "").as_bytes()).await);
    }
    let mut watching = server.having_said(REQUEST).await;
    let answer = tokio::time::timeout(LATE, head(&mut watching)).await.unwrap();
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
}

/// A login from an address, as a proxy on this machine forwards it.
async fn login(server: &Listening, address: &str, token: &str) -> String {
    let body = format!("token={token}");
    let login = format!(
        "POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Type: {FORM}\r\n\
         X-Forwarded-For: {address}\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    head(&mut server.having_said(login.as_bytes()).await).await
}

#[tokio::test]
async fn an_address_that_guesses_tokens_has_to_wait_and_its_right_tokens_go_on() {
    let options = Options { trusted_proxies: vec!["127.0.0.1".parse().unwrap()], ..with_token() };
    let server = Listening::with(&options).await;
    let (guesser, other) = ("203.0.113.7", "203.0.113.8");
    let bearer = async |address: &str, token: &str| {
        let ask = format!(
            "GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\nX-Forwarded-For: {address}\r\n\
             Authorization: Bearer {token}\r\n\r\n"
        );
        head(&mut server.having_said(ask.as_bytes()).await).await
    };
    assert!(bearer(guesser, "secret").await.starts_with("HTTP/1.1 200"));
    for guess in 0..10 {
        let head = match guess % 2 {
            0 => login(&server, guesser, "guess").await,
            _ => bearer(guesser, "guess").await,
        };
        assert!(head.starts_with("HTTP/1.1 401"), "{guess}: {head}");
    }
    // A form is refused whatever it holds, so that a guess finds nothing out.
    for token in ["guess", "secret"] {
        let head = login(&server, guesser, token).await.to_lowercase();
        assert!(head.starts_with("http/1.1 429") && head.contains("retry-after: "), "{head}");
    }
    assert!(bearer(guesser, "guess").await.starts_with("HTTP/1.1 429"));
    assert!(bearer(guesser, "secret").await.starts_with("HTTP/1.1 200"), "it was right before");
    assert!(login(&server, other, "secret").await.starts_with("HTTP/1.1 303"));
    assert!(bearer(other, "guess").await.starts_with("HTTP/1.1 401"));
}

#[tokio::test]
async fn a_head_that_is_too_large_is_refused() {
    let server = Listening::with(&Options::default()).await;
    // A head slightly longer than the limit is answered if its last bytes come at once.
    for (name, count) in
        [("X-Long: ".to_owned() + &"x".repeat(300_000), 1), ("X-A: b".to_owned(), 101)]
    {
        let mut connection = server.having_said(HALF).await;
        for _ in 0..count {
            // It may be closed before everything is sent.
            let _ = connection.write_all(format!("{name}\r\n").as_bytes()).await;
        }
        let _ = connection.write_all(b"\r\n").await;
        let answer = everything(connection).await;
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 431"), "{answer}");
    }
    let mut fine = server.having_said(REQUEST).await;
    assert!(head(&mut fine).await.starts_with("HTTP/1.1 200"));
}

#[tokio::test]
async fn an_address_that_asks_too_often_is_told_when_to_come_again() {
    let requests_per_second = NonZero::new(2).unwrap();
    let server = Listening::with(&Options { requests_per_second, ..Options::default() }).await;
    let mut connection = server.connect().await;
    let mut refused = None;
    for asked in 0..100 {
        connection.write_all(b"HEAD /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").await.unwrap();
        let head = head(&mut connection).await;
        if head.starts_with("HTTP/1.1 429") {
            assert!(asked >= 20, "only {asked} at once");
            refused = Some(head);
            break;
        }
    }
    let refused = refused.unwrap().to_lowercase();
    assert!(refused.contains("retry-after: 1\r\n"), "{refused}");
    tokio::time::sleep(Duration::from_secs(1)).await;
    connection.write_all(REQUEST).await.unwrap();
    assert!(head(&mut connection).await.starts_with("HTTP/1.1 200"));
}

#[tokio::test]
async fn as_many_files_are_sent_at_once_as_may_be() {
    let server = Server::with_small_pipeline().await;
    let get = || Request::get("/v1/checkpoints/1/files/model.safetensors");
    let mut sending = Vec::new();
    for _ in 0..CONCURRENT_DOWNLOADS {
        let answer = server.answer(get().body(Body::empty()).unwrap()).await;
        assert_eq!(answer.status(), 200);
        sending.push(answer);
    }
    let refused = server.send(get().body(Body::empty()).unwrap()).await;
    refused.problem(503);
    assert_eq!(refused.header("retry-after"), "1");
    // Requests for headers alone take no place.
    let asked = Request::head("/v1/checkpoints/1/files/model.safetensors");
    assert_eq!(server.send(asked.body(Body::empty()).unwrap()).await.status, 200);
    sending.pop();
    assert_eq!(server.send(get().body(Body::empty()).unwrap()).await.status, 200);
}
