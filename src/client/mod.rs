//! A client of the HTTP API, with the operations that the command line needs.

mod download;
mod error;
mod events;
mod stream;
mod upload;

use std::borrow::Borrow;
use std::time::Duration;

use reqwest::{Method, RequestBuilder, Response, StatusCode, Url};
use serde::de::DeserializeOwned;
use wire::{
    Attempts, Audit, Checkpoint, CreatedToken, Dataset, Evaluation, Job, LabelChange, Logs, Metric,
    NewToken, Presets, Queue, Robot, Robots, Task, Tasks, Token, Tokens, Worker, Workers,
};

use crate::resource::Reference;

pub use download::Fetched;
pub use error::{ClientError, JobEnded, innermost};
pub use events::Events;
pub use upload::RecordedFile;

/// The largest number of items on a page of a list.
const LONGEST_PAGE: u32 = 500;

/// The prefix of the address of a server on a Unix socket. The socket's path follows.
pub const UNIX: &str = "unix:";

/// A server's API at an address: `http://HOST:PORT` or `HOST:PORT`, `https://HOST` behind a proxy, or
/// `unix:PATH`.
#[derive(Clone, Debug)]
pub struct Client {
    http: reqwest::Client,
    base: Url,
    /// The file of the socket for all requests, if the server listens on one.
    socket: Option<String>,
    token: Option<String>,
}

/// Whether existing results are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reuse {
    ByDigest,
    ComputeAnew,
}

/// A job that the server accepted.
#[derive(Debug)]
pub struct Submitted {
    pub job: Job,
    /// Whether the job existed before, so that nothing was queued.
    pub existed: bool,
}

impl Client {
    /// # Errors
    /// When `server` is not an address that [`Client`] supports.
    pub fn new(server: &str, token: Option<String>) -> Result<Self, ClientError> {
        let address = |reason: String| ClientError::Address { server: server.to_owned(), reason };
        let (web, socket) = match server.strip_prefix(UNIX) {
            Some(path) => ("http://localhost".to_owned(), Some(path.to_owned())),
            None if server.contains("://") => (server.to_owned(), None),
            None => (format!("http://{server}"), None),
        };
        let base = Url::parse(&web).map_err(|error| address(error.to_string()))?;
        let is_web = ["http", "https"].contains(&base.scheme()) && base.host_str().is_some();
        if !is_web || socket.as_deref() == Some("") {
            let allowed = "expected http://HOST:PORT, HOST:PORT, https://HOST or unix:PATH";
            return Err(address(allowed.to_owned()));
        }
        // This fails if a provider is installed already.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let mut http = reqwest::Client::builder()
            // The server is on this machine or in this laboratory, never behind a web proxy.
            .no_proxy()
            .connect_timeout(Duration::from_secs(5))
            .timeout(Duration::from_secs(60))
            // Streams begin as requests of HTTP/1.1, and the server supports no other version.
            .http1_only()
            // Shorter than the time after which the server closes a connection.
            .pool_idle_timeout(api::limits::HEAD_WITHIN / 2)
            .user_agent(concat!("torqued/", env!("CARGO_PKG_VERSION")));
        if let Some(path) = &socket {
            http = http.unix_socket(path.as_str());
        }
        let http = http.build().map_err(|error| address(error.to_string()))?;
        Ok(Self { http, base, socket, token })
    }

    /// Submits a spec, given as JSON in `text`.
    pub async fn submit(&self, text: Vec<u8>, reuse: Reuse) -> Result<Submitted, ClientError> {
        self.submit_labelled(text, reuse, &[]).await
    }

    /// Submits a spec with the parameters `name`, `note` and `tag`, which label the job.
    pub async fn submit_labelled(
        &self,
        text: Vec<u8>,
        reuse: Reuse,
        labels: &[(&str, &str)],
    ) -> Result<Submitted, ClientError> {
        let force = (reuse == Reuse::ComputeAnew).then_some(&("force", "true"));
        let path = self.with_query("/v1/jobs", force.into_iter().chain(labels));
        let request =
            self.request(Method::POST, &path).header("content-type", "application/json").body(text);
        self.submitted(request).await
    }

