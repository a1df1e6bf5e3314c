//! The HTTP client of a bucket. Its requests only create objects where there is none, and it notes
//! whether the store answers.

use std::fmt;
use std::future::Future;
use std::pin::Pin;

use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpRequest, HttpResponse, HttpService, ReqwestConnector,
};
use object_store::{ClientOptions, HeaderValue};

use super::answers::Answers;

/// The condition under which an object is created.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Condition {
    /// No object exists under the path.
    NoneThere,
    /// No condition, because the store supports none.
    Unconditional,
}

/// Makes HTTP clients that set the condition.
///
/// `object_store` can set it itself for an object that is sent whole. But then it does not retry a
/// request without an answer, and it cannot set it for an object that is sent in parts.
#[derive(Debug)]
pub(crate) struct Connector {
    pub condition: Condition,
    /// Notes every answer.
    pub answers: Answers,
}

impl HttpConnector for Connector {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        let http = ReqwestConnector::default().connect(options)?;
        let (condition, answers) = (self.condition, self.answers.clone());
        Ok(HttpClient::new(Client { http, condition, answers }))
    }
}

struct Client {
    http: HttpClient,
    condition: Condition,
    answers: Answers,
}

impl fmt::Debug for Client {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Client").field("condition", &self.condition).finish_non_exhaustive()
    }
}

type ResponseFuture<'a> =
    Pin<Box<dyn Future<Output = Result<HttpResponse, HttpError>> + Send + 'a>>;

impl HttpService for Client {
    fn call<'a, 'b>(&'a self, mut request: HttpRequest) -> ResponseFuture<'b>
    where
        'a: 'b,
        Self: 'b,
    {
        if self.condition == Condition::NoneThere && creates_object(&request) {
            // The signature need not cover this header.
            request.headers_mut().insert("if-none-match", HeaderValue::from_static("*"));
        }
        Box::pin(async move {
            let answer = self.http.execute(request).await;
            self.answers.note(&answer);
            answer
        })
    }
}

/// Whether the request creates an object if it succeeds: `PutObject` or `CompleteMultipartUpload`.
fn creates_object(request: &HttpRequest) -> bool {
    let query = request.uri().query().unwrap_or_default();
    let is_copy = request.headers().contains_key("x-amz-copy-source");
    match request.method().as_str() {
        "PUT" => query.is_empty() && !is_copy,
        "POST" => query.starts_with("uploadId="),
        _ => false,
    }
}
