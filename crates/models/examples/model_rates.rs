//! Prints how long a training step takes, or a prediction of a single trajectory.
//!
//! `cargo run --release -p models --example model_rates -- training|inference [--json]
//! [--steps COUNT] [--batch COUNT] [--device NAME] [--matmul-precision f32|bf16] [PRESET ..]`
//!
//! A training step has 64 trajectories, or `--batch`, and is complete: noise, loss, gradients, optimizer. A prediction is one pass of the
//! network. A denoiser also predicts with 5 steps of DDIM and with 100 of DDPM. Every prediction
//! includes normalization and noise. A first run warms up and does not count. A device other than the processor needs a
//! build with its feature, such as `--features models/gpu`.
//! `tests/peers/pytorch_rates.py` measures the same networks in PyTorch.

/// The allocator that the product uses.
#[path = "../../../src/allocator.rs"]
mod allocator;

use std::error::Error;
use std::time::Instant;

use models::{Device, DeviceKind, ModelError, Sampling, TrainedModel, Trainer, TrainingData};
use serde_json::{Value, json};
use series::measured_quantile;
use series::{Series, Shape, ShapeError};
use spec::{JobSpec, PresetPlace, SamplerKind, SamplerSpec};

/// Joints of the Panda.
const JOINTS: usize = 7;

const BATCH: u32 = 64;
const DATA: TrainingData =
    TrainingData { samples: 400, joints: JOINTS, rate_hz: 60.0, statistics: None };

/// Predictions that are timed for each step that the caller asks for.
const PASSES: usize = 20;
const CHAINS: usize = 4;

#[derive(Clone, Copy, PartialEq, Eq)]
enum What {
    Training,
    Inference,
}

fn main() -> Result<(), Box<dyn Error>> {
    allocator::keep_freed_memory();
    let mut arguments = std::env::args().skip(1);
    let what = match arguments.next().as_deref() {
        Some("training") => What::Training,
        Some("inference") => What::Inference,
        _ => return Err("say what to measure: training or inference".into()),
    };
    let (mut json, mut steps, mut batch) = (false, 5, BATCH);
    let (mut precision, mut wanted) = (None, Vec::new());
    let mut device = DeviceKind::Cpu;
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--json" => json = true,
            "--steps" => steps = arguments.next().ok_or("--steps needs a number")?.parse()?,
            "--batch" => batch = arguments.next().ok_or("--batch needs a number")?.parse()?,
            "--device" => device = arguments.next().ok_or("--device needs a name")?.parse()?,
            "--matmul-precision" => {
                precision = Some(arguments.next().ok_or("--matmul-precision needs a name")?);
            }
            _ => wanted.push(argument),
        }
    }
    if wanted.is_empty() {
        let models = spec::presets().iter().filter(|preset| preset.place == PresetPlace::Model);
        wanted = models.map(|preset| preset.name.clone()).collect();
    }
    let device = Device::open(device)?;
    let mut all = Vec::new();
    for preset in wanted {
        let (config, times) = measure(&preset, precision.as_deref(), what, batch, steps, &device)?;
        if !json {
            println!("{preset:<18} {:>9} parameters  {times}", config["parameters"]);
        }
        let threads = rayon::current_num_threads();
        all.push(json!({"preset": preset, "threads": threads, "times": times, "config": config}));
    }
    if json {
        println!("{}", Value::Array(all));
    }
    Ok(())
}

/// Measures a model, and gives its checkpoint's `config.json` with the times.
fn measure(
    preset: &str,
    precision: Option<&str>,
    what: What,
    batch: u32,
    steps: usize,
    device: &Device,
) -> Result<(Value, Value), Box<dyn Error>> {
    let mut model = json!({"preset": preset});
    if let Some(precision) = precision {
        model["matmul_precision"] = precision.into();
    }
    let job = json!({
        "kind": "train", "data": {"dataset": 1}, "model": model, "steps": 1000,
        "batch_size": batch,
    });
    let JobSpec::Train(spec) = spec::parse(job.to_string().as_bytes())? else {
        return Err("not a training".into());
    };
    #[cfg(feature = "torch")]
    let _ = kernels::torch::peak_bytes();
    let mut trainer = Trainer::new(&spec, DATA, "none", device)?;
    if what == What::Training {
        let batch = waves(batch as usize)?;
        let times = times_ms(steps, || trainer.step(&batch))?;
        let times = json!({"step_ms": measured_quantile(&times, 0.5), "peak_memory_mib": peak_memory_mib()});
        #[cfg(feature = "torch")]
        let times = with_device_memory(times);
        return Ok((serde_json::from_slice(&trainer.checkpoint()?.config)?, times));
    }

    let files = trainer.checkpoint()?;
    drop(trainer);
    let model = TrainedModel::from_files(&files, device)?;
    let waves = waves(1)?;
    let input = waves.observed(model.context());
    let mut times = json!({});
    let mut note = |name: &str, measured: &[f64]| {
        times[name] = json!({"p50": measured_quantile(measured, 0.5), "p99": measured_quantile(measured, 0.99)});
    };
    if model.is_generative() {
        let ways = [
            ("pass_ms", SamplerKind::Ddim, 1, PASSES),
            ("ddim_5_ms", SamplerKind::Ddim, 5, CHAINS),
            ("ddpm_100_ms", SamplerKind::Ddpm, 100, 1),
            ("pass_ms", SamplerKind::Euler, 1, PASSES),
            ("euler_2_ms", SamplerKind::Euler, 2, CHAINS),
        ];
        for (name, kind, passes, count) in ways {
            let sampler = SamplerSpec { kind, steps: Some(passes), ..SamplerSpec::default() };
            if model.architecture().check_sampler(&sampler).is_err() {
                continue;
            }
            let sampling = Sampling { sampler: Some(sampler), ..Sampling::default() };
            note(name, &times_ms(count * steps, || model.sample(&input, &sampling))?);
        }
    } else {
        note("pass_ms", &times_ms(PASSES * steps, || model.predict(&input))?);
    }
    Ok((serde_json::from_slice(&files.config)?, times))
}

/// Made-up torques and positions, finite and not constant.
fn waves(robots: usize) -> Result<Series, ShapeError> {
    let shape = Shape { robots, samples: DATA.samples as usize, joints: JOINTS };
    let values = shape.values()?;
    let wave = |scale: f32| (0..values).map(|index| scale * (0.37 * index as f32).sin()).collect();
    Series::new(shape, DATA.rate_hz, wave(5.0), wave(0.5))
}

/// The times of `count` runs of `action` in ms, in ascending order, after one run that does not
/// count.
fn times_ms<T>(
    count: usize,
    mut action: impl FnMut() -> Result<T, ModelError>,
) -> Result<Vec<f64>, ModelError> {
    action()?;
    let mut times = Vec::with_capacity(count);
    for _ in 0..count.max(1) {
        let start = Instant::now();
        action()?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times)
}

/// The times with the most memory that tensors have had on the GPU, in MiB.
#[cfg(feature = "torch")]
fn with_device_memory(mut times: Value) -> Value {
    times["peak_device_memory_mib"] =
        json!(kernels::torch::peak_bytes() as f64 / f64::from(1 << 20));
    times
}

/// The most memory that this process has had, in MiB, where Linux reports it.
fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}