    /// Changes the labels of the thing at `path`. Returns the thing as the server wrote it.
    pub async fn label(&self, path: &str, change: &LabelChange) -> Result<String, ClientError> {
        self.text(self.request(Method::PATCH, path).json(change)).await
    }

    pub async fn job(&self, id: i64) -> Result<Job, ClientError> {
        self.get(&format!("/v1/jobs/{id}")).await
    }

    /// All tasks of a job, in the order in which they run. They are read page by page.
    pub async fn tasks(&self, job: i64) -> Result<Vec<Task>, ClientError> {
        let path = format!("/v1/jobs/{job}/tasks?limit={LONGEST_PAGE}");
        let mut page: Tasks = self.get(&path).await?;
        let mut tasks = page.tasks;
        while let Some(last) = page.next {
            page = self.get(&format!("{path}&after={last}")).await?;
            tasks.append(&mut page.tasks);
        }
        Ok(tasks)
    }

    /// An answer, as the server wrote it.
    pub async fn raw(&self, path: &str) -> Result<String, ClientError> {
        self.text(self.request(Method::GET, path)).await
    }

    pub async fn attempts(&self, path: &str) -> Result<Attempts, ClientError> {
        self.get(path).await
    }

    /// A page of the logs of a job's tasks.
    pub async fn logs(&self, job: i64, query: &[(&str, String)]) -> Result<Logs, ClientError> {
        self.get(&self.with_query(&format!("/v1/jobs/{job}/logs"), query)).await
    }

    pub async fn queue(&self) -> Result<Queue, ClientError> {
        self.get("/v1/queue").await
    }

    pub async fn pause_queue(&self) -> Result<Queue, ClientError> {
        self.post("/v1/queue/pause").await
    }

    pub async fn resume_queue(&self) -> Result<Queue, ClientError> {
        self.post("/v1/queue/resume").await
    }

    pub async fn workers(&self, path: &str) -> Result<Workers, ClientError> {
        self.get(path).await
    }

    pub async fn drain_worker(&self, name: &str) -> Result<Worker, ClientError> {
        self.post(&format!("/v1/workers/{name}/drain")).await
    }

    pub async fn undrain_worker(&self, name: &str) -> Result<Worker, ClientError> {
        self.post(&format!("/v1/workers/{name}/undrain")).await
    }

    pub async fn tokens(&self) -> Result<Tokens, ClientError> {
        self.get("/v1/tokens").await
    }

    pub async fn create_token(&self, token: &NewToken) -> Result<CreatedToken, ClientError> {
        let request = self.request(Method::POST, "/v1/tokens").json(token);
        self.read(&self.text(request).await?)
    }

    pub async fn revoke_token(&self, id: i64) -> Result<Token, ClientError> {
        self.delete(&format!("/v1/tokens/{id}")).await
    }

    pub async fn audit(&self, path: &str) -> Result<Audit, ClientError> {
        self.get(path).await
    }

    pub async fn cancel(&self, id: i64) -> Result<Job, ClientError> {
        self.post(&format!("/v1/jobs/{id}/cancel")).await
    }

    /// Submits the spec of a failed or cancelled job again.
    pub async fn retry(&self, id: i64) -> Result<Submitted, ClientError> {
        self.submitted(self.request(Method::POST, &format!("/v1/jobs/{id}/retry"))).await
    }

    /// Submits a verification of a dataset. Returns the job.
    pub async fn verify(&self, dataset: i64) -> Result<Job, ClientError> {
        self.post(&format!("/v1/datasets/{dataset}/verify")).await
    }

    pub async fn presets(&self) -> Result<Presets, ClientError> {
        self.get("/v1/presets").await
    }

    pub async fn dataset(&self, id: i64) -> Result<Dataset, ClientError> {
        self.get(&format!("/v1/datasets/{id}")).await
    }

    pub async fn checkpoint(&self, id: i64) -> Result<Checkpoint, ClientError> {
        self.get(&format!("/v1/checkpoints/{id}")).await
    }

    pub async fn evaluation(&self, id: i64) -> Result<Evaluation, ClientError> {
        self.get(&format!("/v1/evaluations/{id}")).await
    }

