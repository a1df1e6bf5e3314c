use burn::tensor::{Bool, Tensor, activation};
use rayon::prelude::*;

use super::fused::{Array, FusedOp, apply, operand};
use super::matrix::{Matrix, Output, multiply};
use super::vectorized;

/// Which source tokens a token may look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mask {
    /// All.
    None,
    /// Token t those of index up to t + `ahead`; 0 is itself and those before.
    Causal { ahead: usize },
}

/// softmax(Q Kᵀ / √width) V for each head, a head being `width = d_model / heads` neighbouring
/// channels. query `[batch, token, d_model]`, key and value `[batch, source, d_model]`; gives the
/// shape of query.
pub(crate) fn attention(
    query: Tensor<3>,
    key: Tensor<3>,
    value: Tensor<3>,
    heads: usize,
    mask: Mask,
) -> Tensor<3> {
    let operands = [operand(&query), operand(&key), operand(&value)];
    apply(Attention { heads, mask }, operands)
        .unwrap_or_else(|| plain(query, key, value, heads, mask))
}

pub(super) fn plain(
    query: Tensor<3>,
    key: Tensor<3>,
    value: Tensor<3>,
    heads: usize,
    mask: Mask,
) -> Tensor<3> {
    let [batch, tokens, d_model] = query.dims();
    let [_, sources, _] = key.dims();
    let width = d_model / heads;
    let split = |x: Tensor<3>, length| x.reshape([batch, length, heads, width]).swap_dims(1, 2);

    let scores =
        split(query, tokens).matmul(split(key, sources).transpose()) / (width as f32).sqrt();
    let visible = match mask {
        Mask::None => scores,
        Mask::Causal { ahead } => {
            let ahead = i64::try_from(ahead).unwrap_or(i64::MAX);
            let future = Tensor::<2, Bool>::tril_mask([tokens, sources], ahead, &scores.device());
            scores.mask_fill(future.unsqueeze::<4>(), f32::NEG_INFINITY)
        }
    };
    let mixed = activation::softmax(visible, 3).matmul(split(value, sources));
    mixed.swap_dims(1, 2).reshape([batch, tokens, d_model])
}

/// With P = softmax(S), S = Q Kᵀ / √width and O = P V:
/// dV = Pᵀ dO, dP = dO Vᵀ, dS = P (dP - Σ P dP), dQ = dS K / √width, dK = dSᵀ Q / √width.
///
/// A task is one trajectory. The probabilities are computed anew in the derivative, as in
/// FlashAttention (Dao et al. 2022): they are the largest array by far and soon made.
#[derive(Clone, Debug)]
struct Attention {
    heads: usize,
    mask: Mask,
}

/// Extents of one trajectory's part.
struct Extents {
    tokens: usize,
    sources: usize,
    d_model: usize,
    /// Of a head.
    width: usize,
}

impl Attention {
    fn extents(&self, query: &Array, key: &Array) -> Extents {
        let [.., tokens, d_model] = *query.shape() else { unreachable!("of rank 3") };
        let [.., sources, _] = *key.shape() else { unreachable!("of rank 3") };
        Extents { tokens, sources, d_model, width: d_model / self.heads }
    }

    /// P of one head, `[token, source]`. `query` and `key` begin at the head's first channel.
    fn probabilities(&self, query: &[f32], key: &[f32], extents: &Extents, into: &mut [f32]) {
        let Extents { tokens, sources, d_model, width } = *extents;
        let query = Matrix::new(query, tokens, width, d_model);
        let key = Matrix::new(key, sources, width, d_model);
        multiply(extents.scale(), query, key.transposed(), into, sources, Output::Overwrite);
        let visible = match self.mask {
            Mask::None => sources,
            Mask::Causal { ahead } => ahead + 1,
        };
        vectorized::softmax(into, sources, visible);
    }
}

impl Extents {
    fn scale(&self) -> f32 {
        1.0 / (self.width as f32).sqrt()
    }
}

impl FusedOp<3> for Attention {
    fn forward(&self, [query, key, value]: &[Array; 3]) -> Array {
        let extents = self.extents(query, key);
        let Extents { tokens, sources, d_model, width } = extents;
        let (of_query, of_key) = (tokens * d_model, sources * d_model);
        let mut output = vec![0.0; query.values().len()];
        output
            .par_chunks_mut(of_query)
            .zip(query.values().par_chunks(of_query))
            .zip(key.values().par_chunks(of_key))
            .zip(value.values().par_chunks(of_key))
            .for_each_init(
                || vec![0.0; tokens * sources],
                |probabilities, (((output, query), key), value)| {
                    for head in (0..d_model).step_by(width) {
                        self.probabilities(&query[head..], &key[head..], &extents, probabilities);
                        let p = Matrix::new(probabilities, tokens, sources, sources);
                        let value = Matrix::new(&value[head..], sources, width, d_model);
                        multiply(1.0, p, value, &mut output[head..], d_model, Output::Overwrite);
                    }
                },
            );
        Array::new(output, query.shape())
    }

    fn backward(&self, [query, key, value]: &[Array; 3], gradient: &Array) -> [Array; 3] {
        let extents = self.extents(query, key);
        let Extents { tokens, sources, d_model, width } = extents;
        let (of_query, of_key) = (tokens * d_model, sources * d_model);
        let mut d_query = vec![0.0; query.values().len()];
        let mut d_key = vec![0.0; key.values().len()];
        let mut d_value = vec![0.0; value.values().len()];
        let inputs = query
            .values()
            .par_chunks(of_query)
            .zip(key.values().par_chunks(of_key))
            .zip(value.values().par_chunks(of_key))
            .zip(gradient.values().par_chunks(of_query));
        let outputs = d_query
            .par_chunks_mut(of_query)
            .zip(d_key.par_chunks_mut(of_key))
            .zip(d_value.par_chunks_mut(of_key));
        inputs.zip(outputs).for_each_init(
            || (vec![0.0; tokens * sources], vec![0.0; tokens * sources]),
            |(probabilities, scores), (inputs, outputs)| {
                let (((query, key), value), gradient) = inputs;
                let ((d_query, d_key), d_value) = outputs;
                for head in (0..d_model).step_by(width) {
                    let (query, key, value) = (&query[head..], &key[head..], &value[head..]);
                    self.probabilities(query, key, &extents, probabilities);
                    let gradient = Matrix::new(&gradient[head..], tokens, width, d_model);
                    let value = Matrix::new(value, sources, width, d_model);
                    multiply(1.0, gradient, value.transposed(), scores, sources, Output::Overwrite);
                    let p = Matrix::new(probabilities, tokens, sources, sources).transposed();
                    let d_value = &mut d_value[head..];
                    multiply(1.0, p, gradient, d_value, d_model, Output::Overwrite);

                    vectorized::softmax_gradient(probabilities, sources, extents.scale(), scores);
                    let ds = Matrix::new(scores, tokens, sources, sources);
                    let key = Matrix::new(key, sources, width, d_model);
                    multiply(1.0, ds, key, &mut d_query[head..], d_model, Output::Overwrite);
                    let query = Matrix::new(query, tokens, width, d_model);
                    let d_key = &mut d_key[head..];
                    multiply(1.0, ds.transposed(), query, d_key, d_model, Output::Overwrite);
                }
            },
        );
        [
            Array::new(d_query, query.shape()),
            Array::new(d_key, key.shape()),
            Array::new(d_value, value.shape()),
        ]
    }
}
