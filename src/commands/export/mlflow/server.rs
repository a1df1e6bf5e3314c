//! The MLflow server that runs are written to, over its REST API.

use std::path::Path;
use std::time::Duration;

use reqwest::header::CONTENT_LENGTH;
use reqwest::{Body, Method, RequestBuilder, Response, Url};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use tokio_util::io::ReaderStream;

use super::entities::{FileInfo, Pair, Point, Run};
use super::error::MlflowError;

/// The server's database may be slow: a page of a long metric has 25 000 rows.
const TIMEOUT: Duration = Duration::from_secs(120);

/// The timeout for a file.
const FILE_TIMEOUT: Duration = Duration::from_secs(6 * 60 * 60);

/// Points per page of a metric: the largest number that MLflow allows.
const HISTORY_PAGE: u32 = 25_000;

/// The credentials of an MLflow client.
#[derive(Clone)]
pub enum Login {
    Nobody,
    Token(String),
    Password { username: String, password: String },
}

pub struct MlflowServer {
    http: reqwest::Client,
    base: Url,
    login: Login,
}

#[derive(Deserialize)]
struct RunResponse {
    run: Run,
}

#[derive(Deserialize)]
struct FoundRuns {
    #[serde(default)]
    runs: Vec<Run>,
}

#[derive(Deserialize)]
struct History {
    #[serde(default)]
    metrics: Vec<Point>,
    #[serde(default)]
    next_page_token: String,
}

#[derive(Deserialize)]
struct Files {
    #[serde(default)]
    files: Vec<FileInfo>,
    #[serde(default)]
    next_page_token: String,
}

impl MlflowServer {
    pub fn new(server: &str, login: Login) -> Result<Self, MlflowError> {
        let address = || MlflowError::Address { server: server.to_owned() };
        let base = Url::parse(server).map_err(|_| address())?;
        if !["http", "https"].contains(&base.scheme()) || base.host_str().is_none() {
            return Err(address());
        }
        let http = reqwest::Client::builder()
            .connect_timeout(Duration::from_secs(10))
            .timeout(TIMEOUT)
            .user_agent(concat!("torqued/", env!("CARGO_PKG_VERSION")))
            .build()
            .map_err(|_| address())?;
        Ok(Self { http, base, login })
    }

    /// The address without a login.
    pub fn shown(&self) -> String {
        let mut shown = self.base.clone();
        let _ = shown.set_password(None);
        let _ = shown.set_username("");
        shown.as_str().trim_end_matches('/').to_owned()
    }

    /// The id of the experiment with this name. Creates it if it is missing.
    pub async fn experiment(&self, name: &str) -> Result<String, MlflowError> {
        #[derive(Deserialize)]
        struct ExperimentResponse {
            experiment: Experiment,
        }
        #[derive(Deserialize)]
        struct Experiment {
            experiment_id: String,
            #[serde(default)]
            lifecycle_stage: String,
        }
        #[derive(Deserialize)]
        struct Created {
            experiment_id: String,
        }
        let query = [("experiment_name", name)];
        match self.get::<ExperimentResponse>("experiments/get-by-name", &query).await {
            Ok(ExperimentResponse { experiment }) if experiment.lifecycle_stage == "deleted" => {
                Err(MlflowError::DeletedExperiment { server: self.shown(), name: name.to_owned() })
            }
            Ok(ExperimentResponse { experiment }) => Ok(experiment.experiment_id),
            Err(error) if error.is_absent() => {
                let created: Created =
                    self.post("experiments/create", &json!({"name": name})).await?;
                Ok(created.experiment_id)
            }
            Err(error) => Err(error),
        }
    }

    /// The experiment with this name; `null` if it is missing.
    pub async fn find_experiment(&self, name: &str) -> Result<Value, MlflowError> {
        let query = [("experiment_name", name)];
        match self.get::<Value>("experiments/get-by-name", &query).await {
            Ok(mut found) => Ok(found["experiment"].take()),
            Err(error) if error.is_absent() => Ok(Value::Null),
            Err(error) => Err(error),
        }
    }

    /// The first run with these tags, deleted or not.
    pub async fn find_run(
        &self,
        experiment: &str,
        tags: &[Pair],
    ) -> Result<Option<Run>, MlflowError> {
        let clauses: Vec<String> =
            tags.iter().map(|Pair { key, value }| format!("tags.`{key}` = '{value}'")).collect();
        let question = json!({
            "experiment_ids": [experiment],
            "filter": clauses.join(" AND "),
            "run_view_type": "ALL",
            "order_by": ["attributes.start_time ASC"],
            "max_results": 100,
        });
        let found: FoundRuns = self.post("runs/search", &question).await?;
        // An existing run takes precedence over a deleted one with the same tags.
        let (active, deleted): (Vec<Run>, Vec<Run>) =
            found.runs.into_iter().partition(|run| run.info.lifecycle_stage != "deleted");
        Ok(active.into_iter().chain(deleted).next())
    }

