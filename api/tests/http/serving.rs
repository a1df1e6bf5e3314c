//! Listening on a socket.

use std::time::Duration;

use api::{App, Options, ServeError};
use store::{Access, Store};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;

async fn app(token: Option<&str>) -> (App, tempfile::TempDir) {
    let dir = tempfile::tempdir().unwrap();
    let store = Store::open(dir.path(), Access::Server).await.unwrap();
    let options = Options { token: token.map(str::to_owned), ..Options::default() };
    (App::new(store, &options), dir)
}

#[tokio::test]
async fn listening_to_the_network_without_a_token_is_refused() {
    let (app, _dir) = app(None).await;
    let listener = TcpListener::bind("0.0.0.0:0").await.unwrap();
    let error = api::serve(listener, app, std::future::pending()).await.unwrap_err();
    assert!(matches!(error, ServeError::OpenWithoutToken { .. }));
    assert!(error.to_string().contains("needs a token"));
}

#[tokio::test]
async fn listening_to_the_network_with_a_token_is_allowed() {
    let (app, _dir) = app(Some("secret")).await;
    let listener = TcpListener::bind("0.0.0.0:0").await.unwrap();
    api::serve(listener, app, std::future::ready(())).await.unwrap();
}

#[tokio::test]
async fn an_open_connection_does_not_hold_up_the_end() {
    let (app, _dir) = app(None).await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = oneshot::channel::<()>();
    let shutdown = async {
        let _ = stopped.await;
    };
    let server = tokio::spawn(api::serve(listener, app, shutdown));

    let mut connection = TcpStream::connect(address).await.unwrap();
    connection.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").await.unwrap();
    let mut answer = vec![0; 15];
    connection.read_exact(&mut answer).await.unwrap();
    assert_eq!(answer, b"HTTP/1.1 200 OK");
    // Half a request; the other half never comes.
    let mut half = TcpStream::connect(address).await.unwrap();
    half.write_all(b"GET /healthz HTTP/1.1\r\n").await.unwrap();

    stop.send(()).unwrap();
    let limit = api::limits::SHUTDOWN_GRACE + Duration::from_secs(5);
    tokio::time::timeout(limit, server).await.unwrap().unwrap().unwrap();
}
