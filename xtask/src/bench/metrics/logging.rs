//! Many clients that log points to their own runs at the same time, in batches as large as the
//! protocol allows.

use std::sync::Barrier;
use std::thread;
use std::time::Instant;

use anyhow::{anyhow, ensure};
use serde_json::json;

use super::client::{Client, Point};

pub const CLIENTS: usize = 64;
/// Points per request, which is MLflow's bound.
pub const BATCH: u64 = 1000;

pub struct Logged {
    /// Points per second, over all clients.
    pub per_second: f64,
    /// Number of requests that the server refused and that were sent again.
    pub refused: u64,
}

/// Lets each client log `batches` batches, and reads all of them back.
///
/// # Errors
/// A point is missing, occurs twice or has another value.
pub fn log(url: &str, batches: u64) -> anyhow::Result<Logged> {
    let client = Client::new(url);
    let runs: Vec<String> = (0..CLIENTS)
        .map(|number| client.begin_run(&format!("client-{number}")))
        .collect::<anyhow::Result<_>>()?;
    let all_ready = Barrier::new(CLIENTS + 1);
    let (refused, seconds) = thread::scope(|scope| {
        let logging: Vec<_> = runs
            .iter()
            .enumerate()
            .map(|(number, run)| {
                let all_ready = &all_ready;
                scope.spawn(move || log_alone(url, number, run, batches, all_ready))
            })
            .collect();
        all_ready.wait();
        let began = Instant::now();
        let mut refused = 0;
        for client in logging {
            refused += client.join().map_err(|_| anyhow!("a client panicked"))??;
        }
        anyhow::Ok((refused, began.elapsed().as_secs_f64()))
    })?;
    for (number, run) in runs.iter().enumerate() {
        check(&client, number, run, batches * BATCH)?;
    }
    let points = CLIENTS as f64 * (batches * BATCH) as f64;
    Ok(Logged { per_second: points / seconds, refused })
}

/// Logs with one client and gives the number of refusals. All request bodies are made first, so
/// that only the server is measured.
fn log_alone(
    url: &str,
    number: usize,
    run: &str,
    batches: u64,
    all_ready: &Barrier,
) -> anyhow::Result<u64> {
    let client = Client::new(url);
    let bodies: Vec<String> = (0..batches).map(|batch| body(number, run, batch)).collect();
    all_ready.wait();
    let mut refused = 0;
    for body in &bodies {
        refused += client.post_until_accepted("/api/2.0/mlflow/runs/log-batch", body)?.1;
    }
    Ok(refused)
}

fn body(number: usize, run: &str, batch: u64) -> String {
    let metric = |step| {
        let timestamp = 1_700_000_000_000 + step;
        json!({"key": "loss", "step": step, "timestamp": timestamp, "value": value(number, step)})
    };
    let metrics: Vec<_> = (batch * BATCH..(batch + 1) * BATCH).map(metric).collect();
    json!({"run_id": run, "metrics": metrics}).to_string()
}

/// A value that differs for each client and step.
fn value(number: usize, step: u64) -> f64 {
    number as f64 + 1.0 / (step as f64 + 2.0)
}

fn check(client: &Client, number: usize, run: &str, points: u64) -> anyhow::Result<()> {
    let found = client.history(run, "loss")?;
    let sent = (0..points).map(|step| Point { step, value: value(number, step) });
    let is_whole = found.iter().copied().eq(sent);
    ensure!(is_whole, "client {number} sent {points} points and reads {} of them", found.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_batch_has_its_points_and_no_others() {
        let body: serde_json::Value = serde_json::from_str(&body(3, "r", 2)).unwrap();
        let metrics = body["metrics"].as_array().unwrap();
        assert_eq!(metrics.len(), 1000);
        assert_eq!(
            (metrics[0]["step"].as_u64(), metrics[999]["step"].as_u64()),
            (Some(2000), Some(2999))
        );
        assert_eq!(metrics[0]["value"].as_f64(), Some(3.0 + 1.0 / 2002.0));
    }
}