    pub async fn create_run(&self, run: &Value) -> Result<Run, MlflowError> {
        Ok(self.post::<RunResponse>("runs/create", run).await?.run)
    }

    pub async fn update_run(&self, change: &Value) -> Result<(), MlflowError> {
        self.post("runs/update", change).await.map(|_: Value| ())
    }

    pub async fn log_batch(&self, batch: &Value) -> Result<(), MlflowError> {
        self.post("runs/log-batch", batch).await.map(|_: Value| ())
    }

    pub async fn delete_tag(&self, run: &str, key: &str) -> Result<(), MlflowError> {
        let body = json!({"run_id": run, "key": key});
        self.post("runs/delete-tag", &body).await.map(|_: Value| ())
    }

    /// All points of a metric.
    pub async fn history(&self, run: &str, key: &str) -> Result<Vec<Point>, MlflowError> {
        let most = HISTORY_PAGE.to_string();
        let mut points = Vec::new();
        let mut token = String::new();
        loop {
            let mut query = vec![("run_id", run), ("metric_key", key), ("max_results", &most)];
            if !token.is_empty() {
                query.push(("page_token", &token));
            }
            let mut page: History = self.get("metrics/get-history", &query).await?;
            points.append(&mut page.metrics);
            if page.next_page_token.is_empty() {
                return Ok(points);
            }
            token = page.next_page_token;
        }
    }

    /// The files and folders directly in a folder of a run.
    pub async fn files(&self, run: &str, folder: &str) -> Result<Vec<FileInfo>, MlflowError> {
        let mut files = Vec::new();
        let mut token = String::new();
        loop {
            let mut query = vec![("run_id", run)];
            if !folder.is_empty() {
                query.push(("path", folder));
            }
            if !token.is_empty() {
                query.push(("page_token", &token));
            }
            let mut page: Files = self.get("artifacts/list", &query).await?;
            files.append(&mut page.files);
            if page.next_page_token.is_empty() {
                return Ok(files);
            }
            token = page.next_page_token;
        }
    }

    /// The address to which files of a run with this `artifact_uri` are sent.
    ///
    /// # Errors
    /// [`MlflowError::NoProxy`] when the server lets its clients write files directly.
    pub fn files_url(&self, artifact_uri: &str) -> Result<Url, MlflowError> {
        let no_proxy =
            || MlflowError::NoProxy { server: self.shown(), place: artifact_uri.to_owned() };
        let place = artifact_uri.strip_prefix("mlflow-artifacts:").ok_or_else(no_proxy)?;
        let (base, path) = match place.strip_prefix("//") {
            // Files may have a server of their own.
            Some(other) => {
                let (host, path) = other.split_once('/').ok_or_else(no_proxy)?;
                let mut address = format!("{}://{host}", self.base.scheme());
                if host.is_empty() {
                    address = self.base.to_string();
                }
                (Url::parse(&address).map_err(|_| no_proxy())?, path)
            }
            None => (self.base.clone(), place),
        };
        let folder = ["api", "2.0", "mlflow-artifacts", "artifacts"];
        Ok(below(&base, folder.into_iter().chain(path.trim_matches('/').split('/'))))
    }

    /// A small file of a run; `files` is its [`Self::files_url`].
    pub async fn file(&self, files: &Url, name: &str) -> Result<Vec<u8>, MlflowError> {
        let url = below(files, name.split('/'));
        let request = format!("the file {name}");
        let response =
            self.answer(self.signed(self.http.request(Method::GET, url)), &request).await?;
        Ok(response.bytes().await.map_err(|reason| self.unreachable(reason))?.to_vec())
    }

    /// Sends a file of this machine as the file `name` of a run.
    pub async fn send_file(&self, files: &Url, name: &str, path: &Path) -> Result<(), MlflowError> {
        let unreadable = |reason| MlflowError::File { path: path.to_owned(), reason };
        let file = tokio::fs::File::open(path).await.map_err(unreadable)?;
        let size = file.metadata().await.map_err(unreadable)?.len();
        let body = Body::wrap_stream(ReaderStream::with_capacity(file, 256 * 1024));
        self.send(files, name, body, size).await
    }

    pub async fn send_bytes(
        &self,
        files: &Url,
        name: &str,
        bytes: Vec<u8>,
    ) -> Result<(), MlflowError> {
        let size = bytes.len() as u64;
        self.send(files, name, bytes.into(), size).await
    }

