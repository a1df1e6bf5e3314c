//! After a short training, models predict better than holding the last position does.

use models::ValidationPart;
use serde_json::json;
use series::Series;
use spec::{DiffuserSpec, Known, ModelSpec, Normalization, TrainSpec};

use super::{CONTEXT_VALUES, HORIZON_VALUES, ROW, briefly_trained, known, train, trainer};
use crate::synthetic::{JOINTS, batch, every_kind, training_of};

/// The error of `ValidationReport::rmse_rad` for holding the last position of the context.
fn hold_last_rmse(batch: &Series) -> f64 {
    let mut total = 0.0;
    for y in batch.y().chunks_exact(ROW) {
        let (context, horizon) = y.split_at(CONTEXT_VALUES);
        let last = &context[CONTEXT_VALUES - JOINTS..];
        for (joint, last) in last.iter().enumerate() {
            let errors = horizon.iter().skip(joint).step_by(JOINTS);
            let squares: f32 = errors.map(|value| (value - last).powi(2)).sum();
            total += f64::from(squares / (HORIZON_VALUES / JOINTS) as f32).sqrt();
        }
    }
    total / (batch.robots() * JOINTS) as f64
}

/// Checks that the validation error of every model of `architecture` falls below this share of that
/// of holding the last position.
#[track_caller]
fn check_learning(architecture: &str) {
    let held_out = batch(1_000_000, 32);
    let hold_last = hold_last_rmse(&held_out);
    for (name, model) in every_kind() {
        if model.architecture() != architecture {
            continue;
        }
        let share = match &model {
            // It learns more slowly, since it also models the noise of u.
            ModelSpec::Diffuser(DiffuserSpec { known: Known::JointNoise, .. }) => 1.0,
            _ => 0.6,
        };
        let mut spec = TrainSpec { steps: 600, ..training_of(model) };
        spec.optimizer.learning_rate = 5e-3;
        let mut trainer = trainer(&spec);
        train(&mut trainer, 0..600);
        let report = trainer.validate(&ValidationPart::whole(&held_out)).unwrap();
        println!("{name}: {:.4} rad, held {hold_last:.4} rad", report.rmse_rad());
        assert!(report.rmse_rad() < share * hold_last, "{name}: {report:?}, hold-last {hold_last}");
    }
}

macro_rules! every_architecture_learns {
    ($($name:ident($spec:ident) = $label:tt,)*) => {
        /// Makes a test for each architecture.
        #[allow(non_snake_case, reason = "they are called as in `spec::architectures`")]
        mod learns {
            $(#[test]
            fn $name() {
                super::check_learning($label);
            })*
        }
    };
}

spec::architectures!(every_architecture_learns);

fn normalized_kinds() -> impl Iterator<Item = (String, ModelSpec)> {
    every_kind().into_iter().filter(|(_, model)| !model.is_physical())
}

#[test]
fn a_residual_of_the_exact_integrator_starts_at_its_prediction() {
    // Untrained weights predict small multiples of the residual's scale, which is near zero here.
    let mut exact = batch(64, 4);
    let u = exact.u().to_vec();
    for (u, y) in u.chunks_exact(ROW).zip(exact.y_mut().chunks_exact_mut(ROW)) {
        for i in JOINTS..ROW {
            y[i] = y[i - JOINTS] + u[i - JOINTS] / 10.0 / 60.0;
        }
    }
    for (name, model) in normalized_kinds() {
        let mut spec = serde_json::to_value(model).unwrap();
        spec["residual"] = json!("integrator");
        let model = briefly_trained(serde_json::from_value(spec).unwrap());
        let answer = model.predict(&known(&exact)).unwrap();
        for (answer, truth) in answer.chunks(HORIZON_VALUES).zip(exact.y().chunks(ROW)) {
            for (a, b) in answer.iter().zip(&truth[CONTEXT_VALUES..]) {
                assert!((a - b).abs() < 0.02, "{name}: {a} {b}");
            }
        }
    }
}

#[test]
fn over_a_lagged_integrator_any_weights_go_on_where_the_arm_is() {
    // A mass behind a damping of 10. The network has seen none.
    let mut lagged = batch(64, 4);
    let u = lagged.u().to_vec();
    for (u, y) in u.chunks_exact(ROW).zip(lagged.y_mut().chunks_exact_mut(ROW)) {
        for joint in 0..JOINTS {
            let mut step = 0.0;
            for i in (JOINTS..ROW).skip(joint).step_by(JOINTS) {
                step += 0.4 * (u[i - JOINTS] / 10.0 / 60.0 - step);
                y[i] = y[i - JOINTS] + step;
            }
        }
    }
    for (name, model) in normalized_kinds() {
        let mut spec = serde_json::to_value(model).unwrap();
        spec["residual"] = json!("lagged-integrator");
        let model = briefly_trained(serde_json::from_value(spec).unwrap());
        let answer = model.predict(&known(&lagged)).unwrap();
        for (answer, truth) in answer.chunks(HORIZON_VALUES).zip(lagged.y().chunks(ROW)) {
            let first = answer.iter().zip(&truth[CONTEXT_VALUES..]).take(JOINTS);
            for (a, b) in first {
                assert!((a - b).abs() < 1e-3, "{name}: {a} {b}");
            }
        }
    }
}

#[test]
fn all_normalizations_train_every_architecture() {
    for (name, model) in normalized_kinds() {
        let spec = TrainSpec { normalization: Normalization::PaperLeaky, ..training_of(model) };
        let report = trainer(&spec).step(&batch(0, 8)).unwrap();
        assert!(report.loss.is_finite(), "{name}");
    }
}
