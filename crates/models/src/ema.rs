//! The exponential moving average of weights.

use std::collections::BTreeMap;

use burn::module::{ModuleMapper, Param};
use burn::tensor::Tensor;
use spec::EmaSpec;

use crate::parameters::{Path, for_each_parameter};
use crate::sequence_model::SequenceModel;

/// Moving average of the weights of a model in training.
#[derive(Clone, Debug)]
pub(crate) struct WeightAverage {
    spec: EmaSpec,
    /// Averages by parameter name, flattened.
    averages: BTreeMap<String, Tensor<1>>,
}

impl WeightAverage {
    /// Starts with the weights of `model`, before any update.
    pub fn new(spec: EmaSpec, model: &SequenceModel) -> Self {
        let mut averages = BTreeMap::new();
        for_each_parameter(model, |name, weight| {
            averages.insert(name, weight.numbers());
        });
        Self { spec, averages }
    }

    /// Adds the weights after `step` steps to the average.
    pub fn update(&mut self, model: &SequenceModel, step: u64) {
        let keep = self.decay(step);
        for_each_parameter(model, |name, weight| {
            let Some(average) = self.averages.remove(&name) else { return };
            let updated = average.mul_scalar(keep) + weight.numbers().mul_scalar(1.0 - keep);
            self.averages.insert(name, updated);
        });
    }

    /// min(decay, 1 - n^-power): 0 after the first step, so that initial weights do not linger.
    fn decay(&self, step: u64) -> f64 {
        (1.0 - (step.max(1) as f64).powf(-self.spec.power)).min(self.spec.decay)
    }

    /// `model` with the averages as weights, for inference only.
    pub fn model(&self, model: &SequenceModel) -> SequenceModel {
        let mut replace = Replace { path: Path::default(), averages: &self.averages };
        model.for_inference().map(&mut replace)
    }
}

struct Replace<'a> {
    path: Path,
    averages: &'a BTreeMap<String, Tensor<1>>,
}

impl ModuleMapper for Replace<'_> {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.enter(name);
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.leave();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(average) = self.averages.get(&self.path.name()) else { return param };
        param.map(|value| average.clone().reshape(value.dims()))
    }
}
