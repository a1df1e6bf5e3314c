//! The evaluations of the study.

use serde_json::{Value, json};

use super::super::plan::{StudyEvaluation, StudyQuestion, StudyTraining, checkpoints};
use super::super::scale::StudyScale;
use super::trainings::{CONTEXT, HORIZON, lengths, prefix};
use super::{Lengths, StudyModel, study_models};

/// Seed of the robots in evaluations, beyond all seeds of trainings.
const SEED: u64 = 1_000_000;

/// Number of windows before the scored one of a warm start.
const ROUNDS: u32 = 4;

/// Factor of the torques over those of the trainings, in cells with larger torques.
const LARGER: f64 = 2.0;

pub(super) fn all(scale: StudyScale, trainings: &[StudyTraining]) -> Vec<StudyEvaluation> {
    let mut evaluations = Vec::new();
    for set in 1..=scale.sets() {
        evaluations.push(sweep(scale, set, trainings));
        evaluations.push(amplitude(scale, set, trainings));
        evaluations.push(samples(scale, set, trainings));
    }
    evaluations.push(length(scale, (CONTEXT, HORIZON), trainings));
    for lengths in lengths(scale) {
        evaluations.push(length(scale, lengths, trainings));
    }
    evaluations.push(warm_start(scale, trainings));
    evaluations
}

/// The trainings of the `wanted` models on a set, with 320 and 80 samples.
fn of_set(
    trainings: &[StudyTraining],
    set: usize,
    wanted: impl Fn(&StudyModel) -> bool,
) -> impl Iterator<Item = &StudyTraining> {
    let names: Vec<&str> = study_models()
        .iter()
        .filter(|model| wanted(model))
        .map(|model| model.name.as_str())
        .collect();
    trainings.iter().filter(move |training| {
        training.set == set && training.length.is_none() && names.contains(&training.model.as_str())
    })
}

/// The robots of evaluation `question` of a set. Each evaluation has robots of its own.
fn stream(excitation: &Value, cells: usize, robots: u64, samples: u32, seed: u64) -> Value {
    json!({"stream": {
        "trajectories": cells as u64 * robots,
        "samples": samples,
        "seed": SEED + seed,
        "excitation": excitation,
    }})
}

fn sweep(scale: StudyScale, set: usize, trainings: &[StudyTraining]) -> StudyEvaluation {
    const CHIRP: [f64; 10] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
    const MULTISINE: [f64; 11] = [0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5];
    const STEPS: [f64; 3] = [0.1, 0.3, 0.6];
    const FEW: ([f64; 4], [f64; 4], [f64; 1]) =
        ([0.1, 0.3, 0.5, 1.0], [0.05, 0.15, 0.25, 0.45], [0.3]);
    let (chirp, multisine, steps): (&[f64], &[f64], &[f64]) = match scale {
        StudyScale::Tiny => (&FEW.0, &FEW.1, &FEW.2),
        StudyScale::Small | StudyScale::Paper => (&CHIRP, &MULTISINE, &STEPS),
    };
    let excitation = json!({
        "chirp": {"frequency_hz": {"grid": chirp}},
        "multisine": {"frequency_hz": {"grid": multisine}},
        "steps": {"frequency_hz": {"grid": steps}},
    });
    let cells = chirp.len() + multisine.len() + steps.len();
    let spec = json!({
        "kind": "evaluate",
        "data": stream(&excitation, cells, scale.robots(), CONTEXT + HORIZON, set as u64),
        "checkpoints": checkpoints(of_set(trainings, set, |_| true)),
        "latency": {"repeats": scale.pick([20, 50, 200])},
    });
    let question = StudyQuestion::Sweep;
    StudyEvaluation { job: format!("d{set}-sweep"), question, set, spec }
}

