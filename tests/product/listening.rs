//! The addresses at which a server listens, and the clients that may connect.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Child, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::net::TcpListener;
use tokio_rustls::TlsAcceptor;

use crate::product::{PATIENCE, Product, run_to_end, signal, torqued};
use crate::s3_server;

/// The authority that signed the proxy's certificate.
const AUTHORITY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/store/tests/s3_server/authority.pem");

/// A token that is long enough.
const TOKEN: &str = "a-token-for-this-test";

/// A server that listens at `address`, and its message about the address.
fn listening(data: &std::path::Path, address: &str) -> (Child, String) {
    let mut command = torqued(&["serve", "--workers", "0", "--listen", address, "--data"]);
    let mut server = command.arg(data).stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    (server, line.split_whitespace().last().unwrap_or_default().to_owned())
}

#[test]
fn a_socket_serves_its_owner_and_goes_with_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let socket = folder.path().join("torqued.socket");
    let address = format!("unix:{}", socket.display());
    let (mut server, url) = listening(&folder.path().join("data"), &address);
    assert_eq!(url, address);
    assert_eq!(std::fs::metadata(&socket).unwrap().permissions().mode() & 0o777, 0o600);
    let data = std::fs::metadata(folder.path().join("data")).unwrap();
    assert_eq!(data.permissions().mode() & 0o777, 0o700);

    let (code, output, errors) = run_to_end(&mut torqued(&["jobs", "--json", "--server", &url]));
    assert_eq!(code, Some(0), "{errors}");
    assert!(output.contains("\"jobs\""), "{output}");
    signal("TERM", server.id());
    assert_eq!(server.wait().unwrap().code(), Some(0));
    assert!(!socket.exists());
    let (code, _, errors) = run_to_end(&mut torqued(&["jobs", "--server", &url]));
    assert_eq!(code, Some(4), "{errors}");
    assert!(errors.contains(&address), "{errors}");
}

#[test]
fn an_empty_token_is_no_token() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = torqued(&["serve", "--listen", "0.0.0.0:0", "--data"]);
    let (code, _, errors) =
        run_to_end(command.arg(folder.path().join("data")).env("TORQUED_TOKEN", ""));
    assert_eq!(code, Some(1), "{errors}");
    assert!(errors.contains("needs a token"), "{errors}");
}

#[test]
fn a_token_that_can_be_guessed_is_refused_wherever_the_server_listens() {
    let folder = tempfile::tempdir().unwrap();
    for (address, token) in
        [("0.0.0.0:0", "x"), ("127.0.0.1:0", "fifteen-letters"), ("127.0.0.1:0", "é€")]
    {
        let mut command = torqued(&["serve", "--listen", address, "--data"]);
        let (code, _, errors) =
            run_to_end(command.arg(folder.path().join("data")).env("TORQUED_TOKEN", token));
        assert_eq!(code, Some(1), "{errors}");
        assert!(errors.contains("allowed: at least 16"), "{errors}");
        assert!(!errors.contains("fifteen"), "{errors}");
    }
}

#[test]
fn a_server_that_may_open_too_few_files_says_how_many_it_needs() {
    let folder = tempfile::tempdir().unwrap();
    let script = "ulimit -n 24; exec \"$0\" serve --workers 2 --listen 127.0.0.1:0 --data \"$1\"";
    let mut command = std::process::Command::new("sh");
    command.args(["-c", script, env!("CARGO_BIN_EXE_torqued")]).arg(folder.path().join("data"));
    let (code, output, errors) = run_to_end(&mut command);
    assert_eq!((code, output.as_str()), (Some(1), ""), "{errors}");
    assert!(errors.contains("may open 24 files at once, allowed: at least 168"), "{errors}");
    assert!(errors.contains("ulimit -n 4096"), "{errors}");
    assert!(!folder.path().join("data").exists(), "nothing was made");
}

