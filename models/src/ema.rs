use std::collections::BTreeMap;

use burn::module::{ModuleMapper, ModuleVisitor, Param};
use burn::tensor::Tensor;
use spec::EmaSpec;

use crate::parameters::Path;
use crate::sequence_model::SequenceModel;

/// Moving average of the weights of a model in training.
#[derive(Clone, Debug)]
pub(crate) struct WeightAverage {
    spec: EmaSpec,
    /// By parameter name, flattened.
    averages: BTreeMap<String, Tensor<1>>,
}

impl WeightAverage {
    /// The weights of `model`, averaged over nothing yet.
    pub fn new(spec: EmaSpec, model: &SequenceModel) -> Self {
        let mut copy = Average { path: Path::default(), keep: 0.0, averages: BTreeMap::new() };
        model.visit(&mut copy);
        Self { spec, averages: copy.averages }
    }

    /// Takes in the weights after `step` steps.
    pub fn update(&mut self, model: &SequenceModel, step: u64) {
        let averages = std::mem::take(&mut self.averages);
        let mut update = Average { path: Path::default(), keep: self.decay(step), averages };
        model.visit(&mut update);
        self.averages = update.averages;
    }

    /// min(decay, 1 - n^-power): 0 after the first step, so that initial weights do not linger.
    fn decay(&self, step: u64) -> f64 {
        (1.0 - (step.max(1) as f64).powf(-self.spec.power)).min(self.spec.decay)
    }

    /// `model` with the averages as weights, without what training needs.
    pub fn model(&self, model: &SequenceModel) -> SequenceModel {
        let mut replace = Replace { path: Path::default(), averages: &self.averages };
        model.for_inference().map(&mut replace)
    }
}

struct Average {
    path: Path,
    keep: f64,
    averages: BTreeMap<String, Tensor<1>>,
}

impl ModuleVisitor for Average {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.enter(name);
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.leave();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let name = self.path.name();
        let weight = param.val().inner();
        let length = weight.shape().num_elements();
        let weight = weight.reshape([length]);
        let average = match self.averages.remove(&name) {
            Some(average) => average.mul_scalar(self.keep) + weight.mul_scalar(1.0 - self.keep),
            None => weight,
        };
        self.averages.insert(name, average);
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
