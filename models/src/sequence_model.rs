use burn::module::{Module, ModuleMapper, ModuleVisitor};
use burn::tensor::{Tensor, TensorData};
use spec::{Head, JOINTS, ModelSpec};

use crate::ModelError;
use crate::cdcnn::CdcnnConfig;
use crate::cdt::CdtConfig;
use crate::denoiser::{Denoiser, Network};
use crate::diffuser::DiffuserConfig;
use crate::diffusion::Step;
use crate::gaussian;
use crate::initialization::InitialWeights;
use crate::parameters::host_values;
use crate::randomness::Noise;
use crate::robomorph::{RoboMorph, RoboMorphConfig};

/// What every architecture is given.
#[derive(Clone, Debug)]
pub(crate) struct ModelInput {
    /// Normalized torques `[batch, sample, 7]`.
    pub u: Tensor<3>,
    /// Normalized positions `[batch, context, 7]`.
    pub y_context: Tensor<3>,
    /// The same positions as answers are given: [`crate::frame`].
    pub seen_context: Tensor<3>,
    /// What answers are relative to, as normalized positions `[batch, sample, 7]`.
    pub path: Tensor<3>,
}

/// What a training step makes small.
pub(crate) struct Loss {
    /// Of each entry, `[batch, sample, channel]`, 0 where it does not count.
    pub errors: Tensor<3>,
    /// What their sum is divided by.
    pub count: usize,
    /// y of the horizon, where the loss is that of a prediction.
    pub predicted: Option<Tensor<3>>,
}

impl Loss {
    /// The errors of y, the last channels, times the weight of their joint.
    #[expect(clippy::cast_possible_truncation, reason = "losses are computed in f32")]
    pub fn weighted(self, weights: &[f64; JOINTS]) -> Self {
        let [.., channels] = self.errors.dims();
        let others = std::iter::repeat_n(1.0, channels - JOINTS);
        let values: Vec<f32> = others.chain(weights.iter().map(|&weight| weight as f32)).collect();
        let data = TensorData::new(values, [1, 1, channels]);
        let weights = Tensor::from_data(data, &self.errors.device());
        Self { errors: self.errors * weights, ..self }
    }

    /// As a tensor of which gradients can be asked.
    pub fn tensor(&self) -> Tensor<1> {
        let entries = self.errors.shape().num_elements();
        let mean = self.errors.clone().mean();
        if entries == self.count { mean } else { mean * (entries as f64 / self.count as f64) }
    }

    /// Summed here and in order: the backend adds large tensors in an order that depends on which
    /// thread was free.
    pub fn value(&self) -> Result<f64, ModelError> {
        let errors = host_values(self.errors.clone().inner())?;
        Ok(errors.into_iter().map(f64::from).sum::<f64>() / self.count as f64)
    }
}

/// How an answer is come by.
pub(crate) struct Ask<'a> {
    /// Passes of a denoiser.
    pub steps: &'a [Step],
    /// A guess of y of the horizon for a denoiser to begin with.
    pub warm: Option<Tensor<3>>,
    pub noise: &'a mut Noise,
    /// Whether a model that knows its uncertainty is to draw from it.
    pub draw: Draw,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Draw {
    /// The mean, of a model that has one in closed form.
    Mean,
    Sample,
}

/// One of the architectures. Not a burn module itself, so that parameter names do not begin with
/// the architecture's.
#[derive(Clone, Debug)]
pub(crate) enum SequenceModel {
    RoboMorph(RoboMorph),
    Denoiser(Denoiser),
}

