//! Prints how long a training step of 64 trajectories and one pass over a single one take.
//!
//! `cargo run --release -p models --example model_rates -- [--json] [--steps COUNT] [PRESET ..]`
//!
//! A step is the whole of it: noise, loss, gradients, optimizer. A pass is a prediction, of a
//! denoiser one in a single step of DDIM. Both are medians, after a first one that does not count.
//! `tests/peers/pytorch_rates.py` measures the same networks in PyTorch, in turns with this.

use std::error::Error;
use std::time::Instant;

use mimalloc::MiMalloc;
use models::{
    Batch, Device, ModelError, PredictionInput, Sampling, TrainedModel, Trainer, TrainingData,
};
use serde_json::{Value, json};
use spec::{JOINTS, JobSpec, PresetPlace, SamplerKind, SamplerSpec};

/// As the product has it: glibc's allocator gives memory back that the next operation wants again.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

const BATCH: usize = 64;
const DATA: TrainingData = TrainingData { samples: 400, rate_hz: 60.0, statistics: None };

fn main() -> Result<(), Box<dyn Error>> {
    let (mut json, mut steps, mut wanted) = (false, 5, Vec::new());
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--json" => json = true,
            "--steps" => steps = arguments.next().ok_or("--steps needs a number")?.parse()?,
            _ => wanted.push(argument),
        }
    }
    if wanted.is_empty() {
        let models =
            spec::presets().into_iter().filter(|preset| preset.place == PresetPlace::Model);
        wanted = models.map(|preset| preset.name).collect();
    }
    if !json {
        println!("{:<18} {:>10} {:>10} {:>12}", "", "step, ms", "pass, ms", "parameters");
    }
    let mut all = Vec::new();
    for preset in wanted {
        let rates = measure(&preset, steps)?;
        if !json {
            println!(
                "{preset:<18} {:>10.1} {:>10.2} {:>12}",
                rates.step_ms, rates.pass_ms, rates.config["parameters"],
            );
        }
        all.push(json!({
            "preset": preset,
            "threads": rayon::current_num_threads(),
            "step_ms": rates.step_ms,
            "pass_ms": rates.pass_ms,
            "peak_memory_mib": rates.peak_memory_mib,
            "config": rates.config,
        }));
    }
    if json {
        println!("{}", Value::Array(all));
    }
    Ok(())
}

struct Rates {
    step_ms: f64,
    pass_ms: f64,
    /// Of the process so far.
    peak_memory_mib: Option<f64>,
    /// A checkpoint's `config.json`.
    config: Value,
}

fn measure(preset: &str, steps: usize) -> Result<Rates, Box<dyn Error>> {
    let job = json!({
        "kind": "train", "data": {"dataset": 1}, "model": {"preset": preset}, "steps": 1000,
    });
    let JobSpec::Train(spec) = spec::parse(job.to_string().as_bytes())? else {
        return Err("not a training".into());
    };
    let device = Device::cpu();
    let batch = waves(BATCH);
    let mut trainer = Trainer::new(&spec, DATA, "none", &device)?;
    let step_ms = median_ms(steps, || trainer.step(&batch))?;

    let files = trainer.checkpoint()?;
    drop(trainer);
    let model = TrainedModel::from_files(&files, &device)?;
    let known = waves(1);
    let y_context = known.y[..model.context() * JOINTS].to_vec();
    let input = PredictionInput { u: known.u, y_context, size: 1 };
    let once = SamplerSpec { kind: SamplerKind::Ddim, steps: Some(1), ..SamplerSpec::default() };
    let sampling = Sampling { sampler: Some(once), ..Sampling::default() };
    let pass_ms = median_ms(10 * steps, || {
        if model.is_generative() { model.sample(&input, &sampling) } else { model.predict(&input) }
    })?;
    let config = serde_json::from_slice(&files.config)?;
    Ok(Rates { step_ms, pass_ms, peak_memory_mib: peak_memory_mib(), config })
}

/// Torques and positions that are no one's, but finite and not constant.
fn waves(size: usize) -> Batch {
    let samples = DATA.samples as usize;
    let wave = |scale: f32| {
        (0..size * samples * JOINTS).map(move |index| scale * (0.37 * index as f32).sin()).collect()
    };
    Batch { u: wave(5.0), y: wave(0.5), size, samples }
}

fn median_ms<T>(
    count: usize,
    mut action: impl FnMut() -> Result<T, ModelError>,
) -> Result<f64, ModelError> {
    action()?;
    let mut times = Vec::with_capacity(count);
    for _ in 0..count.max(1) {
        let start = Instant::now();
        action()?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}

/// Where Linux tells it.
fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}
