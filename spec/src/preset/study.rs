//! The paper's whole study as one pipeline, at three sizes.

use serde_json::{Map, Value, json};

use super::{DATASETS, Preset, PresetPlace};

/// How much of the study is done: the same jobs, smaller.
struct Scale {
    name: &'static str,
    about: &'static str,
    /// Robots of each training set.
    trajectories: u64,
    shard_trajectories: u64,
    /// Suffix of the models' presets.
    size: &'static str,
    batch_size: u32,
    steps: u64,
    /// Robots of each cell of a sweep.
    robots: usize,
    chirp_hz: &'static [f64],
    multisine_hz: &'static [f64],
    /// Of the fewer cells in which samples and warm starts are looked at.
    robots_of_samples: usize,
    samples: u32,
    /// Control periods before the one that is scored, of warm starts.
    rounds: u32,
    latency_repeats: u32,
}

const FULL_CHIRP_HZ: [f64; 10] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
const FULL_MULTISINE_HZ: [f64; 11] = [0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5];

/// One cell inside of every training set, and one outside of most.
const FEW_CHIRP_HZ: [f64; 2] = [0.3, 1.0];
const FEW_MULTISINE_HZ: [f64; 2] = [0.15, 0.45];

const SCALES: [Scale; 3] = [
    Scale {
        name: "paper-study-tiny",
        about: "The paper's study in twenty minutes: every job of it, too small to conclude from",
        trajectories: 8192,
        shard_trajectories: 4096,
        size: "tiny",
        batch_size: 32,
        steps: 200,
        robots: 10,
        chirp_hz: &[0.1, 0.3, 0.5, 0.7, 1.0],
        multisine_hz: &[0.05, 0.15, 0.25, 0.35, 0.45],
        robots_of_samples: 8,
        samples: 8,
        rounds: 4,
        latency_repeats: 50,
    },
    Scale {
        name: "paper-study-small",
        about: "The paper's study with tiny models, in some hours on two cores",
        trajectories: 65_536,
        shard_trajectories: 8192,
        size: "tiny",
        batch_size: 32,
        steps: 2500,
        robots: 50,
        chirp_hz: &FULL_CHIRP_HZ,
        multisine_hz: &FULL_MULTISINE_HZ,
        robots_of_samples: 16,
        samples: 16,
        rounds: 8,
        latency_repeats: 200,
    },
    Scale {
        name: "paper-study",
        about: "The paper's study at its own sizes: 24 trainings of 3.5e6 samples",
        trajectories: 350_000,
        shard_trajectories: 50_000,
        size: "paper",
        batch_size: 64,
        // 3.5e5 robots, ten times each.
        steps: 54_688,
        robots: 100,
        chirp_hz: &FULL_CHIRP_HZ,
        multisine_hz: &FULL_MULTISINE_HZ,
        robots_of_samples: 100,
        samples: 32,
        rounds: 8,
        latency_repeats: 1000,
    },
];

/// The models that are compared, as they are called in the pipeline.
const MODELS: [&str; 6] = ["robomorph", "robomorph-gaussian", "diffuser", "cdcnn", "cdt", "flow"];

/// Those whose chains can be cut short.
const DENOISERS: [&str; 3] = ["diffuser", "cdcnn", "cdt"];

/// Context and horizon of the trainings.
const SAMPLES: u32 = 400;

/// The training set that the paper's warm starts were tried on.
const WARM_START_ON: &str = "d2";

pub(super) fn studies() -> impl Iterator<Item = Preset> {
    SCALES.iter().map(|scale| Preset {
        name: scale.name.to_owned(),
        about: scale.about.to_owned(),
        place: PresetPlace::Job,
        spec: json!({"kind": "pipeline", "name": scale.name, "jobs": jobs(scale)}),
    })
}

fn jobs(scale: &Scale) -> Map<String, Value> {
    let mut jobs = Map::new();
    for (set, ..) in DATASETS {
        let prefix = set.to_lowercase();
        jobs.insert(format!("{prefix}-data"), training_set(set, scale));
        for name in MODELS {
            jobs.insert(format!("{prefix}-{name}"), training(&prefix, name, scale));
        }
        jobs.insert(format!("{prefix}-sweep"), sweep(&prefix, scale));
        jobs.insert(format!("{prefix}-samples"), samples(&prefix, scale));
    }
    jobs.insert("warm-start".to_owned(), warm_start(scale));
    jobs
}

