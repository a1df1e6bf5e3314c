//! Each operation as PyTorch's functions compute it.

use tch::{Device, Kind, Tensor};

use super::bridge;
use crate::attention::{Attention, Mask};
use crate::conv_transpose1d::ConvTranspose1d;
use crate::conv1d::Conv1d;
use crate::dropout::{Dropout, DropoutMask};
use crate::factors::Factors;
use crate::fused::WithTorch;
use crate::gelu_linear::GeluLinear;
use crate::group_norm_mish::{self, GroupNormMish};
use crate::layer_norm::{self, LayerNorm};
use crate::linear::Linear;
use crate::mish::Mish;
use crate::norm_conv1d::NormConv1d;
use crate::norm_linear::NormLinear;
use crate::tanh::Tanh;

impl WithTorch<3> for Linear {
    fn with_torch(&self, [x, weight, bias]: [&Tensor; 3]) -> Tensor {
        linear(x, weight, bias, self.packing.factors)
    }
}

/// `x Wᵀ + b`. Factors of bf16 give a product that is rounded to bf16, as `torch.autocast` does.
fn linear(x: &Tensor, weight: &Tensor, bias: &Tensor, factors: Factors) -> Tensor {
    match factors {
        Factors::F32 => x.linear(weight, Some(bias)),
        Factors::Bf16 => {
            let [x, weight, bias] = [x, weight, bias].map(|tensor| tensor.to_kind(Kind::BFloat16));
            x.linear(&weight, Some(bias)).to_kind(Kind::Float)
        }
    }
}

impl WithTorch<3> for LayerNorm {
    fn with_torch(&self, [x, weight, bias]: [&Tensor; 3]) -> Tensor {
        layer_norm(x, weight, bias)
    }
}

fn layer_norm(x: &Tensor, weight: &Tensor, bias: &Tensor) -> Tensor {
    let epsilon = f64::from(layer_norm::EPSILON);
    x.layer_norm(weight.size(), Some(weight), Some(bias), epsilon, true)
}

impl WithTorch<5> for NormLinear {
    fn with_torch(&self, [x, scale, shift, weight, bias]: [&Tensor; 5]) -> Tensor {
        linear(&layer_norm(x, scale, shift), weight, bias, self.packing.factors)
    }
}

impl WithTorch<9> for NormLinear {
    fn with_torch(&self, [x, scale, shift, w0, w1, w2, b0, b1, b2]: [&Tensor; 9]) -> Tensor {
        let (weight, bias) = (Tensor::cat(&[w0, w1, w2], 0), Tensor::cat(&[b0, b1, b2], 0));
        linear(&layer_norm(x, scale, shift), &weight, &bias, self.packing.factors)
    }
}

impl WithTorch<4> for GeluLinear {
    fn with_torch(&self, [residual, x, weight, bias]: [&Tensor; 4]) -> Tensor {
        let [between, after] = &self.masks;
        let hidden = drop_out(x.gelu("none"), between.as_ref());
        let y = linear(&hidden, weight, bias, self.packing.factors);
        residual + drop_out(y, after.as_ref())
    }
}

impl WithTorch<1> for Dropout {
    fn with_torch(&self, [x]: [&Tensor; 1]) -> Tensor {
        drop_out(x.shallow_clone(), Some(&self.mask))
    }
}

/// PyTorch draws the mask itself, so that no mask is in memory where one kernel does with a few numbers. The numbers are not
/// those of the processor, but they repeat: each place begins with a seed of its own for each batch.
fn drop_out(x: Tensor, mask: Option<&DropoutMask>) -> Tensor {
    match seeded(mask, x.device()) {
        None => x,
        Some(rate) => x.dropout(rate, true),
    }
}

/// The rate of `mask`, after PyTorch's random numbers began with its seed.
fn seeded(mask: Option<&DropoutMask>, device: Device) -> Option<f64> {
    let mask = mask?;
    bridge::seed(device.is_cuda(), mask.seed());
    Some(mask.rate())
}

impl WithTorch<3> for Attention {
    fn with_torch(&self, [query, key, value]: [&Tensor; 3]) -> Tensor {
        attention(self, [query, key, value])
    }
}

