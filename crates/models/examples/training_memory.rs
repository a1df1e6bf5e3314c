//! Compares the estimated memory of a training with what the training takes.
//!
//! `cargo run --release -p models --example training_memory -- [PRESET:BATCH[:PARTS] ..]`
//!
//! Each training runs in a process of its own, for two steps and a checkpoint, because the system
//! reports only the highest memory that a process has had so far.

use std::error::Error;
use std::process::Command;

use mimalloc::MiMalloc;
use models::{Device, Trainer, TrainingData, TrainingMemory};
use serde_json::json;
use series::{Series, Shape};
use spec::{JobSpec, TrainSpec};

/// Joints of the Panda.
const JOINTS: usize = 7;

/// The allocator that the product uses.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

const DATA: TrainingData =
    TrainingData { samples: 400, joints: JOINTS, rate_hz: 60.0, statistics: None };

const USUAL: [&str; 9] = [
    "robomorph-tiny:256",
    "robomorph-small:64",
    "diffuser-tiny:64",
    "diffuser-small:32",
    "cdcnn-tiny:64",
    "cdcnn-small:32",
    "cdt-tiny:64",
    "cdt-small:32",
    "cdt-small:64:4",
];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, training] = arguments.as_slice()
        && flag == "--alone"
    {
        return train(&spec_of(training)?);
    }
    if arguments.is_empty() {
        arguments = USUAL.map(str::to_owned).to_vec();
    }
    println!("{:<24} {:>12} {:>12} {:>8}", "", "said, MiB", "taken, MiB", "ratio");
    for training in arguments {
        let memory = TrainingMemory::of(&spec_of(&training)?, DATA.samples, JOINTS)?;
        let said = mebibytes(memory.peak_bytes);
        let child = Command::new(std::env::current_exe()?).args(["--alone", &training]).output()?;
        if !child.status.success() {
            return Err(String::from_utf8_lossy(&child.stderr).into());
        }
        let taken: f64 = String::from_utf8(child.stdout)?.trim().parse()?;
        println!("{training:<24} {said:>12.0} {taken:>12.0} {:>8.2}", said / taken);
    }
    Ok(())
}

/// The spec that `PRESET:BATCH` or `PRESET:BATCH:PARTS` names.
fn spec_of(training: &str) -> Result<TrainSpec, Box<dyn Error>> {
    let mut parts = training.split(':');
    let preset = parts.next().ok_or("PRESET:BATCH is missing")?;
    let batch: u32 = parts.next().ok_or("no batch size")?.parse()?;
    let accumulation: u32 = parts.next().map_or(Ok(1), str::parse)?;
    let job = json!({
        "kind": "train", "data": {"dataset": 1}, "model": {"preset": preset}, "steps": 1000,
        "batch_size": batch, "gradient_accumulation": accumulation,
    });
    match spec::parse(job.to_string().as_bytes())? {
        JobSpec::Train(spec) => Ok(spec),
        _ => Err("not a training".into()),
    }
}

fn train(spec: &TrainSpec) -> Result<(), Box<dyn Error>> {
    let (robots, samples) = (spec.batch_size as usize, DATA.samples as usize);
    let shape = Shape { robots, samples, joints: JOINTS };
    let values = shape.values()?;
    let wave = |scale: f32| (0..values).map(|index| scale * (0.37 * index as f32).sin()).collect();
    let batch = Series::new(shape, DATA.rate_hz, wave(5.0), wave(0.5))?;
    let mut trainer = Trainer::new(spec, DATA, "none", &Device::cpu())?;
    for _ in 0..2 {
        trainer.step(&batch)?;
    }
    trainer.checkpoint()?;
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).ok_or("no VmHWM")?;
    let kib: u64 = line.trim().strip_suffix("kB").ok_or("not in kB")?.trim().parse()?;
    println!("{}", mebibytes(1024 * kib));
    Ok(())
}

#[expect(clippy::cast_precision_loss, reason = "shown without decimals")]
fn mebibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}
