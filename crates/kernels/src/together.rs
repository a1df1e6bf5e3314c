//! Operations on all parameters of a model at once.

use burn::tensor::Tensor;

use super::adam_w_step::AdamWStep;
#[cfg(feature = "torch")]
use super::torch;

/// A parameter and what a step of AdamW needs to know of it.
#[derive(Debug)]
pub struct Stepped {
    /// The weight.
    pub weight: Tensor<1>,
    /// The gradient of the loss.
    pub gradient: Tensor<1>,
    /// The averages of the gradient and of its square.
    pub moments: [Tensor<1>; 2],
}

/// A backend whose kernels take all parameters at once. On a GPU, each of hundreds of small kernels would take longer to start
/// than to run. Only PyTorch is one; without its feature there is no value of this type.
#[derive(Clone, Copy, Debug)]
pub struct Together {
    #[cfg(not(feature = "torch"))]
    never: std::convert::Infallible,
}

#[cfg(feature = "torch")]
impl Together {
    /// The backend of the tensor, if it is one.
    pub fn of(tensor: &Tensor<1>) -> Option<Self> {
        torch::is_one(tensor).then_some(Self {})
    }

    /// Weights and moments after `step`. The moments keep their memory if nothing else uses it.
    pub fn adam_w(self, parameters: Vec<Stepped>, step: &AdamWStep) -> Vec<[Tensor<1>; 3]> {
        torch::adam_w(parameters, step)
    }

    /// √Σ x² over the numbers of all tensors.
    pub fn norm<'a>(self, tensors: impl Iterator<Item = &'a Tensor<1>>) -> f64 {
        torch::norm(tensors)
    }
}

#[cfg(not(feature = "torch"))]
#[expect(missing_docs, reason = "as above")]
impl Together {
    pub fn of(_: &Tensor<1>) -> Option<Self> {
        None
    }

    pub fn adam_w(self, _: Vec<Stepped>, _: &AdamWStep) -> Vec<[Tensor<1>; 3]> {
        match self.never {}
    }

    pub fn norm<'a>(self, _: impl Iterator<Item = &'a Tensor<1>>) -> f64 {
        match self.never {}
    }
}
