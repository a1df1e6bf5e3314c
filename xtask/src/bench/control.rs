//! A controller's loop: a measured sample in, a prediction out, over a WebSocket on loopback.

use std::net::TcpStream;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, ensure};
use serde::Deserialize;
use serde_json::{Value, json};
use series::measured_quantile;
use tungstenite::{Message, WebSocket, client};

use super::isa;
use super::measurement::{Goal, Measurement};
use super::serving::Serving;
use super::wanted::{BenchmarkResults, Peers, Wanted};
use crate::{process, product};

/// Numbers of network passes per prediction.
const STEPS: [u32; 4] = [1, 5, 10, 100];

/// The bounds on a prediction in 5 warm-started steps, ms: the paper's with AVX-512, and twice that
/// otherwise.
const GOAL: (f64, f64) = (40.0, 80.0);
const GOAL_STEPS: u32 = 5;

/// The period of samples at 60 Hz, ms.
const PERIOD_MS: f64 = 1000.0 / 60.0;

/// Samples of the trainings' context.
const CONTEXT: usize = 320;

/// The network that predicts in one pass. The others are denoisers.
const ONE_PASS: &str = "robomorph";

/// Architectures, each with the numbers that its matrix products read.
const NETWORKS: [(&str, &str); 6] = [
    ("cdt", F32),
    ("cdt", "bf16"),
    ("diffuser", F32),
    ("cdcnn", F32),
    (ONE_PASS, F32),
    (ONE_PASS, "bf16"),
];
const F32: &str = "f32";

pub(super) fn run(wanted: Wanted) -> anyhow::Result<BenchmarkResults> {
    if wanted.peers == Peers::Measured {
        eprintln!("no other program serves such predictions: nothing to compare with");
    }
    let torqued = product::build()?;
    let data = tempfile::Builder::new().prefix("torqued-bench-").tempdir()?;
    let workers = Serving::start(&torqued, data.path(), 1)?;
    for network in NETWORKS {
        train(&torqued, data.path(), &workers, network)?;
    }
    drop(workers);

    // There are no workers, because they would compete for the processor.
    let server = Serving::start(&torqued, data.path(), 0)?;
    let checkpoints = checkpoints(&torqued, &server)?;
    let mut measurements = Vec::new();
    let mut threads = Value::Null;
    for (architecture, precision, checkpoint) in checkpoints {
        let mut name = format!("{architecture}-small");
        if precision != F32 {
            name += &format!(", {precision}");
        }
        let mut p99_of_steps = Vec::new();
        let all = if architecture == ONE_PASS { &STEPS[..1] } else { &STEPS[..] };
        for &steps in all {
            eprintln!("{name}, {steps} steps");
            let mut stream = Stream::open(&server, checkpoint, &architecture, steps)?;
            threads = stream.opened["threads"].clone();
            let times = stream.measure(if steps > 10 { 60 } else { 400 })?;
            let goal = (steps == GOAL_STEPS).then(|| Goal::AtMost(isa::bound(GOAL.0, GOAL.1)));
            let what = match (architecture.as_str(), steps) {
                (ONE_PASS, _) => name.clone(),
                (_, 1) => format!("{name}, 1 step"),
                _ => format!("{name}, {steps} steps"),
            };
            let [whole, compute] = [times.whole, times.compute].map(rising);
            let p99 = measured_quantile(&whole, 0.99);
            let rows = [
                ("loop, p50", measured_quantile(&whole, 0.5), None),
                ("loop, p99", p99, goal),
                ("computing, p50", measured_quantile(&compute, 0.5), None),
                ("computing, p99", measured_quantile(&compute, 0.99), None),
            ];
            for (of, value, goal) in rows {
                measurements.push(Measurement::alone(format!("{what}, {of}"), value, "ms", goal));
            }
            p99_of_steps.push((steps, p99));
        }
        if let Some(fit) = steps_within(PERIOD_MS, &p99_of_steps) {
            let what = format!("{name}, steps within 16.7 ms");
            measurements.push(Measurement::alone(what, fit, "", None));
        }
    }
    let notes = vec![
        format!("{threads} threads; context {CONTEXT}, horizon 80; random weights"),
        "a loop is one message of a client and its answer, JSON both; warm-started, DDIM"
            .to_owned(),
        "steps within 16.7 ms: from the p99 of loops with 1 and 10 steps".to_owned(),
    ];
    Ok(BenchmarkResults { notes, measurements })
}

/// Trains for one step, which leaves a checkpoint.
fn train(
    torqued: &Path,
    data: &Path,
    server: &Serving,
    (architecture, precision): (&str, &str),
) -> anyhow::Result<()> {
    let mut model = json!({"preset": format!("{architecture}-small")});
    if precision != F32 {
        model["matmul_precision"] = precision.into();
    }
    let spec = json!({
        "kind": "train", "data": {"stream": {"preset": "D1-multisine"}}, "context": CONTEXT,
        "model": model, "batch_size": 4, "steps": 1,
        "optimizer": {"warmup_steps": 0}, "sampled_trajectories": 1, "validation_trajectories": 1,
    });
    let file = data.join(format!("{architecture}-{precision}.json"));
    std::fs::write(&file, spec.to_string())?;
    let mut submit = Command::new(torqued);
    submit.args(["submit", "--watch", "--server", &server.url]).arg(&file);
    ensure!(process::run(&mut submit)?.success, "{architecture} was not trained");
    Ok(())
}

