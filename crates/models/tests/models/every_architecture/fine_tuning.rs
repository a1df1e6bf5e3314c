//! A training may begin with the weights of another one, and keep some of them.

use std::collections::{BTreeMap, BTreeSet};

use models::{
    CheckpointConfig, CheckpointFiles, DataRanges, Device, InitialCheckpoint, ModelError, Origin,
    TrainedModel, Trainer, TrainingData,
};
use safetensors::SafeTensors;
use serde_json::json;
use spec::{EmaSpec, Normalization, TrainSpec};

use super::{known, train, trainer};
use crate::synthetic::{DATA, batch, every_kind, train_spec, training_of};

/// A checkpoint with averaged weights, after 4 steps.
fn earlier(spec: &TrainSpec) -> CheckpointFiles {
    let mut trainer =
        trainer(&TrainSpec { ema: Some(EmaSpec::default()), seed: 3, ..spec.clone() });
    train(&mut trainer, 100..104);
    trainer.checkpoint().unwrap()
}

fn fine_tuner(spec: &TrainSpec, init: &CheckpointFiles) -> Result<Trainer, ModelError> {
    let CheckpointFiles { model, config, .. } = init.clone();
    Trainer::fine_tune(spec, DATA, "digest", &InitialCheckpoint { model, config }, &Device::cpu())
}

fn config(files: &CheckpointFiles) -> CheckpointConfig {
    CheckpointConfig::parse(&files.config).unwrap()
}

/// The bytes of each parameter.
fn parameters(files: &CheckpointFiles) -> BTreeMap<String, Vec<u8>> {
    let tensors = SafeTensors::deserialize(&files.model).unwrap();
    tensors.iter().map(|(name, tensor)| (name.to_owned(), tensor.data().to_vec())).collect()
}

#[test]
fn a_fine_tuning_begins_with_the_weights_that_predict_and_extends_the_ranges() {
    for (name, model) in every_kind() {
        let spec = training_of(model);
        let init = earlier(&spec);
        let mut tuner = fine_tuner(&spec, &init).unwrap();
        let begun = tuner.checkpoint().unwrap();
        assert!(begun.model == init.model, "{name}");
        let answer = |files: &CheckpointFiles| {
            let model = TrainedModel::from_files(files, &Device::cpu()).unwrap();
            model.predict(&known(&batch(9, 4))).unwrap()
        };
        assert_eq!(answer(&begun), answer(&init), "{name}");
        train(&mut tuner, 0..2);
        let tuned = tuner.checkpoint().unwrap();
        assert!(tuned.model != init.model, "{name}");

        let found = config(&tuned);
        assert_eq!((found.step, found.spec_digest.as_str()), (2, "digest"), "{name}");
        assert_eq!(found.init, Some(Origin { spec_digest: "digest".to_owned(), step: 4 }));
        let seen = (0..2).chain(100..104).filter_map(|step| DataRanges::of(&batch(step, 8).view()));
        assert_eq!(found.ranges, seen.reduce(DataRanges::and), "{name}");
    }
}

#[test]
fn a_resumed_fine_tuning_equals_an_uninterrupted_one_bit_for_bit() {
    for (name, model) in every_kind() {
        let weights = parameters(&earlier(&training_of(model.clone())));
        let has = |part: &&&str| weights.keys().any(|name| name.split('.').next() == Some(part));
        let first = (*model.parts().iter().find(has).unwrap()).to_owned();
        for frozen in [vec![], vec![first]] {
            let spec =
                TrainSpec { ema: Some(EmaSpec::default()), frozen, ..training_of(model.clone()) };
            let init = earlier(&spec);
            let mut uninterrupted = fine_tuner(&spec, &init).unwrap();
            train(&mut uninterrupted, 0..5);
            for stopped in [0, 2] {
                let mut interrupted = fine_tuner(&spec, &init).unwrap();
                train(&mut interrupted, 0..stopped);
                let files = interrupted.checkpoint().unwrap();
                let mut resumed =
                    Trainer::resume(&spec, DATA, "digest", &files, &Device::cpu()).unwrap();
                assert!(resumed.checkpoint().unwrap() == files, "{name}, {stopped}");
                train(&mut resumed, stopped..5);
                let equal = resumed.checkpoint().unwrap() == uninterrupted.checkpoint().unwrap();
                assert!(equal, "{name}, {stopped}, {:?}", spec.frozen);
            }
        }
    }
}

