//! AdamW, with the state of each parameter.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use burn::module::{ModuleMapper, Param};
use burn::optim::{AdamW, AdamWConfig, AdamWState, AdaptiveMomentumState, Optimizer};
use burn::tensor::{Tensor, TensorData};
use kernels::{AdamWStep, Stepped, Together};
use spec::{OptimizerSpec, TrainSpec};

use crate::ModelError;
use crate::device::host_values;
use crate::parameters::{
    NamedTensor, NamedTensors, Path, check_shapes, for_each_parameter, parameters,
};
use crate::sequence_model::SequenceModel;

/// Names of the moments in PyTorch's `Adam`.
const FIRST_MOMENT: &str = "exp_avg.";
pub(crate) const SECOND_MOMENT: &str = "exp_avg_sq.";

/// The same ε as in `torch.nn.utils.clip_grad_norm_`. It avoids a division by a norm of zero.
const CLIP_EPSILON: f64 = 1e-6;

/// AdamW (Loshchilov and Hutter 2019) over the parameters of one model.
///
/// burn's own `ModuleOptimizer` keys its state by ids that a process draws at random. This one
/// names the moments after their parameters, so that they can be saved and resumed exactly.
pub(crate) struct ModelOptimizer {
    rule: AdamW,
    spec: OptimizerSpec,
    /// Moments of every parameter, flattened.
    moments: BTreeMap<String, AdamWState<1>>,
}

/// Gradients by parameter name, flattened.
pub(crate) struct NamedGradients {
    gradients: BTreeMap<String, Tensor<1>>,
    /// Euclidean norm over all gradients.
    pub norm: f64,
}

impl ModelOptimizer {
    pub fn new(spec: &OptimizerSpec, model: &SequenceModel) -> Self {
        let mut moments = BTreeMap::new();
        for_each_parameter(model, |name, parameter| {
            let zeros = parameter.numbers().zeros_like();
            let momentum = AdaptiveMomentumState::new(0, zeros.clone(), zeros);
            moments.insert(name, AdamWState::new(momentum));
        });
        Self { rule: rule(spec), spec: *spec, moments }
    }

    /// Restores the optimizer from [`ModelOptimizer::state`] after `steps` steps.
    ///
    /// # Errors
    /// A moment is missing, superfluous or of another shape.
    pub fn from_state(
        spec: &OptimizerSpec,
        model: &SequenceModel,
        state: NamedTensors,
        steps: usize,
    ) -> Result<Self, String> {
        let mut first = NamedTensors::new();
        let mut second = NamedTensors::new();
        for (key, tensor) in state {
            // The longer prefix is tried first, because both share their beginning.
            if let Some(name) = key.strip_prefix(SECOND_MOMENT) {
                second.insert(name.to_owned(), tensor);
            } else if let Some(name) = key.strip_prefix(FIRST_MOMENT) {
                first.insert(name.to_owned(), tensor);
            } else {
                return Err(format!("tensor `{key}` is not a moment of an optimizer"));
            }
        }
        check_shapes(model, &first).map_err(|reason| format!("{FIRST_MOMENT}: {reason}"))?;
        check_shapes(model, &second).map_err(|reason| format!("{SECOND_MOMENT}: {reason}"))?;

        let mut optimizer = Self::new(spec, model);
        for (name, state) in &mut optimizer.moments {
            let momentum = &mut state.momentum;
            momentum.time = steps;
            fill(&mut momentum.moment_1, first.remove(name));
            fill(&mut momentum.moment_2, second.remove(name));
        }
        Ok(optimizer)
    }

    /// Both moments of every parameter, in the parameter's shape.
    pub fn state(&self, model: &SequenceModel) -> Result<NamedTensors, ModelError> {
        let mut state = NamedTensors::new();
        for (name, NamedTensor { shape, .. }) in parameters(model)? {
            let Some(AdamWState { momentum }) = self.moments.get(&name) else { continue };
            for (prefix, moment) in
                [(FIRST_MOMENT, &momentum.moment_1), (SECOND_MOMENT, &momentum.moment_2)]
            {
                let values = host_values(moment.clone())?;
                state.insert(
                    format!("{prefix}{name}"),
                    NamedTensor { shape: shape.clone(), values },
                );
            }
        }
        Ok(state)
    }

