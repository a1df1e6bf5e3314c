//! The HTTP client of a bucket: its requests make objects appear where none is, and their answers tell how the store is.

use std::fmt;
use std::future::Future;
use std::pin::Pin;

use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpRequest, HttpResponse, HttpService, ReqwestConnector,
};
use object_store::{ClientOptions, HeaderValue};

use super::answers::Answers;

/// What objects are created on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Condition {
    /// That there is none under their path.
    NoneThere,
    /// Nothing: the store knows no conditions.
    Unconditional,
}

/// Makes clients.
///
/// `object_store` can ask for an object to be created on a condition when it is sent whole, but then tries a request
/// without an answer only once, and it cannot for one that is sent in parts.
#[derive(Debug)]
pub(crate) struct Connector {
    pub condition: Condition,
    /// Told of every answer.
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

type Answer<'a> = Pin<Box<dyn Future<Output = Result<HttpResponse, HttpError>> + Send + 'a>>;

impl HttpService for Client {
    fn call<'a, 'b>(&'a self, mut request: HttpRequest) -> Answer<'b>
    where
        'a: 'b,
        Self: 'b,
    {
        if self.condition == Condition::NoneThere && creates_object(&request) {
            // The signature need not cover it.
            request.headers_mut().insert("if-none-match", HeaderValue::from_static("*"));
        }
        Box::pin(async move {
            let answer = self.http.execute(request).await;
            self.answers.note(&answer);
            answer
        })
    }
}

/// Whether an object is there once this succeeds: `PutObject` or `CompleteMultipartUpload`.
fn creates_object(request: &HttpRequest) -> bool {
    let query = request.uri().query().unwrap_or_default();
    let is_copy = request.headers().contains_key("x-amz-copy-source");
    match request.method().as_str() {
        "PUT" => query.is_empty() && !is_copy,
        "POST" => query.starts_with("uploadId="),
        _ => false,
    }
}