#[test]
fn frozen_parts_keep_their_weights_and_all_others_are_trained() {
    for (name, model) in every_kind() {
        let parts = model.parts();
        for part in parts {
            let spec = TrainSpec { frozen: vec![(*part).to_owned()], ..training_of(model.clone()) };
            let init = earlier(&spec);
            let before = parameters(&init);
            let inside = |name: &str| name.split('.').next() == Some(part);
            let mut tuner = match fine_tuner(&spec, &init) {
                Ok(tuner) => tuner,
                Err(error) => {
                    // Some options of a model have no such part.
                    assert!(!before.keys().any(|name| inside(name)), "{name}, {part}: {error}");
                    assert!(error.to_string().contains("frozen[0]"), "{error}");
                    continue;
                }
            };
            train(&mut tuner, 0..2);
            let after = parameters(&tuner.checkpoint().unwrap());
            let mut trained = fine_tuner(&training_of(model.clone()), &init).unwrap();
            train(&mut trained, 0..2);
            let unfrozen = parameters(&trained.checkpoint().unwrap());
            for (parameter, values) in &before {
                // Some parameters have no gradient, whether frozen or not.
                let is_trained = unfrozen[parameter] != *values && !inside(parameter);
                assert_eq!(after[parameter] != *values, is_trained, "{name}: {parameter}, {part}");
            }
        }
    }
}

#[test]
fn the_parts_of_a_model_are_the_first_words_of_its_parameters() {
    let mut listed: BTreeMap<&str, (BTreeSet<&str>, BTreeSet<String>)> = BTreeMap::new();
    let plain = every_kind().into_iter().map(|(_, model)| (training_of(model), DATA));
    // A chain needs a longer context than other models.
    let chain = json!({"architecture": "lagrangian", "chain": {}});
    let chain = training_of(serde_json::from_value(chain).unwrap());
    let longer = TrainingData { samples: 60, ..DATA };
    for (spec, data) in plain.chain([(TrainSpec { context: 40, ..chain }, longer)]) {
        let trainer = Trainer::new(&spec, data, "digest", &Device::cpu()).unwrap();
        let files = trainer.checkpoint().unwrap();
        let (parts, found) = listed.entry(spec.model.architecture()).or_default();
        parts.extend(spec.model.parts());
        found.extend(
            parameters(&files)
                .keys()
                .map(|name| name.split('.').next().unwrap_or_default().to_owned()),
        );
    }
    for (architecture, (parts, found)) in listed {
        let found: BTreeSet<&str> = found.iter().map(String::as_str).collect();
        assert_eq!(parts, found, "{architecture}");
    }
}

#[test]
fn statistics_of_the_data_stay_those_that_the_weights_were_trained_with() {
    let mut statistics = models::StatisticsAccumulator::new(DATA.joints);
    statistics.add(&batch(100, 8).view());
    let fixed = TrainingData { statistics: Some(statistics.finish()), ..DATA };
    let spec = TrainSpec { normalization: Normalization::Dataset, ..train_spec() };
    let earlier = Trainer::new(&spec, fixed, "earlier", &Device::cpu()).unwrap();
    let init = earlier.checkpoint().unwrap();
    let tuned = fine_tuner(&spec, &init).unwrap().checkpoint().unwrap();
    assert_eq!(config(&tuned).normalizer, config(&init).normalizer);
    let error = fine_tuner(&train_spec(), &init).err().unwrap().to_string();
    let expected = "written by a training with normalization dataset, this one has context";
    assert!(error.contains(expected), "{error}");
}

#[test]
fn a_fine_tuning_of_another_arm_rate_or_model_is_refused_with_both_values() {
    let CheckpointFiles { model, config, .. } = earlier(&train_spec());
    let init = InitialCheckpoint { model, config };
    let refused = |spec: &TrainSpec, data| {
        let tuner = Trainer::fine_tune(spec, data, "digest", &init, &Device::cpu());
        tuner.err().unwrap().to_string()
    };
    let six = refused(&train_spec(), TrainingData { joints: 6, ..DATA });
    assert!(six.contains("joints 7, this one has 6"), "{six}");
    let slow = refused(&train_spec(), TrainingData { rate_hz: 30.0, ..DATA });
    assert!(slow.contains("rate_hz 60, this one has 30"), "{slow}");
    let other = refused(&training_of(crate::synthetic::kind("cdt")), DATA);
    assert!(other.contains("architecture robomorph, this one has cdt"), "{other}");
    let all = train_spec().model.parts().iter().map(|part| (*part).to_owned()).collect();
    let all = refused(&TrainSpec { frozen: all, ..train_spec() }, DATA);
    assert!(all.contains("frozen is all parameters"), "{all}");
}