/// Workers speak to the database alone, and run what users submit.
#[tokio::test]
async fn a_worker_does_not_know_the_servers_token() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = torqued(&["serve", "--listen", "127.0.0.1:0", "--data"]);
    let product = Product::spawn(command.arg(folder.path()).env("TORQUED_TOKEN", TOKEN));
    let environment = |pid: u32| std::fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    let has_token =
        |bytes: Vec<u8>| bytes.windows(TOKEN.len()).any(|part| part == TOKEN.as_bytes());
    assert!(has_token(environment(product.pid())));
    let started = Instant::now();
    // A child has its parent's environment until it has become the worker.
    let worker = loop {
        let known = product.workers().first().map(|pid| environment(*pid)).unwrap_or_default();
        if !known.is_empty() && !has_token(known.clone()) {
            break known;
        }
        assert!(started.elapsed() < Duration::from_secs(20), "the worker has the token");
        tokio::time::sleep(Duration::from_millis(20)).await;
    };
    assert!(String::from_utf8_lossy(&worker).contains("MIMALLOC_PURGE_DELAY"));
}

#[tokio::test]
async fn the_command_line_speaks_tls_to_a_proxy() {
    let folder = tempfile::tempdir().unwrap();
    let product = Product::start_with(folder.path(), &["--workers", "0", "--token", TOKEN]);
    let to = product.url.trim_start_matches("http://").to_owned();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let proxy = format!("https://{}", listener.local_addr().unwrap());
    let tls = TlsAcceptor::from(Arc::new(s3_server::tls()));
    tokio::spawn(async move {
        loop {
            let (client, _) = listener.accept().await.unwrap();
            let (tls, to) = (tls.clone(), to.clone());
            tokio::spawn(async move {
                let Ok(mut client) = tls.accept(client).await else { return };
                let mut server = tokio::net::TcpStream::connect(to).await.unwrap();
                let _ = tokio::io::copy_bidirectional(&mut client, &mut server).await;
            });
        }
    });
    let asked = move |authority: bool| {
        let mut command = torqued(&["jobs", "--json", "--token", TOKEN, "--server", &proxy]);
        if authority {
            command.env("SSL_CERT_FILE", AUTHORITY);
        }
        run_to_end(&mut command)
    };
    let asking = tokio::task::spawn_blocking(move || (asked(true), asked(false)));
    let (trusted, unknown) = asking.await.unwrap();
    assert_eq!(trusted.0, Some(0), "{}", trusted.2);
    assert_eq!(unknown.0, Some(4), "{}", unknown.2);
}