    /// Takes one step of AdamW. The gradients are clipped to the spec's global norm.
    pub fn step(
        &mut self,
        model: SequenceModel,
        gradients: NamedGradients,
        learning_rate: f64,
    ) -> SequenceModel {
        let scale = match self.spec.gradient_clip_norm {
            Some(largest) if gradients.norm > largest => {
                Some(largest / (gradients.norm + CLIP_EPSILON))
            }
            _ => None,
        };
        let mut update = Update {
            path: Path::default(),
            rule: &self.rule,
            spec: &self.spec,
            moments: &mut self.moments,
            gradients: gradients.gradients,
            scale,
            learning_rate,
            updated: BTreeMap::new(),
        };
        if let Some(together) = update.gradients.values().next().and_then(Together::of) {
            update.step_together(together, &model);
        }
        model.map(&mut update)
    }
}

impl NamedGradients {
    #[cfg(test)]
    pub fn by_name(&self) -> &BTreeMap<String, Tensor<1>> {
        &self.gradients
    }

    pub fn new(gradients: BTreeMap<String, Tensor<1>>) -> Result<Self, ModelError> {
        let norm = match gradients.values().next().and_then(Together::of) {
            Some(together) => together.norm(gradients.values()),
            None => sum_of_squares(&gradients)?.sqrt(),
        };
        Ok(Self { norm, gradients })
    }
}

/// The sum of the squared gradients. On the processor it is summed here and in order: the order in
/// which burn-flex adds large tensors depends on the threads, and the clipped step must not depend
/// on it. Other devices sum themselves, and one number of each gradient is read back, because all
/// of them would be as large as the model.
fn sum_of_squares(gradients: &BTreeMap<String, Tensor<1>>) -> Result<f64, ModelError> {
    let mut squares = 0.0;
    let mut elsewhere: Vec<Tensor<1>> = Vec::new();
    for gradient in gradients.values() {
        match kernels::sum_of_squares(gradient) {
            Some(sum) => squares += sum,
            None => elsewhere.push(gradient.clone().square().sum()),
        }
    }
    if !elsewhere.is_empty() {
        let sums = host_values(Tensor::cat(elsewhere, 0))?;
        squares += sums.into_iter().map(f64::from).sum::<f64>();
    }
    Ok(squares)
}

#[expect(clippy::cast_possible_truncation, reason = "burn keeps these constants in f32")]
fn rule(spec: &OptimizerSpec) -> AdamW {
    AdamWConfig::new()
        .with_beta_1(spec.betas[0] as f32)
        .with_beta_2(spec.betas[1] as f32)
        .with_epsilon(spec.epsilon as f32)
        .with_weight_decay(spec.weight_decay as f32)
        .build()
}

fn fill(moment: &mut Tensor<1>, from: Option<NamedTensor>) {
    if let Some(NamedTensor { values, .. }) = from {
        let length = values.len();
        *moment = Tensor::from_data(TensorData::new(values, [length]), &moment.device());
    }
}

struct Update<'a> {
    path: Path,
    /// The rule of burn, for devices without a fused kernel.
    rule: &'a AdamW,
    spec: &'a OptimizerSpec,
    moments: &'a mut BTreeMap<String, AdamWState<1>>,
    gradients: BTreeMap<String, Tensor<1>>,
    scale: Option<f64>,
    learning_rate: f64,
    /// The weights after the step, of a device that takes it for all parameters at once.
    updated: BTreeMap<String, Tensor<1>>,
}

impl ModuleMapper for Update<'_> {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.enter(name);
    }

    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.leave();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let name = self.path.name();
        if let Some(updated) = self.updated.remove(&name) {
            return param
                .map(|value| Tensor::from_inner(updated.reshape(value.dims())).require_grad());
        }
        let Some(gradient) = self.gradients.remove(&name) else { return param };
        let Some(AdamWState { momentum }) = self.moments.remove(&name) else { return param };
        param.map(|value| {
            let shape = value.dims();
            let weight = value.inner().reshape([gradient.shape().num_elements()]);
            let (updated, momentum) = self.step(weight, gradient, momentum);
            self.moments.insert(name, AdamWState::new(momentum));
            Tensor::from_inner(updated.reshape(shape)).require_grad()
        })
    }
}

