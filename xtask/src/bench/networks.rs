//! Measures our networks and their PyTorch twins alternately, in separate processes.

use std::io::Write;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use series::median;

use super::measurement::Peer;
use super::peak;
use super::wanted::{BenchmarkResults, Peers, Size, Wanted};
use crate::places::repository;
use crate::{peers, product};

/// Architectures, each with the numbers that its matrix products read.
const NETWORKS: [(&str, Matmul); 6] = [
    ("robomorph", Matmul::F32),
    ("robomorph", Matmul::Bf16),
    ("cdt", Matmul::F32),
    ("cdt", Matmul::Bf16),
    ("diffuser", Matmul::F32),
    ("cdcnn", Matmul::F32),
];

/// Trajectories of a training step.
const BATCH: u32 = 64;

/// Those of a CDT of the paper's size. With 64 of them PyTorch needs more than 24 GiB.
const BATCH_OF_LARGE_CDT: u32 = 16;

/// The `matmul_precision` of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Matmul {
    F32,
    /// Its twin is measured with f32, and under `torch.autocast`.
    Bf16,
}

/// The part of a network that is measured.
pub(super) struct Subject {
    /// Its name in the example of `models` and in the script of its peers.
    pub name: &'static str,
    /// JSON pointer to the number whose ratio is printed for each round.
    pub pointer: &'static str,
    /// Whether it is about batches rather than single trajectories.
    pub has_batches: bool,
    pub small: Rounds,
    /// Rounds for networks of the paper's size.
    pub paper: Rounds,
}

/// The number of rounds, and of steps in each. Other load on the machine lasts for seconds, so many
/// short rounds give more reliable medians.
#[derive(Clone, Copy)]
pub(super) struct Rounds {
    pub count: usize,
    pub steps: usize,
}

/// A network's rounds.
pub(super) struct Network {
    pub architecture: &'static str,
    pub name: String,
    rounds: Vec<Round>,
}

/// One measurement of every program, in turn.
struct Round {
    ours: Ours,
    /// Peak of multiply-adds per second, on the same number of threads.
    peak: f64,
    eager: Option<Theirs>,
    compiled: Option<Theirs>,
    autocast: Option<Theirs>,
}

/// The output of `crates/models/examples/model_rates.rs`.
#[derive(Clone, Debug, Deserialize)]
struct Ours {
    threads: usize,
    times: Value,
    config: Value,
}

/// The output of `crates/models/tests/peers/pytorch_rates.py`.
#[derive(Clone, Debug, Deserialize)]
struct Theirs {
    version: String,
    times: Value,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Twin {
    Eager,
    /// The twin after `torch.compile`.
    Compiled,
    /// The twin under `torch.autocast` to bf16.
    Autocast,
}

impl Twin {
    const fn name(self) -> &'static str {
        match self {
            Self::Eager => "eager",
            Self::Compiled => "compiled",
            Self::Autocast => "autocast",
        }
    }
}

impl Network {
    /// Median over the rounds of the value at a JSON pointer in the times.
    pub fn ours(&self, pointer: &str) -> Option<f64> {
        median_of(self.rounds.iter().map(|round| number(&round.ours.times, pointer)))
    }

    /// The same for a twin, over the rounds in which it was measured.
    pub fn twin(&self, twin: Twin, pointer: &str) -> Option<Peer> {
        let theirs = self.rounds.iter().map(|round| match twin {
            Twin::Eager => round.eager.as_ref(),
            Twin::Compiled => round.compiled.as_ref(),
            Twin::Autocast => round.autocast.as_ref(),
        });
        let theirs: Vec<&Theirs> = theirs.flatten().collect();
        let value = median_of(theirs.iter().map(|theirs| number(&theirs.times, pointer)))?;
        let version = format!("PyTorch {} {}", theirs.first()?.version, twin.name());
        Some(Peer { value, version })
    }

    /// Peak of multiply-adds per second on our threads.
    pub fn peak(&self) -> f64 {
        median(self.rounds.iter().map(|round| round.peak).collect())
    }

    /// Lowest and highest ratio of our time to that of eager PyTorch, over the rounds.
    fn ratios(&self, pointer: &str) -> Option<[f64; 2]> {
        let ratios = self.rounds.iter().filter_map(|round| {
            let theirs = number(&round.eager.as_ref()?.times, pointer)?;
            Some(number(&round.ours.times, pointer)? / theirs)
        });
        let bounds = |[low, high]: [f64; 2], ratio: f64| [low.min(ratio), high.max(ratio)];
        ratios.map(|ratio| [ratio; 2]).reduce(|all, [ratio, _]| bounds(all, ratio))
    }
}