impl SequenceModel {
    /// `context` and `horizon` in samples.
    pub fn new(
        spec: &ModelSpec,
        context: u32,
        horizon: u32,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Self, ModelError> {
        let samples = context + horizon;
        let network = match spec {
            ModelSpec::RoboMorph(spec) => {
                let config = RoboMorphConfig::new(spec, context, horizon)?;
                return Ok(Self::RoboMorph(config.init(weights)));
            }
            ModelSpec::Diffuser(spec) => {
                Network::Diffuser(DiffuserConfig::new(spec, samples)?.init(weights))
            }
            ModelSpec::Cdcnn(spec) => {
                Network::Cdcnn(Box::new(CdcnnConfig::new(spec, samples)?.init(weights)))
            }
            ModelSpec::Cdt(spec) => Network::Cdt(CdtConfig::new(spec, samples)?.init(weights)),
            ModelSpec::Flow(spec) => {
                Network::Cdcnn(Box::new(CdcnnConfig::of_flow(spec, samples)?.init(weights)))
            }
        };
        Ok(Self::Denoiser(Denoiser::new(network, spec)?))
    }

    /// How many parameters [`SequenceModel::new`] would make, without making them.
    pub fn parameter_count(
        spec: &ModelSpec,
        context: u32,
        horizon: u32,
    ) -> Result<u64, ModelError> {
        let samples = context.saturating_add(horizon);
        Ok(match spec {
            ModelSpec::RoboMorph(spec) => {
                RoboMorphConfig::new(spec, context, horizon)?.parameter_count()
            }
            ModelSpec::Diffuser(spec) => DiffuserConfig::new(spec, samples)?.parameter_count(),
            ModelSpec::Cdcnn(spec) => CdcnnConfig::new(spec, samples)?.parameter_count(),
            ModelSpec::Cdt(spec) => CdtConfig::new(spec, samples)?.parameter_count(),
            ModelSpec::Flow(spec) => CdcnnConfig::of_flow(spec, samples)?.parameter_count(),
        })
    }

    /// Whether it can answer the same question in several ways.
    pub fn is_generative(&self) -> bool {
        match self {
            Self::RoboMorph(model) => model.kind() == Head::Gaussian,
            Self::Denoiser(_) => true,
        }
    }

    /// What is lost on `target`, y of the horizon `[batch, horizon, 7]`.
    pub fn loss(&self, input: ModelInput, target: Tensor<3>, noise: &mut Noise) -> Loss {
        match self {
            Self::RoboMorph(model) => {
                let answer = model.forward(input.u, input.y_context);
                let (errors, predicted) = match model.kind() {
                    Head::Point => ((answer.clone() - target).square(), answer),
                    Head::Gaussian => {
                        let (mean, _) = gaussian::split(answer.clone());
                        (gaussian::negative_log_likelihood(answer, target), mean)
                    }
                };
                let count = errors.shape().num_elements();
                Loss { errors, count, predicted: Some(predicted) }
            }
            Self::Denoiser(model) => model.loss(input, target, noise),
        }
    }

    /// Gives y of the horizon `[batch, horizon, 7]`, as the frame sees it.
    pub fn answer(&self, input: ModelInput, ask: Ask<'_>) -> Tensor<3> {
        match self {
            Self::RoboMorph(model) => {
                let answer = model.forward(input.u, input.y_context);
                if model.kind() == Head::Point {
                    return answer;
                }
                let (mean, log_variance) = gaussian::split(answer);
                match ask.draw {
                    Draw::Mean => mean,
                    Draw::Sample => {
                        let [_, horizon, channels] = mean.dims();
                        let noise = ask.noise.normal([horizon, channels], &mean.device());
                        mean + (log_variance * 0.5).exp() * noise
                    }
                }
            }
            Self::Denoiser(model) => model.sample(&input, ask.warm, ask.steps, ask.noise),
        }
    }

    /// The same weights, without what training needs.
    pub fn for_inference(&self) -> Self {
        match self {
            Self::RoboMorph(model) => Self::RoboMorph(model.valid()),
            Self::Denoiser(model) => Self::Denoiser(model.for_inference()),
        }
    }

    pub fn visit<V: ModuleVisitor>(&self, visitor: &mut V) {
        match self {
            Self::RoboMorph(model) => model.visit(visitor),
            Self::Denoiser(model) => model.visit(visitor),
        }
    }

    pub fn map<M: ModuleMapper>(self, mapper: &mut M) -> Self {
        match self {
            Self::RoboMorph(model) => Self::RoboMorph(model.map(mapper)),
            Self::Denoiser(model) => Self::Denoiser(model.map(mapper)),
        }
    }
}

#[cfg(test)]
mod tests {
    use spec::{JobSpec, ModelSpec};

    use super::SequenceModel;
    use crate::initialization::InitialWeights;
    use crate::parameters::parameters;

    fn preset(name: &str, more: &str) -> ModelSpec {
        let job = format!(
            r#"{{"kind": "train", "data": {{"dataset": 1}}, "model": {{"preset": "{name}"{more}}}, "steps": 1}}"#
        );
        match spec::parse(job.as_bytes()).unwrap() {
            JobSpec::Train(train) => train.model,
            other => panic!("{other:?}"),
        }
    }

    fn count(name: &str, more: &str) -> f64 {
        SequenceModel::parameter_count(&preset(name, more), 320, 80).unwrap() as f64
    }

    /// The counts that the published sizes imply; of CDCNN less its block without effect, 0.1 M.
    #[test]
    fn at_the_papers_sizes_there_are_as_many_parameters() {
        for (name, more, millions) in [
            ("robomorph-paper", "", 49.9),
            ("diffuser-paper", "", 63.1),
            ("cdcnn-paper", "", 16.6),
            ("cdcnn-paper", r#", "conditioning": "global""#, 36.4),
            ("cdt-paper", "", 35.8),
            ("flow-paper", "", 16.4),
        ] {
            let found = count(name, more) / 1e6;
            assert_eq!(preset(name, more).parameters(320, 80) as f64, count(name, more), "{name}");
            assert!((found / millions - 1.0).abs() < 0.01, "{name}: {found} M");
        }
    }

    #[test]
    fn models_have_the_parameters_that_they_were_said_to_have() {
        let device = burn::tensor::Device::flex();
        for name in ["robomorph-tiny", "diffuser-tiny", "cdcnn-tiny", "cdt-tiny", "flow-tiny"] {
            let spec = preset(name, "");
            let mut weights = InitialWeights::new(0, &device);
            let model = SequenceModel::new(&spec, 320, 80, &mut weights).unwrap();
            let found: usize =
                parameters(&model).unwrap().values().map(|tensor| tensor.values.len()).sum();
            assert_eq!(found as f64, count(name, ""), "{name}");
            assert_eq!(found as u64, spec.parameters(320, 80), "{name}");
        }
    }
}