impl Update<'_> {
    /// Takes the step of all parameters at once.
    fn step_together(&mut self, together: Together, model: &SequenceModel) {
        let (mut names, mut parameters, mut time) = (Vec::new(), Vec::new(), 0);
        for_each_parameter(model, |name, parameter| {
            let Some(gradient) = self.gradients.remove(&name) else { return };
            let Some(AdamWState { momentum }) = self.moments.remove(&name) else { return };
            // Parameters that train have taken the same steps.
            time = momentum.time + 1;
            let moments = [momentum.moment_1, momentum.moment_2];
            parameters.push(Stepped { weight: parameter.numbers(), gradient, moments });
            names.push(name);
        });
        let updated = together.adam_w(parameters, &self.fused_step(time));
        for (name, [weight, first, second]) in names.into_iter().zip(updated) {
            let momentum = AdaptiveMomentumState::new(time, first, second);
            self.moments.insert(name.clone(), AdamWState::new(momentum));
            self.updated.insert(name, weight);
        }
    }

    /// The weight after a step, and its moments.
    fn step(
        &self,
        weight: Tensor<1>,
        gradient: Tensor<1>,
        momentum: AdaptiveMomentumState<1>,
    ) -> (Tensor<1>, AdaptiveMomentumState<1>) {
        if kernels::is_fused(&gradient) {
            let AdaptiveMomentumState { time, moment_1, moment_2, .. } = momentum;
            let step = self.fused_step(time + 1);
            let [updated, moment_1, moment_2] =
                kernels::adam_w(weight, gradient, [moment_1, moment_2], &step);
            return (updated, AdaptiveMomentumState::new(time + 1, moment_1, moment_2));
        }
        let gradient = match self.scale {
            Some(scale) => gradient.mul_scalar(scale),
            None => gradient,
        };
        let state = Some(AdamWState::new(momentum));
        let (updated, state) = self.rule.step(self.learning_rate, weight, gradient, state);
        let AdamWState { momentum } = state.expect("AdamW always has a state");
        (updated, momentum)
    }

    /// Step `time`, which counts from 1.
    fn fused_step(&self, time: usize) -> AdamWStep {
        AdamWStep {
            time,
            scale: self.scale.unwrap_or(1.0),
            learning_rate: self.learning_rate,
            betas: self.spec.betas,
            epsilon: self.spec.epsilon,
            weight_decay: self.spec.weight_decay,
        }
    }
}

/// Learning rate over the steps of a training: linear warmup, then half a cosine
/// (Loshchilov and Hutter 2017) down to a share of the peak.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Schedule {
    peak: f64,
    final_ratio: f64,
    warmup_steps: u64,
    steps: u64,
}

impl Schedule {
    pub fn new(spec: &TrainSpec) -> Self {
        let OptimizerSpec { learning_rate, final_learning_rate_ratio, warmup_steps, .. } =
            spec.optimizer;
        Self {
            peak: learning_rate,
            final_ratio: final_learning_rate_ratio,
            warmup_steps,
            steps: spec.steps,
        }
    }

    /// Learning rate of the step that follows `done` steps. The last warmup step has the peak.
    pub fn learning_rate(&self, done: u64) -> f64 {
        if done < self.warmup_steps {
            return self.peak * (done + 1) as f64 / self.warmup_steps as f64;
        }
        let decay_steps = self.steps.saturating_sub(self.warmup_steps).max(1);
        let progress = ((done - self.warmup_steps) as f64 / decay_steps as f64).min(1.0);
        let cosine = 0.5 * (1.0 + (PI * progress).cos());
        self.peak * (self.final_ratio + (1.0 - self.final_ratio) * cosine)
    }
}

#[cfg(test)]
mod tests {
    use super::Schedule;

    const SCHEDULE: Schedule =
        Schedule { peak: 2.0, final_ratio: 0.1, warmup_steps: 10, steps: 110 };

    #[test]
    fn warmup_is_linear_and_ends_at_the_peak() {
        assert_eq!(SCHEDULE.learning_rate(0), 0.2);
        assert_eq!(SCHEDULE.learning_rate(4), 1.0);
        assert_eq!(SCHEDULE.learning_rate(9), 2.0);
    }

    #[test]
    fn the_cosine_falls_from_the_peak_to_the_final_ratio() {
        assert_eq!(SCHEDULE.learning_rate(10), 2.0);
        assert!((SCHEDULE.learning_rate(60) - 1.1).abs() < 1e-12);
        assert!((SCHEDULE.learning_rate(110) - 0.2).abs() < 1e-12);
        assert!((SCHEDULE.learning_rate(1_000) - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_training_shorter_than_its_warmup_never_divides_by_zero() {
        let short = Schedule { steps: 5, ..SCHEDULE };
        assert!((0..20).all(|step| short.learning_rate(step).is_finite()));
    }
}
