//! Damaged, foreign and newer checkpoints end in an error that says so.

use models::{CheckpointFiles, Device, ModelError, TrainedModel, Trainer};
use proptest::prelude::*;
use serde_json::{Value, json};

use crate::synthetic::{DATA, batch, kind, train_spec};

fn files() -> CheckpointFiles {
    let mut trainer = Trainer::new(&train_spec(), DATA, "digest", &Device::cpu()).unwrap();
    trainer.step(&batch(0, 8)).unwrap();
    trainer.checkpoint().unwrap()
}

fn load(files: &CheckpointFiles) -> Result<TrainedModel, ModelError> {
    TrainedModel::from_files(files, &Device::cpu())
}

fn resume(files: &CheckpointFiles) -> Result<Trainer, ModelError> {
    Trainer::resume(&train_spec(), DATA, "digest", files, &Device::cpu())
}

fn with_config(files: &CheckpointFiles, change: impl FnOnce(&mut Value)) -> CheckpointFiles {
    let mut config: Value = serde_json::from_slice(&files.config).unwrap();
    change(&mut config);
    CheckpointFiles { config: serde_json::to_vec(&config).unwrap(), ..files.clone() }
}

#[track_caller]
fn check_refused(files: &CheckpointFiles, message: &str) {
    let error = load(files).unwrap_err().to_string();
    assert!(error.contains(message), "{error}");
}

#[test]
fn what_was_saved_is_what_is_loaded() {
    let files = files();
    let model = load(&files).unwrap();
    assert_eq!((model.context(), model.horizon(), model.samples()), (16, 8, 24));
    assert_eq!(model.rate_hz(), 60.0);
    assert_eq!(*model.architecture(), train_spec().model);
    assert_eq!(model.config().step, 1);
    assert_eq!(model.config().spec_digest, "digest");
}

#[test]
fn the_config_counts_the_parameters_that_are_there() {
    let files = files();
    let parsed = safetensors::SafeTensors::deserialize(&files.model).unwrap();
    let values: usize = parsed.iter().map(|(_, view)| view.data().len() / 4).sum();
    assert_eq!(load(&files).unwrap().config().parameters, values as u64);
}

#[test]
fn names_and_layouts_are_those_of_torch_nn() {
    let files = files();
    let parsed = safetensors::SafeTensors::deserialize(&files.model).unwrap();
    let shape = |name: &str| parsed.tensor(name).unwrap().shape().to_vec();
    assert_eq!(shape("encoder_input.weight"), [8, 4 * 14]);
    assert_eq!(shape("encoder_blocks.0.attention.query.weight"), [8, 8]);
    assert_eq!(shape("decoder_blocks.0.feed_forward.expand.weight"), [16, 8]);
    assert_eq!(shape("decoder_norm.bias"), [8]);
    assert_eq!(shape("decoder_positions"), [2, 8]);
}

#[test]
fn a_newer_format_is_named_as_such() {
    let newer = with_config(&files(), |config| {
        config["format_version"] = json!(3);
        config["something_new"] = json!(true);
    });
    check_refused(&newer, "format version 3, this program reads 2");
}

#[test]
fn sizes_that_the_weights_cannot_hold_are_refused_before_they_are_allocated() {
    let huge = |parameters: u64| {
        with_config(&files(), |config| {
            config["model"]["d_model"] = json!(16_000);
            config["model"]["encoder_layers"] = json!(256);
            config["parameters"] = json!(parameters);
        })
    };
    let message = load(&huge(1)).unwrap_err().to_string();
    let (_, expected) = message.rsplit_once("expected ").unwrap();
    let (parameters, _) = expected.split_once(' ').unwrap();
    check_refused(&huge(parameters.parse().unwrap()), "too few for the");
}

#[test]
fn impossible_sizes_are_refused() {
    let files = files();
    for (field, value, message) in [
        ("d_model", json!(0), "d_model"),
        ("d_model", json!(4_294_967_295_u32), "d_model"),
        ("heads", json!(0), "heads"),
        ("heads", json!(3), "heads"),
        ("patch", json!(0), "patch"),
        ("patch", json!(3), "patch"),
        ("encoder_layers", json!(4_000_000_000_u32), "encoder_layers"),
        ("mlp_ratio", json!(0), "mlp_ratio"),
        ("d_model", json!(-1), "config.json"),
        ("d_model", json!("8"), "config.json"),
    ] {
        check_refused(&with_config(&files, |config| config["model"][field] = value), message);
    }
    check_refused(&with_config(&files, |config| config["context"] = json!(0)), "context");
    check_refused(&with_config(&files, |config| config["context"] = json!(24)), "context");
    check_refused(&with_config(&files, |config| config["horizon"] = json!(9)), "horizon");
    check_refused(&with_config(&files, |config| config["rate_hz"] = json!(0.0)), "rate_hz");
    check_refused(
        &with_config(&files, |config| config["model"]["architecture"] = json!("lstm")),
        "config.json",
    );
    check_refused(&with_config(&files, |config| config["surplus"] = json!(1)), "surplus");
}