/// Measures every wanted network. `table` makes the rows of each.
pub(super) fn run(
    subject: &Subject,
    wanted: Wanted,
    table: fn(&Network) -> Vec<super::measurement::Measurement>,
) -> anyhow::Result<BenchmarkResults> {
    let example = product::build_example("model_rates")?;
    let python = match wanted.peers {
        Peers::LeftOut => None,
        Peers::Measured => Some(peers::pytorch()?),
    };
    let bench = Bench { subject, example, python, batch: BATCH, matmul: Matmul::F32 };
    let mut notes = Vec::new();
    let mut measurements = Vec::new();
    for size in [Size::Small, Size::Paper] {
        if wanted.size.is_some_and(|wanted| wanted != size) {
            continue;
        }
        let (name, Rounds { count, steps }) = match size {
            Size::Small => ("small", subject.small),
            Size::Paper => ("paper", subject.paper),
        };
        let count = wanted.rounds.map_or(count, NonZeroUsize::get);
        for (architecture, matmul) in NETWORKS {
            let preset = format!("{architecture}-{name}");
            let batch = match (architecture, size) {
                ("cdt", Size::Paper) => BATCH_OF_LARGE_CDT,
                _ => BATCH,
            };
            let mut label = preset.clone();
            if matmul == Matmul::Bf16 {
                label += ", bf16";
            }
            if batch != BATCH && subject.has_batches {
                label += &format!(", batches of {batch}");
            }
            let bench = Bench { batch, matmul, ..bench.clone() };
            let mut rounds = Vec::new();
            // Compiling takes minutes, and much longer for the paper's networks.
            let mut twins = match (size, matmul) {
                (_, Matmul::Bf16) => vec![Twin::Eager, Twin::Autocast],
                (Size::Small, Matmul::F32) => vec![Twin::Eager, Twin::Compiled],
                (Size::Paper, Matmul::F32) => vec![Twin::Eager],
            };
            for round in 1..=count {
                eprintln!("{label}, round {round} of {count}");
                let round = bench.round(&preset, &twins, steps, &mut notes)?;
                // A twin that ran out of memory once would do so again.
                twins.retain(|&twin| match twin {
                    Twin::Eager => round.eager.is_some(),
                    Twin::Compiled => false,
                    Twin::Autocast => round.autocast.is_some(),
                });
                rounds.push(round);
            }
            let network = Network { architecture, name: label, rounds };
            if let Some([low, high]) = network.ratios(subject.pointer) {
                let name = &network.name;
                notes.push(format!("{name}: ratios of single rounds {low:.2} to {high:.2}"));
            }
            measurements.extend(table(&network));
        }
        notes.push(format!("{name}: medians of {count} x {steps} steps, after a first one each"));
    }
    Ok(BenchmarkResults { notes, measurements })
}

#[derive(Clone)]
struct Bench<'a> {
    subject: &'a Subject,
    example: PathBuf,
    /// Python with PyTorch.
    python: Option<PathBuf>,
    batch: u32,
    matmul: Matmul,
}

impl Bench<'_> {
    fn round(
        &self,
        preset: &str,
        twins: &[Twin],
        steps: usize,
        notes: &mut Vec<String>,
    ) -> anyhow::Result<Round> {
        let mut rates = Command::new(&self.example);
        rates.arg(self.subject.name).args(["--json", "--steps", &steps.to_string(), preset]);
        rates.args(["--batch", &self.batch.to_string()]);
        if self.matmul == Matmul::Bf16 {
            rates.args(["--matmul-precision", "bf16"]);
        }
        let ours: Vec<Ours> = super::dynamics::answer(&mut rates)?;
        let ours = ours.into_iter().next().context("model_rates measured nothing")?;
        let peak = peak::multiply_adds_per_s(ours.threads);
        let mut round = Round { ours, peak, eager: None, compiled: None, autocast: None };
        let Some(python) = &self.python else { return Ok(round) };
        for &twin in twins {
            let answer = match self.ask(python, &round.ours, twin, steps) {
                Ok(theirs) => Some(theirs),
                Err(error) => {
                    let reason = error.to_string();
                    let reason = reason.lines().last().unwrap_or_default();
                    notes.push(format!("{preset}, {twin:?} twin: not measured: {reason}"));
                    None
                }
            };
            match twin {
                Twin::Eager => round.eager = answer,
                Twin::Compiled => round.compiled = answer,
                Twin::Autocast => round.autocast = answer,
            }
        }
        Ok(round)
    }

    fn ask(&self, python: &Path, ours: &Ours, twin: Twin, steps: usize) -> anyhow::Result<Theirs> {
        let mut command = Command::new(python);
        command
            .arg("crates/models/tests/peers/pytorch_rates.py")
            .env("PYTHONPATH", repository().join("python"))
            .current_dir(repository());
        let question = json!({
            "config": ours.config, "what": self.subject.name, "compiled": twin == Twin::Compiled,
            "autocast": twin == Twin::Autocast, "batch": self.batch, "threads": ours.threads, "steps": steps,
        });
        asked(&mut command, &question)
    }
}