    pub async fn robot(&self, id: i64) -> Result<Robot, ClientError> {
        self.get(&format!("/v1/robots/{id}")).await
    }

    /// A page of the robots, newest first; the one after `cursor`, if there is one.
    pub async fn robots(&self, cursor: Option<&str>) -> Result<Robots, ClientError> {
        let limit = ("limit", LONGEST_PAGE.to_string());
        let cursor = cursor.map(|cursor| ("cursor", cursor.to_owned()));
        self.get(&self.with_query("/v1/robots", std::iter::once(limit).chain(cursor))).await
    }

    /// Adds a robot. Returns it, and whether it is new.
    pub async fn add_robot(
        &self,
        media_type: &str,
        text: String,
        parameters: &[(&str, String)],
    ) -> Result<(Robot, bool), ClientError> {
        let path = self.with_query("/v1/robots", parameters);
        let request = self.request(Method::POST, &path);
        let response = self.answer(request.header("content-type", media_type).body(text)).await?;
        let is_new = response.status() == StatusCode::CREATED;
        let robot = response.text().await.map_err(self.unreachable())?;
        Ok((self.read(&robot)?, is_new))
    }

    /// A path with these parameters as its query.
    fn with_query<K: AsRef<str>, V: AsRef<str>>(
        &self,
        path: &str,
        parameters: impl IntoIterator<Item = impl Borrow<(K, V)>>,
    ) -> String {
        let mut address = self.base.clone();
        address.query_pairs_mut().clear().extend_pairs(parameters);
        match address.query() {
            None | Some("") => path.to_owned(),
            Some(query) => format!("{path}?{query}"),
        }
    }

    /// The report of a run, whose type depends on the kind of its job.
    pub async fn report<T: DeserializeOwned>(&self, run: i64) -> Result<T, ClientError> {
        self.get(&format!("/v1/runs/{run}/artifacts/report.json")).await
    }

    /// A file, by the path in an answer.
    pub async fn download(&self, path: &str) -> Result<Vec<u8>, ClientError> {
        let response = self.answer(self.request(Method::GET, path)).await?;
        Ok(response.bytes().await.map_err(self.unreachable())?.to_vec())
    }

    /// Asks a checkpoint to `predict`, or for a `torque`; `question` is JSON. Returns the answer as
    /// the server wrote it.
    pub async fn question(
        &self,
        checkpoint: &Reference,
        what: &str,
        question: Vec<u8>,
    ) -> Result<String, ClientError> {
        let path = format!("/v1/checkpoints/{checkpoint}/{what}");
        let request = self.request(Method::POST, &path).header("content-type", "application/json");
        self.text(request.body(question)).await
    }

    /// The values of a metric, downsampled to `points`.
    pub async fn metric(&self, run: i64, key: &str, points: u32) -> Result<Metric, ClientError> {
        let mut address = self.base.clone();
        // A slash in the key is part of it.
        if let Ok(mut segments) = address.path_segments_mut() {
            segments.clear().extend(["v1", "runs", &run.to_string(), "metrics", key]);
        }
        self.get(&format!("{}?points={points}", address.path())).await
    }

    /// Whether the server listens on a socket, which browsers cannot open.
    pub fn is_on_socket(&self) -> bool {
        self.socket.is_some()
    }

    /// The address of a page or a download, for messages.
    pub fn url(&self, path: &str) -> String {
        match &self.socket {
            // The arguments for curl.
            Some(socket) => format!("--unix-socket {socket} {}", self.address(path)),
            None => self.address(path),
        }
    }

    fn address(&self, path: &str) -> String {
        format!("{}{path}", self.base.as_str().trim_end_matches('/'))
    }

    /// The server's address as it was given.
    fn server(&self) -> String {
        match &self.socket {
            Some(socket) => format!("{UNIX}{socket}"),
            None => self.base.to_string(),
        }
    }

    /// An answer of the API, by its path.
    pub async fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, ClientError> {
        self.read(&self.text(self.request(Method::GET, path)).await?)
    }