/// The files of an untrained Diffuser.
fn diffuser_files() -> CheckpointFiles {
    let spec = spec::TrainSpec { model: kind("diffuser"), ..train_spec() };
    Trainer::new(&spec, DATA, "digest", &Device::cpu()).unwrap().checkpoint().unwrap()
}

#[test]
fn sizes_of_a_u_net_that_do_not_divide_are_refused_with_both_numbers() {
    let files = diffuser_files();
    for (field, value, messages) in [
        ("width", json!(12), ["width is 12", "multiples of 8"]),
        ("width", json!(0), ["width is 0", "8 to"]),
        ("multipliers", json!([]), ["multipliers is 0", "1 to 8 stages"]),
        ("multipliers", json!([1, 2, 2, 2, 2]), ["stages is 16", "which is 24"]),
        ("multipliers", json!([1, 4_000_000_000_u32]), ["multipliers is 4000000000", "1 to 64"]),
    ] {
        let wrong = with_config(&files, |config| config["model"][field] = value);
        for message in messages {
            check_refused(&wrong, message);
        }
    }
}

#[test]
fn noise_that_cannot_be_is_refused() {
    let files = diffuser_files();
    for (part, field, value, message) in [
        ("diffusion", "steps", json!(0), "diffusion.steps is 0"),
        ("diffusion", "steps", json!(4_000_000_000_u32), "diffusion.steps is 4000000000"),
        ("diffusion", "clip", json!(-1.0), "diffusion.clip is -1"),
        ("sampler", "steps", json!(21), "sampler.steps is 21, allowed: at most diffusion.steps"),
        ("sampler", "eta", json!(2.0), "sampler.eta is 2"),
        ("sampler", "kind", json!("euler"), "sampler.kind is euler, allowed: ddpm, ddim"),
    ] {
        check_refused(&with_config(&files, |config| config["model"][part][field] = value), message);
    }
    let residual = json!({"integrator": {"damping": 0.0}});
    check_refused(
        &with_config(&files, |config| config["model"]["residual"] = residual),
        "residual.integrator.damping is 0",
    );
}

#[test]
fn a_training_with_averaged_weights_needs_both_kinds_of_weights() {
    let spec = spec::TrainSpec { ema: Some(spec::EmaSpec::default()), ..train_spec() };
    let device = Device::cpu();
    let mut trainer = Trainer::new(&spec, DATA, "digest", &device).unwrap();
    trainer.step(&batch(0, 8)).unwrap();
    let averaged = trainer.checkpoint().unwrap();
    let plain = files();
    let resume = |optimizer: &[u8]| {
        let files = CheckpointFiles { optimizer: optimizer.to_vec(), ..averaged.clone() };
        Trainer::resume(&spec, DATA, "digest", &files, &device).err().unwrap().to_string()
    };
    let error = resume(&plain.optimizer);
    assert!(error.contains("optimizer.safetensors") && error.contains("is missing"), "{error}");

    let error = resume_error(&CheckpointFiles { optimizer: averaged.optimizer.clone(), ..plain });
    assert!(error.contains("averaged weights"), "{error}");
}

fn resume_error(files: &CheckpointFiles) -> String {
    resume(files).err().unwrap().to_string()
}

#[test]
fn moments_that_no_optimizer_has_are_refused() {
    let files = files();
    let negative = rewrite(&files.optimizer, |name, shape, mut bytes| {
        if name == "exp_avg_sq.head.bias" {
            bytes[..4].copy_from_slice(&(-1.0_f32).to_le_bytes());
        }
        (name, shape, bytes)
    });
    let error = resume_error(&CheckpointFiles { optimizer: negative, ..files });
    assert!(error.contains("`exp_avg_sq.head.bias` has a value below 0"), "{error}");
}

#[test]
fn weights_of_another_type_are_refused_by_name() {
    let files = files();
    let parsed = safetensors::SafeTensors::deserialize(&files.model).unwrap();
    let halves: Vec<_> = parsed
        .iter()
        .map(|(name, view)| {
            (name, view.shape().to_vec(), view.data()[..view.data().len() / 2].to_vec())
        })
        .collect();
    let views = halves.iter().map(|(name, shape, bytes)| {
        let dtype = safetensors::Dtype::F16;
        (*name, safetensors::tensor::TensorView::new(dtype, shape.clone(), bytes).unwrap())
    });
    let mut model = safetensors::serialize(views, None).unwrap();
    // The file gets the length of float32, so that only the type is wrong.
    let message = load(&CheckpointFiles { model: model.clone(), ..files.clone() });
    assert!(message.is_err());
    model.resize(files.model.len(), 0);
    assert!(load(&CheckpointFiles { model, ..files }).is_err());
}

#[test]
fn a_format_before_the_first_is_refused() {
    let files = files();
    check_refused(
        &with_config(&files, |config| config["format_version"] = json!(1)),
        "format_version 1, the first that was released is 2",
    );
    check_refused(
        &with_config(&files, |config| config["format_version"] = json!("2")),
        "no format_version",
    );
}

