//! Access control: tokens, other sites, other host names.

use api::Options;
use axum::http::Method;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;

use crate::fixture::{Server, small_simulation};

async fn with_token() -> Server {
    Server::start_with(&Options { token: Some("secret".to_owned()), ..Options::default() }).await
}

#[tokio::test]
async fn without_the_token_only_the_health_is_told() {
    let server = with_token().await;
    assert_eq!(server.get("/healthz").await.status, 200);
    let paths = ["/", "/v1/jobs", "/v1/openapi.json", "/nothing", "/jobs/1"];
    for path in paths {
        let answer = server.get(path).await;
        answer.problem(401);
        let schemes: Vec<_> = answer
            .headers
            .get_all("www-authenticate")
            .iter()
            .map(|value| value.to_str().unwrap().split(' ').next().unwrap())
            .collect();
        assert_eq!(schemes, ["Bearer", "Basic"]);
    }
    server.submit(&small_simulation(1)).await.problem(401);
}

#[tokio::test]
async fn the_token_opens_as_bearer_and_as_a_password() {
    let server = with_token().await;
    let basic = format!("Basic {}", BASE64.encode("me:secret"));
    for credentials in ["Bearer secret", &basic] {
        let headers = [("authorization", credentials)];
        assert_eq!(server.request(Method::GET, "/v1/jobs", &headers).await.status, 200);
    }
    for credentials in ["Bearer wrong", "Bearer", "secret", "Basic c2VjcmV0"] {
        let headers = [("authorization", credentials)];
        let problem = server.request(Method::GET, "/v1/jobs", &headers).await.problem(401);
        assert_eq!(problem["detail"], "the token is not valid: it is unknown, expired or revoked");
    }
}

#[tokio::test]
async fn another_site_cannot_change_anything() {
    let server = Server::start().await;
    let job = server.submitted(&small_simulation(1)).await;
    let path = format!("/v1/jobs/{}/cancel", job["id"]);
    for headers in [
        [("origin", "https://evil.example"), ("host", "127.0.0.1:7070")],
        [("sec-fetch-site", "cross-site"), ("host", "127.0.0.1:7070")],
        [("sec-fetch-site", "same-site"), ("host", "127.0.0.1:7070")],
        [("origin", "null"), ("host", "127.0.0.1:7070")],
        [("origin", "http://127.0.0.1:8080"), ("host", "127.0.0.1:7070")],
    ] {
        server.request(Method::POST, &path, &headers).await.problem(403);
    }
    let own = [("origin", "http://127.0.0.1:7070"), ("sec-fetch-site", "same-origin")];
    assert_eq!(server.request(Method::POST, &path, &own).await.status, 200);
}

#[tokio::test]
async fn a_name_that_is_not_loopback_is_refused_without_a_token() {
    let server = Server::start().await;
    for host in ["evil.example", "evil.example:7070", "192.168.0.7:7070", "localhost.evil.example"]
    {
        server.request(Method::GET, "/v1/jobs", &[("host", host)]).await.problem(421);
    }
    for host in ["localhost", "localhost:7070", "127.0.0.1", "[::1]:7070"] {
        let answer = server.request(Method::GET, "/v1/jobs", &[("host", host)]).await;
        assert_eq!(answer.status, 200, "{host}");
    }
    let headers = [("host", "torqued.lab.example"), ("authorization", "Bearer secret")];
    assert_eq!(with_token().await.request(Method::GET, "/", &headers).await.status, 200);
}

#[tokio::test]
async fn a_request_that_says_twice_where_it_goes_or_who_sends_it_is_refused() {
    let server = with_token().await;
    let right = ("authorization", "Bearer secret");
    for headers in [
        [("host", "torqued.lab"), ("host", "evil.example"), right],
        [("host", "torqued.lab"), ("host", "torqued.lab"), right],
        [("host", "torqued.lab"), ("authorization", "Bearer other"), right],
    ] {
        let problem = server.request(Method::GET, "/v1/jobs", &headers).await.problem(400);
        assert_eq!(problem["type"], "tag:torqued,2026:repeated-header");
    }
}

#[tokio::test]
async fn every_answer_keeps_a_browser_from_loading_anything_else() {
    let server = Server::start().await;
    for path in ["/", "/v1/jobs", "/nothing"] {
        let answer = server.get(path).await;
        assert!(answer.header("content-security-policy").starts_with("default-src 'none'"));
        assert_eq!(answer.header("x-content-type-options"), "nosniff");
    }
}
