//! A client of a server with MLflow's protocol: torqued's or MLflow's own.

use std::thread::sleep;
use std::time::Duration;

use anyhow::{Context, bail};
use serde_json::{Value, json};
use ureq::Agent;

/// MLflow's server delays requests by tens of seconds when many clients write to SQLite.
const TIMEOUT: Duration = Duration::from_secs(300);
/// Pause before a refused request is sent again, as MLflow's client does.
const AGAIN_AFTER: Duration = Duration::from_millis(100);

/// MLflow's bound on a page of a metric.
const HISTORY_PAGE: usize = 25_000;

/// A client that keeps one connection open.
pub struct Client {
    agent: Agent,
    url: String,
}

/// A point in an answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    pub step: u64,
    pub value: f64,
}

impl Client {
    pub fn new(url: &str) -> Self {
        let config = Agent::config_builder()
            .timeout_global(Some(TIMEOUT))
            .http_status_as_error(false)
            .proxy(None)
            .build();
        Self { agent: Agent::new_with_config(config), url: url.to_owned() }
    }

    pub fn get(&self, path: &str) -> anyhow::Result<String> {
        let answer = self.agent.get(format!("{}{path}", self.url)).call();
        let (status, text) = read(answer.with_context(|| path.to_owned())?)?;
        match status {
            200 => Ok(text),
            _ => bail!("GET {path}: status {status}: {text}"),
        }
    }

    /// Status and text of the answer.
    pub fn post(&self, path: &str, body: &str) -> anyhow::Result<(u16, String)> {
        let request = self.agent.post(format!("{}{path}", self.url));
        let answer = request.content_type("application/json").send(body);
        read(answer.with_context(|| path.to_owned())?)
    }

    /// Posts until the server accepts. Gives the answer and the number of refusals.
    pub fn post_until_accepted(&self, path: &str, body: &str) -> anyhow::Result<(String, u64)> {
        const PATIENCE: u64 = 3000;
        let mut refused = 0;
        loop {
            let (status, text) = self.post(path, body)?;
            if status == 200 {
                return Ok((text, refused));
            }
            refused += 1;
            if refused == PATIENCE {
                bail!("POST {path}: status {status}: {text}");
            }
            sleep(AGAIN_AFTER);
        }
    }

    /// Begins a run in the default experiment and gives its id.
    pub fn begin_run(&self, name: &str) -> anyhow::Result<String> {
        let body = json!({"experiment_id": "0", "run_name": name, "start_time": 1}).to_string();
        let (text, _) = self.post_until_accepted("/api/2.0/mlflow/runs/create", &body)?;
        let answer: Value = serde_json::from_str(&text)?;
        let id = answer["run"]["info"]["run_id"].as_str();
        Ok(id.with_context(|| format!("no run in {text}"))?.to_owned())
    }

    /// All points of a metric, by step.
    pub fn history(&self, run: &str, key: &str) -> anyhow::Result<Vec<Point>> {
        let path = format!(
            "/api/2.0/mlflow/metrics/get-history?run_id={run}&metric_key={key}&max_results={HISTORY_PAGE}"
        );
        let mut points = Vec::new();
        let mut page = String::new();
        loop {
            let mut answer: Value = serde_json::from_str(&self.get(&format!("{path}{page}"))?)?;
            let metrics = answer["metrics"].as_array().cloned().unwrap_or_default();
            points.extend(metrics.iter().filter_map(point));
            match answer["next_page_token"].take() {
                Value::String(token) if !token.is_empty() => page = format!("&page_token={token}"),
                _ => break,
            }
        }
        points.sort_by_key(|point| point.step);
        Ok(points)
    }
}

/// MLflow writes 64-bit integers as texts or as numbers.
fn point(metric: &Value) -> Option<Point> {
    let step = match &metric["step"] {
        Value::String(step) => step.parse().ok()?,
        // Zero may be left out.
        Value::Null => 0,
        step => step.as_u64()?,
    };
    Some(Point { step, value: metric["value"].as_f64()? })
}

fn read(mut answer: ureq::http::Response<ureq::Body>) -> anyhow::Result<(u16, String)> {
    /// Far more than the longest answer.
    const MOST: u64 = 1 << 30;
    let status = answer.status().as_u16();
    Ok((status, answer.body_mut().with_config().limit(MOST).read_to_string()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_read_as_either_server_writes_them() {
        let points = [json!({"step": "7", "value": 0.5}), json!({"step": 8, "value": 1.5})];
        let expected = [Point { step: 7, value: 0.5 }, Point { step: 8, value: 1.5 }];
        assert_eq!(points.iter().filter_map(point).collect::<Vec<_>>(), expected);
        assert_eq!(point(&json!({"value": 2.0})), Some(Point { step: 0, value: 2.0 }));
    }
}