impl WithTorch<1> for Attention {
    fn with_torch(&self, [projected]: [&Tensor; 1]) -> Tensor {
        let parts = projected.chunk(3, 2);
        attention(self, [&parts[0], &parts[1], &parts[2]])
    }
}

fn attention(op: &Attention, inputs: [&Tensor; 3]) -> Tensor {
    let [query, key, value] = inputs.map(|tensor| {
        let size = tensor.size();
        let heads = i64::try_from(op.heads).unwrap_or(1);
        let tensor = match op.factors {
            Factors::F32 => tensor.shallow_clone(),
            Factors::Bf16 => tensor.to_kind(Kind::BFloat16),
        };
        tensor.view([size[0], size[1], heads, size[2] / heads]).transpose(1, 2)
    });
    let (tokens, sources, device) = (query.size()[2], key.size()[2], key.device());
    let is_causal = op.mask == (Mask::Causal { ahead: 0 }) && tokens == sources;
    let visible = if is_causal { None } else { visible(op.mask, [tokens, sources], device) };
    let rate = seeded(op.dropout.as_ref(), device).unwrap_or(0.0);
    Tensor::scaled_dot_product_attention(
        &query, &key, &value, visible, rate, is_causal, None, false,
    )
    .transpose(1, 2)
    .flatten(2, 3)
    .to_kind(Kind::Float)
}

/// Whether each token attends to each source, or `None` if all attend to all.
fn visible(mask: Mask, [tokens, sources]: [i64; 2], device: Device) -> Option<Tensor> {
    let below = |ahead| Tensor::ones([tokens, sources], (Kind::Bool, device)).tril(ahead);
    match mask {
        Mask::None => None,
        Mask::Causal { ahead } => Some(below(i64::try_from(ahead).unwrap_or(i64::MAX))),
        Mask::Prefix { length } => {
            let visible = below(0);
            let length = i64::try_from(length).unwrap_or(i64::MAX).min(sources);
            let _ = visible.narrow(1, 0, length).fill_(1);
            Some(visible)
        }
    }
}

impl WithTorch<1> for Mish {
    fn with_torch(&self, [x]: [&Tensor; 1]) -> Tensor {
        x.mish()
    }
}

impl WithTorch<1> for Tanh {
    fn with_torch(&self, [x]: [&Tensor; 1]) -> Tensor {
        x.tanh()
    }
}

impl WithTorch<3> for GroupNormMish {
    fn with_torch(&self, [x, weight, bias]: [&Tensor; 3]) -> Tensor {
        let (groups, epsilon) = (whole(self.groups), f64::from(group_norm_mish::EPSILON));
        x.group_norm(groups, Some(weight), Some(bias), epsilon, true).mish()
    }
}

impl WithTorch<3> for Conv1d {
    fn with_torch(&self, [x, weight, bias]: [&Tensor; 3]) -> Tensor {
        x.conv1d(weight, Some(bias), whole(self.stride), whole(self.padding), 1, 1)
    }
}

impl WithTorch<3> for ConvTranspose1d {
    fn with_torch(&self, [x, weight, bias]: [&Tensor; 3]) -> Tensor {
        x.conv_transpose1d(weight, Some(bias), whole(self.stride), whole(self.padding), 0, 1, 1)
    }
}

impl WithTorch<6> for NormConv1d {
    fn with_torch(&self, [x, norm_weight, norm_bias, shift, weight, bias]: [&Tensor; 6]) -> Tensor {
        let hidden = self.norm.with_torch([x, norm_weight, norm_bias]) + shift;
        self.conv.with_torch([&hidden, weight, bias])
    }
}

impl WithTorch<7> for NormConv1d {
    fn with_torch(
        &self,
        [x, norm_weight, norm_bias, scale, shift, weight, bias]: [&Tensor; 7],
    ) -> Tensor {
        let hidden = shift.addcmul(&self.norm.with_torch([x, norm_weight, norm_bias]), scale);
        self.conv.with_torch([&hidden, weight, bias])
    }
}

fn whole(extent: usize) -> i64 {
    i64::try_from(extent).unwrap_or(i64::MAX)
}
