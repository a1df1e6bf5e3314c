//! Ids of requests, from the caller or from the server.

use axum::http::Method;

use crate::fixture::Server;

#[tokio::test]
async fn every_answer_names_its_request() {
    let server = Server::start().await;
    let own = server.request(Method::GET, "/v1/jobs", &[("x-request-id", "run-7/a")]).await;
    assert_eq!(own.header("x-request-id"), "run-7/a");
    let forged = server.request(Method::GET, "/nothing", &[("x-request-id", "a b\"c")]).await;
    assert_eq!(forged.header("x-request-id").len(), 32);
    assert_ne!(server.get("/v1/jobs").await.header("x-request-id"), forged.header("x-request-id"));
}