#[test]
fn the_config_says_how_the_training_stands() {
    let mut trainer = Trainer::new(&train_spec(), DATA, "digest", &Device::cpu()).unwrap();
    let report = trainer.step(&batch(0, 8)).unwrap();
    trainer.note("validation/rmse_deg", 1.25);
    trainer.note("validation/loss", f64::NAN);
    let model = load(&trainer.checkpoint().unwrap()).unwrap();
    let metrics = &model.config().metrics;
    assert_eq!(metrics["train/loss"], report.loss);
    assert_eq!(metrics["validation/rmse_deg"], 1.25);
    assert_eq!(metrics.len(), 2, "{metrics:?}");

    // The next step has other weights, so what was measured before is not true of them.
    let report = trainer.step(&batch(8, 8)).unwrap();
    let model = load(&trainer.checkpoint().unwrap()).unwrap();
    let metrics = &model.config().metrics;
    assert_eq!((metrics["train/loss"], metrics.len()), (report.loss, 1));
}

#[test]
fn statistics_that_would_divide_by_zero_are_refused() {
    let unusable = with_config(&files(), |config| {
        let seven = |value: f64| vec![value; 7];
        config["normalizer"] = json!({"dataset": {
            "u_mean": seven(0.0), "u_std": seven(1.0), "y_mean": seven(0.0), "y_std": seven(0.0),
        }});
    });
    check_refused(&unusable, "deviation");
}

#[test]
fn weights_of_another_model_are_refused_by_name() {
    let files = files();
    let other = with_config(&files, |config| {
        config["model"]["patch"] = json!(2);
        config["parameters"] = json!(1_000);
    });
    check_refused(&other, "parameters");

    let renamed = rewrite(&files.model, |name, shape, bytes| {
        (name.replace("head.bias", "tail.bias"), shape, bytes)
    });
    check_refused(
        &CheckpointFiles { model: renamed, ..files.clone() },
        "tensor `head.bias` is missing",
    );

    let reshaped = rewrite(&files.model, |name, shape, bytes| {
        let shape = if name == "head.weight" { vec![8, 28] } else { shape };
        (name, shape, bytes)
    });
    check_refused(
        &CheckpointFiles { model: reshaped, ..files },
        "tensor `head.weight` has shape [8, 28], expected [28, 8]",
    );
}

#[test]
fn a_weight_that_is_not_a_number_is_refused_by_name() {
    let files = files();
    let poisoned = rewrite(&files.model, |name, shape, mut bytes| {
        if name == "encoder_norm.bias" {
            bytes[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
        }
        (name, shape, bytes)
    });
    check_refused(
        &CheckpointFiles { model: poisoned, ..files },
        "tensor `encoder_norm.bias` has NaN",
    );
}

#[test]
fn optimizer_state_that_is_missing_or_foreign_is_refused() {
    let files = files();
    let weights = CheckpointFiles { optimizer: files.model.clone(), ..files.clone() };
    let error = resume(&weights).err().unwrap().to_string();
    assert!(error.contains("optimizer.safetensors") && error.contains("not a moment"), "{error}");

    let renamed = rewrite(&files.optimizer, |name, shape, bytes| {
        (name.replace("exp_avg_sq.head.bias", "exp_avg_sq.tail"), shape, bytes)
    });
    let error = resume(&CheckpointFiles { optimizer: renamed, ..files }).err().unwrap().to_string();
    assert!(error.contains("exp_avg_sq") && error.contains("`head.bias` is missing"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..Default::default() })]

    /// Cutting a file short or changing one byte must not cause a panic. A changed file may load if
    /// the byte was part of a weight.
    #[test]
    fn damaged_files_never_panic(file in 0..3, cut in any::<bool>(), at in any::<prop::sample::Index>(), byte in any::<u8>()) {
        let mut files = files();
        let bytes = match file {
            0 => &mut files.model,
            1 => &mut files.optimizer,
            _ => &mut files.config,
        };
        let at = at.index(bytes.len());
        if cut { bytes.truncate(at) } else { bytes[at] = byte }
        let loaded = load(&files);
        let resumed = resume(&files);
        if cut && file == 0 {
            prop_assert!(loaded.is_err() && resumed.is_err());
        }
        if cut && file == 1 {
            prop_assert!(resumed.is_err());
        }
    }
}

/// The safetensors file with each tensor's name, shape and bytes changed.
fn rewrite(
    bytes: &[u8],
    change: impl Fn(String, Vec<usize>, Vec<u8>) -> (String, Vec<usize>, Vec<u8>),
) -> Vec<u8> {
    let parsed = safetensors::SafeTensors::deserialize(bytes).unwrap();
    let tensors: Vec<_> = parsed
        .iter()
        .map(|(name, view)| change(name.to_owned(), view.shape().to_vec(), view.data().to_vec()))
        .collect();
    let views = tensors.iter().map(|(name, shape, bytes)| {
        let dtype = safetensors::Dtype::F32;
        let view = safetensors::tensor::TensorView::new(dtype, shape.clone(), bytes).unwrap();
        (name.as_str(), view)
    });
    safetensors::serialize(views, None).unwrap()
}