    async fn send(
        &self,
        files: &Url,
        name: &str,
        body: Body,
        size: u64,
    ) -> Result<(), MlflowError> {
        let url = below(files, name.split('/'));
        let request = self
            .http
            .request(Method::PUT, url)
            .timeout(FILE_TIMEOUT)
            .header(CONTENT_LENGTH, size)
            .body(body);
        self.answer(self.signed(request), &format!("the file {name}")).await.map(|_| ())
    }

    async fn get<T: DeserializeOwned>(
        &self,
        path: &str,
        query: &[(&str, &str)],
    ) -> Result<T, MlflowError> {
        let mut url = self.api(path);
        url.query_pairs_mut().extend_pairs(query);
        self.read(self.http.request(Method::GET, url), path).await
    }

    async fn post<T: DeserializeOwned>(&self, path: &str, body: &Value) -> Result<T, MlflowError> {
        self.read(self.http.request(Method::POST, self.api(path)).json(body), path).await
    }

    fn api(&self, path: &str) -> Url {
        below(&self.base, ["api", "2.0", "mlflow"].into_iter().chain(path.split('/')))
    }

    fn signed(&self, request: RequestBuilder) -> RequestBuilder {
        match &self.login {
            Login::Nobody => request,
            Login::Token(token) => request.bearer_auth(token),
            Login::Password { username, password } => request.basic_auth(username, Some(password)),
        }
    }

    async fn read<T: DeserializeOwned>(
        &self,
        request: RequestBuilder,
        path: &str,
    ) -> Result<T, MlflowError> {
        let response = self.answer(self.signed(request), path).await?;
        let body = response.bytes().await.map_err(|reason| self.unreachable(reason))?;
        serde_json::from_slice(&body).map_err(|error| MlflowError::UnexpectedResponse {
            server: self.shown(),
            request: path.to_owned(),
            reason: error.to_string(),
        })
    }

    async fn answer(&self, request: RequestBuilder, path: &str) -> Result<Response, MlflowError> {
        let response = request.send().await.map_err(|reason| self.unreachable(reason))?;
        let status = response.status();
        if status.is_success() {
            return Ok(response);
        }
        let body = response.text().await.map_err(|reason| self.unreachable(reason))?;
        Err(MlflowError::refused(self.shown(), path.to_owned(), status, &body))
    }

    fn unreachable(&self, reason: reqwest::Error) -> MlflowError {
        MlflowError::Unreachable { server: self.shown(), reason }
    }
}

/// An address below another, each part of its path escaped.
fn below<'a>(base: &Url, parts: impl IntoIterator<Item = &'a str>) -> Url {
    let mut url = base.clone();
    if let Ok(mut segments) = url.path_segments_mut() {
        segments.pop_if_empty().extend(parts);
    }
    url
}

#[cfg(test)]
mod tests {
    use super::*;

    fn server(address: &str) -> MlflowServer {
        let _ = rustls::crypto::ring::default_provider().install_default();
        MlflowServer::new(address, Login::Nobody).unwrap()
    }

    #[test]
    fn files_go_through_the_server_unless_its_clients_write_them() {
        let lab = server("http://lab:5000/tracking/");
        for (uri, url) in [
            (
                "mlflow-artifacts:/1/ab/artifacts",
                "http://lab:5000/tracking/api/2.0/mlflow-artifacts/artifacts/1/ab/artifacts",
            ),
            (
                "mlflow-artifacts://files:9000/1/ab/artifacts",
                "http://files:9000/api/2.0/mlflow-artifacts/artifacts/1/ab/artifacts",
            ),
        ] {
            assert_eq!(lab.files_url(uri).unwrap().as_str(), url);
        }
        let message = lab.files_url("s3://bucket/1/ab/artifacts").unwrap_err().to_string();
        assert!(message.contains("s3://bucket/1/ab/artifacts"), "{message}");
        assert!(message.contains("--without-files"), "{message}");
    }

    #[test]
    fn a_password_of_the_address_is_never_shown() {
        let lab = server("https://ann:secret@lab/mlflow");
        assert_eq!(lab.shown(), "https://lab/mlflow");
        assert_eq!(
            lab.api("runs/get").as_str(),
            "https://ann:secret@lab/mlflow/api/2.0/mlflow/runs/get"
        );
    }

    #[test]
    fn an_address_that_is_no_web_address_is_refused() {
        for address in ["lab:5000", "file:///mlruns", "databricks", ""] {
            let Err(error) = MlflowServer::new(address, Login::Nobody) else {
                panic!("{address:?} was taken");
            };
            assert!(error.to_string().contains("http://HOST:PORT"), "{error}");
        }
    }
}