fn training_set(set: &str, scale: &Scale) -> Value {
    json!({
        "preset": format!("{set}-mixed"),
        "trajectories": scale.trajectories,
        "shard_trajectories": scale.shard_trajectories,
    })
}

/// Every model sees the same trajectories in the same number of steps.
fn training(prefix: &str, name: &str, scale: &Scale) -> Value {
    let mut training = json!({
        "kind": "train",
        "data": {"job": format!("{prefix}-data")},
        "model": model(name, scale),
        "normalization": "dataset",
        "batch_size": scale.batch_size,
        "steps": scale.steps,
        "validate_every_steps": scale.steps.div_ceil(5),
        "sampled_trajectories": 64,
    });
    if scale.size == "paper" {
        training["optimizer"] = json!({"learning_rate": learning_rate_as_published(name)});
    } else {
        training["optimizer"] = json!({
            "learning_rate": if name.starts_with("robomorph") { 3e-3 } else { 2e-3 },
            "warmup_steps": scale.steps.min(2000) / 10,
            "gradient_clip_norm": 1.0,
        });
    }
    training
}

fn learning_rate_as_published(name: &str) -> f64 {
    if name.starts_with("robomorph") || name == "diffuser" { 6e-4 } else { 1e-4 }
}

fn model(name: &str, scale: &Scale) -> Value {
    let architecture = name.trim_end_matches("-gaussian");
    let mut model = json!({"preset": format!("{architecture}-{}", scale.size)});
    if name.ends_with("-gaussian") {
        model["head"] = json!("gaussian");
    }
    if DENOISERS.contains(&name) {
        // All levels, as in the paper; what fewer cost is the warm start's question.
        model["sampler"] = json!({"kind": "ddpm", "steps": 100});
    }
    model
}

/// Every predictor over the whole grid, one prediction each.
fn sweep(prefix: &str, scale: &Scale) -> Value {
    json!({
        "kind": "evaluate",
        "data": grid(scale.chirp_hz, scale.multisine_hz, scale.robots, 0),
        "checkpoints": checkpoints(prefix, &MODELS),
    })
}

/// Several predictions of each scenario, for what they say about their own uncertainty.
fn samples(prefix: &str, scale: &Scale) -> Value {
    json!({
        "kind": "evaluate",
        "data": grid(&FEW_CHIRP_HZ, &FEW_MULTISINE_HZ, scale.robots_of_samples, 0),
        "checkpoints": checkpoints(prefix, &["robomorph-gaussian", "diffuser", "cdcnn", "cdt", "flow"]),
        "baselines": ["damped-integrator"],
        "samples": scale.samples,
    })
}

/// Chains cut short: from noise, from the model's own prediction a control period ago, and, as a
/// control that leaks the future, from the truth. Latencies of all models beside.
fn warm_start(scale: &Scale) -> Value {
    let starts = ["cold", "shifted", "oracle"].map(
        |start| json!({"kind": "ddpm", "steps": [1, 2, 3, 5, 10, 20, 50, 100], "start": start}),
    );
    json!({
        "kind": "evaluate",
        "data": grid(&FEW_CHIRP_HZ, &FEW_MULTISINE_HZ, scale.robots_of_samples, scale.rounds),
        "checkpoints": checkpoints(WARM_START_ON, &MODELS),
        "baselines": ["damped-integrator"],
        "samplers": starts,
        "rounds": scale.rounds,
        "latency": {"repeats": scale.latency_repeats},
    })
}

/// Robots that no training has seen: their seed is none of the training sets'.
fn grid(chirp_hz: &[f64], multisine_hz: &[f64], robots: usize, rounds: u32) -> Value {
    json!({"stream": {
        "trajectories": robots * (chirp_hz.len() + multisine_hz.len()),
        "samples": SAMPLES + rounds,
        "seed": 1_000_003,
        "excitation": {
            "chirp": {"frequency_hz": {"grid": chirp_hz}},
            "multisine": {"frequency_hz": {"grid": multisine_hz}},
        },
    }})
}

fn checkpoints(prefix: &str, models: &[&str]) -> Vec<Value> {
    models.iter().map(|model| json!({"job": format!("{prefix}-{model}")})).collect()
}