    /// The answer to a question that is a JSON document.
    pub async fn ask<T: DeserializeOwned>(
        &self,
        path: &str,
        question: &serde_json::Value,
    ) -> Result<T, ClientError> {
        self.read(&self.text(self.request(Method::POST, path).json(question)).await?)
    }

    pub async fn post<T: DeserializeOwned>(&self, path: &str) -> Result<T, ClientError> {
        self.read(&self.text(self.request(Method::POST, path)).await?)
    }

    pub async fn delete<T: DeserializeOwned>(&self, path: &str) -> Result<T, ClientError> {
        self.read(&self.text(self.request(Method::DELETE, path)).await?)
    }

    fn request(&self, method: Method, path: &str) -> RequestBuilder {
        let request = self.http.request(method, self.address(path));
        match &self.token {
            Some(token) => request.bearer_auth(token),
            None => request,
        }
    }

    async fn submitted(&self, request: RequestBuilder) -> Result<Submitted, ClientError> {
        let response = self.answer(request).await?;
        let existed = response.status() == StatusCode::OK;
        let job = response.text().await.map_err(self.unreachable())?;
        Ok(Submitted { job: self.read(&job)?, existed })
    }

    async fn text(&self, request: RequestBuilder) -> Result<String, ClientError> {
        self.answer(request).await?.text().await.map_err(self.unreachable())
    }

    /// The answer to a request, unless the server refused it.
    async fn answer(&self, request: RequestBuilder) -> Result<Response, ClientError> {
        let response = request.send().await.map_err(self.unreachable())?;
        let status = response.status();
        if status.is_success() {
            return Ok(response);
        }
        let problem = response.text().await.map_err(self.unreachable())?;
        let error = ClientError::refused(status, &problem);
        let needs_token = status == StatusCode::UNAUTHORIZED && self.token.is_none();
        Err(if needs_token { error.with_advice("set TORQUED_TOKEN or --token") } else { error })
    }

    /// Like [`Client::answer`], for an answer whose body may take long. Its head may take
    /// `patience`.
    async fn answer_within(
        &self,
        patience: Duration,
        request: RequestBuilder,
    ) -> Result<Response, ClientError> {
        let answer = tokio::time::timeout(patience, self.answer(request)).await;
        answer.unwrap_or_else(|_| Err(self.silent(patience)))
    }

    fn silent(&self, waited: Duration) -> ClientError {
        ClientError::Silent { server: self.server(), waited }
    }

    fn unreachable(&self) -> impl FnOnce(reqwest::Error) -> ClientError {
        let server = self.server();
        |reason| ClientError::Unreachable { server, reason }
    }

    fn read<T: DeserializeOwned>(&self, body: &str) -> Result<T, ClientError> {
        serde_json::from_str(body)
            .map_err(|source| ClientError::UnexpectedResponse { server: self.server(), source })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_without_a_scheme_is_one_of_http() {
        for (server, url) in [
            ("127.0.0.1:7070", "http://127.0.0.1:7070/jobs/1"),
            ("localhost:7070/", "http://localhost:7070/jobs/1"),
            ("lab", "http://lab/jobs/1"),
            ("[::1]:7070", "http://[::1]:7070/jobs/1"),
            ("https://lab.example", "https://lab.example/jobs/1"),
        ] {
            assert_eq!(Client::new(server, None).unwrap().url("/jobs/1"), url);
        }
    }

    #[test]
    fn what_is_no_address_is_refused_with_examples() {
        for server in ["", "ftp://lab", "lab:port", "a b", "unix:", "://lab"] {
            let error = Client::new(server, None).unwrap_err().to_string();
            assert!(error.contains("is not a server address"), "{server:?}: {error}");
        }
        let error = Client::new("ftp://lab", None).unwrap_err().to_string();
        assert!(error.contains("http://HOST:PORT, HOST:PORT"), "{error}");
    }

    #[test]
    fn a_trailing_slash_of_the_address_does_not_double() {
        let client = Client::new("http://127.0.0.1:7070/", None).unwrap();
        assert_eq!(client.url("/jobs/1"), "http://127.0.0.1:7070/jobs/1");
    }
}