/// Runs a program with a JSON question on its standard input, and reads its JSON answer.
fn asked<T: DeserializeOwned>(command: &mut Command, question: &Value) -> anyhow::Result<T> {
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot run {}", command.get_program().display()))?;
    if let Some(mut input) = child.stdin.take() {
        input.write_all(question.to_string().as_bytes())?;
    }
    let output = child.wait_with_output()?;
    let error = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{}: {}", output.status, error.trim_end());
    Ok(serde_json::from_slice(&output.stdout)?)
}

fn number(times: &Value, pointer: &str) -> Option<f64> {
    times.pointer(pointer)?.as_f64()
}

/// The median; `None` if a value is missing.
fn median_of(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    values.collect::<Option<Vec<f64>>>().filter(|values| !values.is_empty()).map(median)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A network with these times of ours and of eager PyTorch.
    pub fn network(rounds: &[(Value, Option<Value>)]) -> Network {
        let rounds = rounds.iter().map(|(ours, theirs)| Round {
            ours: Ours { threads: 2, times: ours.clone(), config: json!({}) },
            peak: 1e8,
            eager: theirs.clone().map(|times| Theirs { version: "2".to_owned(), times }),
            compiled: None,
            autocast: None,
        });
        let name = "cdt-small".to_owned();
        Network { architecture: "cdt", name, rounds: rounds.collect() }
    }

    #[test]
    fn numbers_are_medians_of_rounds() {
        let round = |ours: f64| (json!({"a": {"p50": ours}}), Some(json!({"a": {"p50": 4.0}})));
        let network = network(&[round(1.0), round(9.0), round(2.0)]);
        assert_eq!(network.ours("/a/p50"), Some(2.0));
        assert_eq!(network.twin(Twin::Eager, "/a/p50").unwrap().value, 4.0);
        assert_eq!(network.ours("/a/p99"), None);
        assert!(network.twin(Twin::Compiled, "/a/p50").is_none());
    }

    #[test]
    fn ratios_are_of_numbers_of_the_same_round() {
        let round = |ours: f64, theirs: Option<f64>| {
            (json!({"a": ours}), theirs.map(|theirs| json!({"a": theirs})))
        };
        let rounds = [round(1.0, Some(4.0)), round(6.0, Some(8.0)), round(9.0, None)];
        assert_eq!(network(&rounds).ratios("/a"), Some([0.25, 0.75]));
        assert_eq!(network(&rounds[2..]).ratios("/a"), None);
    }

    #[test]
    fn a_twin_counts_in_the_rounds_in_which_it_was_measured() {
        let round = json!({"a": 1.0});
        let network = network(&[(round.clone(), Some(json!({"a": 4.0}))), (round, None)]);
        assert_eq!(network.twin(Twin::Eager, "/a").unwrap().value, 4.0);
    }

    #[test]
    fn programs_are_asked_and_their_failures_kept() {
        let question = json!({"steps": 3});
        let echoed: Value = asked(&mut Command::new("cat"), &question).unwrap();
        assert_eq!(echoed, question);
        let mut failing = Command::new("sh");
        failing.args(["-c", "cat > /dev/null; echo no compiler >&2; exit 3"]);
        let error = asked::<Value>(&mut failing, &question).unwrap_err().to_string();
        assert!(error.contains("exit status: 3") && error.ends_with("no compiler"), "{error}");
    }
}
