//! The trainings of the study.

use serde_json::{Value, json};

use super::super::plan::StudyTraining;
use super::super::scale::StudyScale;
use super::{Lengths, StudyModel, study_models};
use crate::MAX_TRAJECTORIES;
use crate::merge::merge;

/// Number of samples that a model is given, and number of samples that it predicts.
pub(super) const CONTEXT: u32 = 320;
pub(super) const HORIZON: u32 = 80;

/// The largest number of seeds of a set.
const SEEDS_OF_A_SET: u64 = 100;

/// Number of seeds of a training for another length.
const SEEDS_OF_A_LENGTH: u64 = 3;

pub(super) fn all(scale: StudyScale) -> Vec<StudyTraining> {
    let mut trainings = Vec::new();
    for set in 1..=scale.sets() {
        for model in study_models().iter().filter(|model| set <= model.sets) {
            for seed in 1..=model.seeds.min(scale.seeds()) {
                trainings.push(training(scale, model, set, seed, None));
            }
        }
    }
    for length in lengths(scale) {
        for model in study_models().iter().filter(|model| model.lengths == Lengths::Trained) {
            for seed in 1..=SEEDS_OF_A_LENGTH {
                trainings.push(training(scale, model, 1, seed, Some(length)));
            }
        }
    }
    trainings
}

/// Contexts and horizons besides the usual ones.
pub(super) fn lengths(scale: StudyScale) -> Vec<(u32, u32)> {
    let contexts = scale.contexts().iter().map(|&context| (context, HORIZON));
    contexts.chain(scale.horizons().iter().map(|&horizon| (CONTEXT, horizon))).collect()
}

/// The prefix of a name: `d1`, or `context-20` for another length, which is examined on D1.
pub(super) fn prefix(set: usize, length: Option<(u32, u32)>) -> String {
    match length {
        None => format!("d{set}"),
        Some((CONTEXT, horizon)) => format!("horizon-{horizon}"),
        Some((context, _)) => format!("context-{context}"),
    }
}

fn training(
    scale: StudyScale,
    model: &StudyModel,
    set: usize,
    seed: u64,
    length: Option<(u32, u32)>,
) -> StudyTraining {
    let (context, horizon) = length.unwrap_or((CONTEXT, HORIZON));
    let steps = scale.steps() * model.steps;
    let mut spec = json!({
        "kind": "train",
        "data": {"stream": {
            "preset": format!("D{set}-mixed"),
            "trajectories": MAX_TRAJECTORIES,
            "samples": context + horizon,
            "seed": SEEDS_OF_A_SET * set as u64 + seed,
        }},
        "model": {"preset": model.presets[scale.index()]},
        "context": context,
        "normalization": "dataset",
        "optimizer": optimizer(scale),
        "batch_size": scale.pick([32, 32, 64]),
        "steps": steps,
        "seed": seed,
        "checkpoint_every_steps": null,
        "sampled_trajectories": 64,
        "validate_every_steps": steps / 2,
    });
    let own = scale.pick([&model.training, &model.training, &model.paper]);
    // The learned law is trained in the same way at every scale.
    let own = if own.is_empty() { &model.training } else { own };
    merge(&mut spec, Value::Object(own.clone()));
    if model.denoiser {
        // At the paper's size as in the paper. At other sizes few steps, which the warm start
        // compares with all of them.
        let sampler = scale.pick([("ddim", 10), ("ddim", 10), ("ddpm", 100)]);
        spec["model"]["sampler"] = json!({"kind": sampler.0, "steps": sampler.1});
    }
    merge(&mut spec["model"], Value::Object(model.model.clone()));
    StudyTraining {
        job: format!("{}-{}-{seed}", prefix(set, length), model.name),
        model: model.name.clone(),
        set,
        seed,
        length,
        spec,
    }
}

fn optimizer(scale: StudyScale) -> Value {
    match scale {
        StudyScale::Tiny | StudyScale::Small => json!({
            "gradient_clip_norm": 1.0, "learning_rate": 0.002, "warmup_steps": scale.steps() / 10,
        }),
        StudyScale::Paper => json!({"learning_rate": 1e-4}),
    }
}
