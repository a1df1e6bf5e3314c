//! A step of AdamW.

use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::adam_w_step::AdamWStep;
use super::fused::{Array, Operand, operand};
use super::vectorized;

/// Elements of a task: 64 KiB of each of four arrays.
const TASK: usize = 16_384;

/// Weight and moments after `step`. They keep their memory if nothing else uses it. [`is_fused`]
/// must hold for the tensors.
pub fn adam_w(
    weight: Tensor<1>,
    gradient: Tensor<1>,
    moments: [Tensor<1>; 2],
    step: &AdamWStep,
) -> [Tensor<1>; 3] {
    let (device, step) = (weight.device(), &step.constants());
    let [mut first, mut second] = moments.map(in_memory);
    let (mut weight, gradient) = (in_memory(weight), in_memory(gradient));
    weight
        .par_chunks_mut(TASK)
        .zip(gradient.par_chunks(TASK))
        .zip(first.par_chunks_mut(TASK).zip(second.par_chunks_mut(TASK)))
        .for_each(|((weight, gradient), (first, second))| {
            vectorized::adam_w(weight, gradient, first, second, step);
        });
    [weight, first, second].map(|values| {
        let length = values.len();
        Tensor::from_data(TensorData::new(values, [length]), &device)
    })
}

fn in_memory(tensor: Tensor<1>) -> Vec<f32> {
    tensor.try_into_vec_as().expect("a tensor in memory, of float32, can be read")
}

/// Whether the functions of this module support the tensor.
pub fn is_fused(tensor: &Tensor<1>) -> bool {
    values(tensor).is_some()
}

/// Σ x² in double precision, in an order that does not depend on threads. `None` for a tensor of
/// another backend.
pub fn sum_of_squares(x: &Tensor<1>) -> Option<f64> {
    const LANES: usize = 8;
    let x = values(x)?;
    let parts: Vec<f64> = x
        .values()
        .par_chunks(TASK)
        .map(|part| {
            let mut lanes = [0.0; LANES];
            let (blocks, rest) = part.as_chunks::<LANES>();
            for block in blocks {
                for (lane, &value) in lanes.iter_mut().zip(block) {
                    *lane += f64::from(value) * f64::from(value);
                }
            }
            let rest = rest.iter().map(|&value| f64::from(value).powi(2));
            lanes.into_iter().chain(rest).sum::<f64>()
        })
        .collect();
    Some(parts.into_iter().sum())
}

fn values(tensor: &Tensor<1>) -> Option<Array> {
    match operand(tensor)? {
        Operand::Plain(tensor) => Some(Array::of(&tensor)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use burn::optim::{AdamWConfig, Optimizer};
    use burn::tensor::{Device, Tensor};

    use super::{AdamWStep, adam_w, is_fused, sum_of_squares};
    use crate::agreement::values;

    fn wave(length: usize, rate: f32) -> Tensor<1> {
        let values: Vec<f32> = (0..length).map(|index| (index as f32 * rate).sin()).collect();
        Tensor::from_floats(values.as_slice(), &Device::flex())
    }

    #[test]
    fn steps_are_those_of_burn() {
        const LENGTH: usize = 40_001;
        let rule = AdamWConfig::new()
            .with_beta_1(0.9)
            .with_beta_2(0.95)
            .with_epsilon(1e-8)
            .with_weight_decay(0.1)
            .build();
        let (mut plain, mut state) = (wave(LENGTH, 0.1), None);
        let mut fused = plain.clone();
        let mut moments = [fused.zeros_like(), fused.zeros_like()];
        for time in 1..4 {
            let gradient = wave(LENGTH, 0.7 * time as f32);
            (plain, state) = rule.step(1e-2, plain, gradient.clone() * 0.5, state);
            let step = AdamWStep {
                time,
                scale: 0.5,
                learning_rate: 1e-2,
                betas: [0.9, 0.95],
                epsilon: 1e-8,
                weight_decay: 0.1,
            };
            assert!(is_fused(&gradient));
            let [weight, first, second] = adam_w(fused, gradient, moments, &step);
            (fused, moments) = (weight, [first, second]);
        }
        let (plain, fused) = (values(plain), values(fused));
        for (plain, fused) in plain.into_iter().zip(fused) {
            assert!((plain - fused).abs() < 1e-6, "{plain} {fused}");
        }
    }

    #[test]
    fn squares_are_summed_in_double_precision() {
        let x = wave(100_003, 0.3);
        let values = values(x.clone());
        let exact: f64 = values.into_iter().map(|x| f64::from(x).powi(2)).sum();
        assert!((sum_of_squares(&x).unwrap() / exact - 1.0).abs() < 1e-12);
    }
}