#[derive(Deserialize)]
struct JobList {
    jobs: Vec<Job>,
}

#[derive(Deserialize)]
struct Job {
    spec: Value,
    checkpoints: Vec<i64>,
}

/// The architecture, the precision and the checkpoint of each training.
fn checkpoints(torqued: &Path, server: &Serving) -> anyhow::Result<Vec<(String, String, i64)>> {
    let mut jobs = Command::new(torqued);
    let list: JobList =
        super::dynamics::answer(jobs.args(["jobs", "--json", "--server", &server.url]))?;
    let of = |job: &Job| {
        let model = job.spec.get("model")?;
        let architecture = model.get("architecture")?.as_str()?.to_owned();
        let precision = model.get("matmul_precision").and_then(Value::as_str).unwrap_or(F32);
        Some((architecture, precision.to_owned(), *job.checkpoints.last()?))
    };
    let mut found: Vec<_> = list.jobs.iter().filter_map(of).collect();
    found.sort();
    ensure!(found.len() == NETWORKS.len(), "not every training left a checkpoint");
    Ok(found)
}

/// An open stream whose context is full.
struct Stream {
    socket: WebSocket<TcpStream>,
    opened: Value,
    horizon: usize,
    samples: usize,
}

/// Times of each loop, ms.
struct Times {
    whole: Vec<f64>,
    compute: Vec<f64>,
}

impl Stream {
    fn open(
        server: &Serving,
        checkpoint: i64,
        architecture: &str,
        steps: u32,
    ) -> anyhow::Result<Self> {
        let address = server.url.trim_start_matches("http://");
        let connection = TcpStream::connect(address)?;
        connection.set_nodelay(true)?;
        let url = format!("ws://{address}/v1/checkpoints/{checkpoint}/stream");
        let (socket, _) = client(url, connection).context("the stream was not opened")?;
        let mut stream = Self { socket, opened: Value::Null, horizon: 0, samples: 0 };
        let open = match architecture {
            ONE_PASS => json!({"open": {}}),
            _ => json!({"open": {
                "warm_start_steps": steps,
                "sampling": {"sampler": {"kind": "ddim", "steps": steps}},
            }}),
        };
        stream.opened = stream.ask(&open.to_string())?["opened"].take();
        let horizon = stream.opened["horizon"].as_u64().context("the stream has no horizon")?;
        stream.horizon = usize::try_from(horizon)?;
        let fill = json!({"step": {"u": rows(0, CONTEXT, 5.0), "y": rows(0, CONTEXT, 0.3)}});
        stream.ask(&fill.to_string())?;
        stream.samples = CONTEXT;
        Ok(stream)
    }

    /// Measures the times of `loops` loops. The first tenth does not count.
    fn measure(&mut self, loops: usize) -> anyhow::Result<Times> {
        let mut times = Times { whole: Vec::new(), compute: Vec::new() };
        for index in 0..loops + loops / 10 {
            let started = Instant::now();
            let first = self.samples;
            let message = json!({"step": {
                "u": rows(first, 1, 5.0), "y": rows(first, 1, 0.3),
                "future_u": rows(first + 1, self.horizon, 5.0),
            }});
            let answer = self.ask(&message.to_string())?;
            let whole = started.elapsed().as_secs_f64() * 1e3;
            self.samples += 1;
            let prediction = &answer["prediction"];
            let compute = prediction["latency_ms"]["compute"].as_f64();
            let compute = compute.with_context(|| format!("no prediction: {answer}"))?;
            if index >= loops / 10 {
                times.whole.push(whole);
                times.compute.push(compute);
            }
        }
        Ok(times)
    }

    fn ask(&mut self, message: &str) -> anyhow::Result<Value> {
        self.socket.send(Message::text(message))?;
        loop {
            if let Message::Text(text) = self.socket.read()? {
                let answer: Value = serde_json::from_str(&text)?;
                ensure!(answer.get("error").is_none(), "{answer}");
                return Ok(answer);
            }
        }
    }
}

/// `[count][7]` values of slow waves, in the layout of a recording.
fn rows(first: usize, count: usize, scale: f64) -> Value {
    let value = |row: usize, joint: usize| scale * (0.02 * row as f64 + joint as f64).sin();
    (first..first + count)
        .map(|row| (0..7).map(|joint| value(row, joint)).collect::<Value>())
        .collect()
}

fn rising(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

/// The number of steps within `budget_ms`, if each step takes as long as those between 1 and 10.
fn steps_within(budget_ms: f64, times: &[(u32, f64)]) -> Option<f64> {
    let of = |steps| times.iter().find(|(found, _)| *found == steps).map(|(_, ms)| *ms);
    let (one, ten) = (of(1)?, of(10)?);
    let step = (ten - one) / 9.0;
    Some((1.0 + (budget_ms - one) / step).floor().max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_steps_fit_as_their_times_say() {
        assert_eq!(steps_within(16.7, &[(1, 3.0), (5, 0.0), (10, 21.0)]), Some(7.0));
        assert_eq!(steps_within(2.0, &[(1, 3.0), (10, 12.0)]), Some(0.0));
        assert_eq!(steps_within(16.7, &[(1, 3.0)]), None);
    }

    #[test]
    fn recordings_go_on_where_they_were() {
        let all = rows(0, 5, 2.0);
        assert_eq!(rows(3, 2, 2.0).as_array().unwrap()[..], all.as_array().unwrap()[3..]);
    }
}
