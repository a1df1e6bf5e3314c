//! Tests that every architecture must pass.

mod fine_tuning;
mod learning;
mod sampling;
mod training;

use models::{Device, TrainedModel, Trainer};
use series::{Observed, Series};
use spec::{ModelSpec, TrainSpec};

use crate::synthetic::{CONTEXT, DATA, JOINTS, SAMPLES, batch, training_of};

const CONTEXT_VALUES: usize = CONTEXT as usize * JOINTS;
const HORIZON_VALUES: usize = (SAMPLES - CONTEXT) as usize * JOINTS;
const ROW: usize = SAMPLES as usize * JOINTS;

fn trainer(spec: &TrainSpec) -> Trainer {
    Trainer::new(spec, DATA, "digest", &Device::cpu()).unwrap()
}

fn train(trainer: &mut Trainer, steps: std::ops::Range<u64>) {
    for step in steps {
        trainer.step(&batch(step, 8)).unwrap();
    }
}

fn known(batch: &Series) -> Observed<'_> {
    batch.observed(CONTEXT as usize)
}

fn briefly_trained(model: ModelSpec) -> TrainedModel {
    let mut trainer = trainer(&training_of(model));
    train(&mut trainer, 0..3);
    TrainedModel::from_files(&trainer.checkpoint().unwrap(), &Device::cpu()).unwrap()
}