#[tokio::test]
async fn a_server_that_may_open_few_files_answers_beside_four_hundred_half_requests() {
    let folder = tempfile::tempdir().unwrap();
    let program = env!("CARGO_BIN_EXE_torqued");
    let script = "ulimit -n 256; exec \"$0\" serve --workers 0 --listen 127.0.0.1:0 --data \"$1\"";
    let mut command = std::process::Command::new("sh");
    let product = Product::spawn(command.args(["-c", script, program]).arg(folder.path()));
    let address = product.url.trim_start_matches("http://");
    let half: Vec<TcpStream> = (0..400)
        .map(|_| {
            let mut connection = TcpStream::connect(address).unwrap();
            connection.write_all(b"GET /healthz HTTP/1.1\r\n").unwrap();
            connection
        })
        .collect();
    let health = product.get("/healthz").await;
    assert!(health["status"].is_string(), "{health}");
    // The newest ones are still there.
    let mut last = half.last().unwrap();
    last.write_all(b"Host: localhost\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    last.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
}

/// The attack on a server with its usual limits: 600 half-sent logins, from one machine and without a
/// token, took all places for requests.
#[tokio::test]
async fn six_hundred_half_sent_logins_keep_neither_checks_nor_administrators_out() {
    let folder = tempfile::tempdir().unwrap();
    let program = env!("CARGO_BIN_EXE_torqued");
    for files in [256, 4096] {
        let script =
            "ulimit -n \"$2\"; exec \"$0\" serve --workers 0 --listen 127.0.0.1:0 --data \"$1\"";
        let mut command = std::process::Command::new("sh");
        command.args(["-c", script, program]).arg(folder.path()).arg(files.to_string());
        let product = Product::spawn(command.env("TORQUED_TOKEN", TOKEN));
        let address = product.url.trim_start_matches("http://");
        let half: Vec<TcpStream> = (0..600)
            .map(|_| {
                let mut connection = TcpStream::connect(address).unwrap();
                let form = b"POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 30\r\n\
                             Content-Type: application/x-www-form-urlencoded\r\n\r\ntoken=";
                // It may have lost its place to a later one.
                let _ = connection.write_all(form);
                connection
            })
            .collect();
        let asked = Instant::now();
        let health = product.get("/healthz").await;
        assert!(health["status"].is_string(), "{health}");
        for arguments in [&["jobs"][..], &["pause"], &["resume"]] {
            let mut command = torqued(arguments);
            command.args(["--server", &product.url]).env("TORQUED_TOKEN", TOKEN);
            let (code, _, errors) =
                tokio::task::spawn_blocking(move || run_to_end(&mut command)).await.unwrap();
            assert_eq!(code, Some(0), "{files} files: {errors}");
        }
        assert!(asked.elapsed() < Duration::from_secs(15), "{files} files: {:?}", asked.elapsed());
        drop(half);
    }
}

/// Runs a command for tokens directly on the data folder.
fn directly(data: &std::path::Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    run_to_end(torqued(&["token"]).args(arguments).arg("--data").arg(data))
}

#[test]
fn the_first_token_is_made_beside_the_server_and_closes_it() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let (mut server, url) = listening(&data, "127.0.0.1:0");
    let (code, token, errors) =
        directly(&data, &["create", "ana", "--scope", "admin", "--directly"]);
    assert_eq!(code, Some(0), "{errors}");
    let ask = |arguments: &[&str], token: &str| {
        let mut command = torqued(arguments);
        run_to_end(command.args(["--server", &url]).env("TORQUED_TOKEN", token))
    };
    let token = token.trim();
    let (code, output, errors) = ask(&["token", "list"], token);
    assert_eq!(code, Some(0), "{errors}");
    assert!(output.contains("ana"), "{output}");
    // The server reads tokens of other processes every few seconds.
    let asked = Instant::now();
    let errors = loop {
        let (code, _, errors) = ask(&["jobs"], "");
        if code != Some(0) {
            break errors;
        }
        assert!(asked.elapsed() < PATIENCE);
        std::thread::sleep(Duration::from_millis(200));
    };
    assert!(errors.contains("this server requires a token"), "{errors}");
    assert!(errors.contains("set TORQUED_TOKEN or --token"), "{errors}");

    let (_, reader, _) =
        ask(&["token", "create", "ben", "--scope", "read", "--expires", "1h"], token);
    assert_eq!(ask(&["jobs"], reader.trim()).0, Some(0));
    let (_, _, errors) = ask(&["pause"], reader.trim());
    assert!(errors.contains("this request needs admin"), "{errors}");
    assert_eq!(ask(&["token", "revoke", "ben"], token).0, Some(0));
    assert_ne!(ask(&["jobs"], reader.trim()).0, Some(0));
    let (_, audit, _) = ask(&["audit"], token);
    assert!(audit.contains("token create ana") && audit.contains("directly"), "{audit}");
    assert!(audit.contains("DELETE /v1/tokens/2"), "{audit}");
    signal("TERM", server.id());
    server.wait().unwrap();

    // From now on other machines may connect. No machine has this address.
    let listen_elsewhere = || {
        let mut command = torqued(&["serve", "--listen", "192.0.2.1:0", "--data"]);
        let (code, _, errors) = run_to_end(command.arg(&data));
        assert_eq!(code, Some(1), "{errors}");
        errors
    };
    let errors = listen_elsewhere();
    assert!(errors.contains("cannot listen on 192.0.2.1:0"), "{errors}");
    assert_eq!(directly(&data, &["clear"]).0, Some(0));
    let errors = listen_elsewhere();
    assert!(errors.contains("needs a token"), "{errors}");
}