fn amplitude(scale: StudyScale, set: usize, trainings: &[StudyTraining]) -> StudyEvaluation {
    // Frequencies that the set draws: its ends and its middle.
    const CHIRP: [&[f64]; 4] = [&[0.3], &[0.2, 0.3, 0.4], &[0.2, 0.4, 0.6], &[0.1, 0.4, 0.7]];
    const MULTISINE: [&[f64]; 4] =
        [&[0.15], &[0.05, 0.1, 0.15], &[0.05, 0.15, 0.25], &[0.01, 0.15, 0.3]];
    let (chirp, multisine) = (CHIRP[set - 1], MULTISINE[set - 1]);
    let larger = |nominal: f64| [-LARGER * nominal, LARGER * nominal];
    let excitation = json!({
        "chirp": {"frequency_hz": {"grid": chirp}, "amplitude_nm": larger(4.0)},
        "multisine": {"frequency_hz": {"grid": multisine}, "amplitude_nm_per_hz": larger(30.0)},
    });
    let cells = chirp.len() + multisine.len();
    let spec = json!({
        "kind": "evaluate",
        "data": stream(&excitation, cells, scale.robots(), CONTEXT + HORIZON, 100 + set as u64),
        "checkpoints": checkpoints(of_set(trainings, set, |_| true)),
    });
    let question = StudyQuestion::Amplitude;
    StudyEvaluation { job: format!("d{set}-amplitude"), question, set, spec }
}

/// Two cells that every set has seen, and two above the bands of all sets except D4.
fn four_cells() -> Value {
    json!({
        "chirp": {"frequency_hz": {"grid": [0.3, 1.0]}},
        "multisine": {"frequency_hz": {"grid": [0.15, 0.3]}},
    })
}

fn samples(scale: StudyScale, set: usize, trainings: &[StudyTraining]) -> StudyEvaluation {
    let robots = scale.sampled_robots();
    let spec = json!({
        "kind": "evaluate",
        "data": stream(&four_cells(), 4, robots, CONTEXT + HORIZON, 200 + set as u64),
        "samples": 32,
        "checkpoints": checkpoints(of_set(trainings, set, |model| model.samples)),
        "baselines": ["damped-integrator"],
    });
    let question = StudyQuestion::Samples;
    StudyEvaluation { job: format!("d{set}-samples"), question, set, spec }
}

/// An evaluation at one length. The robots are the same for all lengths, except those whose longer
/// motions come too close to their limits.
fn length(
    scale: StudyScale,
    (context, horizon): (u32, u32),
    trainings: &[StudyTraining],
) -> StudyEvaluation {
    let set = 1;
    let usual = (context, horizon) == (CONTEXT, HORIZON);
    let of_length = of_set(trainings, set, |model| {
        model.lengths == Lengths::Any || usual && model.lengths == Lengths::Trained
    });
    let trained = trainings.iter().filter(|training| training.length == Some((context, horizon)));
    let spec = json!({
        "kind": "evaluate",
        "data": stream(&four_cells(), 4, scale.robots(), context + horizon, 300),
        "context": context,
        "checkpoints": checkpoints(of_length.chain(trained)),
        "baselines": [
            "damped-integrator", "fitted-damping", "arx", "nominal-simulator", "simulator-fitted-damping",
        ],
    });
    let prefix =
        if usual { format!("context-{context}") } else { prefix(set, Some((context, horizon))) };
    let question = StudyQuestion::Lengths { context, horizon };
    StudyEvaluation { job: format!("{prefix}-lengths"), question, set, spec }
}

/// One training of each denoiser on D1, with every start and with fewer steps.
fn warm_start(scale: StudyScale, trainings: &[StudyTraining]) -> StudyEvaluation {
    let set = 1;
    let steps: &[u32] =
        scale.pick([&[1, 5, 100], &[1, 2, 5, 10, 20, 100], &[1, 2, 5, 10, 20, 100]]);
    let ways = ["cold", "shifted", "oracle"]
        .map(|start| json!({"kind": "ddpm", "steps": steps, "start": start}));
    let first =
        of_set(trainings, set, |model| model.denoiser).filter(|training| training.seed == 1);
    let robots = scale.sampled_robots();
    let spec = json!({
        "kind": "evaluate",
        "data": stream(&four_cells(), 4, robots, CONTEXT + HORIZON + ROUNDS, 400),
        "checkpoints": checkpoints(first),
        "baselines": ["damped-integrator"],
        "samplers": ways,
        "latency": {"repeats": scale.pick([20, 100, 1000])},
        "rounds": ROUNDS,
    });
    let question = StudyQuestion::WarmStart;
    StudyEvaluation { job: "warm-start".to_owned(), question, set, spec }
}
