use burn::tensor::{Bool, Tensor, activation};
use rayon::prelude::*;

use super::dropout::{self, DropoutMask};
use super::fused::{Array, FusedOp, apply, operand};
use super::panels::Panels;
use super::parts::in_parts;
use super::product::{Left, Onto, Right, multiply};
use super::softmax::{softmax, softmax_gradient};
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
/// shape of query. `dropout` leaves out numbers of the softmax.
pub(crate) fn attention(
    query: Tensor<3>,
    key: Tensor<3>,
    value: Tensor<3>,
    heads: usize,
    mask: Mask,
    dropout: Option<DropoutMask>,
) -> Tensor<3> {
    let operands = [operand(&query), operand(&key), operand(&value)];
    let op = Attention { heads, mask, dropout };
    apply(op.clone(), operands)
        .unwrap_or_else(|| plain(query, key, value, heads, mask, op.dropout.as_ref()))
}

pub(super) fn plain(
    query: Tensor<3>,
    key: Tensor<3>,
    value: Tensor<3>,
    heads: usize,
    mask: Mask,
    dropout: Option<&DropoutMask>,
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
    let p = dropout::plain(activation::softmax(visible, 3), dropout);
    let mixed = p.matmul(split(value, sources));
    mixed.swap_dims(1, 2).reshape([batch, tokens, d_model])
}

/// With P = softmax(S), S = Q Kᵀ / √width and O = P V:
/// dV = Pᵀ dO, dP = dO Vᵀ, dS = P (dP - Σ P dP), dQ = dS K / √width, dK = dSᵀ Q / √width. With M of a
/// dropout, O = (M P) V, dV = (M P)ᵀ dO and dP = M (dO Vᵀ).
///
/// Rows of P are made a few at a time, which stay in a core's cache, and anew in the derivative, as
/// in FlashAttention (Dao et al. 2022): P is the largest array by far and soon made. What no token
/// of the few may look at is not computed. The derivative's tasks are the trajectories, since dK and
/// dV are sums over tokens.
#[derive(Clone, Debug)]
struct Attention {
    heads: usize,
    mask: Mask,
    dropout: Option<DropoutMask>,
}

/// Tokens whose rows of P are made at once: a multiple of a tile's rows.
const TOKENS: usize = 48;

/// Extents of one trajectory's part.
#[derive(Clone, Copy)]
struct Extents<'a> {
    tokens: usize,
    sources: usize,
    d_model: usize,
    /// Of a head.
    width: usize,
    mask: Mask,
    dropout: Option<&'a DropoutMask>,
}

/// What one task writes to before it writes its results.
#[derive(Default)]
struct Scratch {
    /// Rows of P.
    probabilities: Vec<f32>,
    /// Rows of M and of M P, with a dropout.
    factors: Vec<f32>,
    masked: Vec<f32>,
    /// Rows of dP, then dS.
    scores: Vec<f32>,
    /// Rows of K.
    keys: Panels,
    /// Columns of K and V.
    key_columns: Panels,
    value_columns: Panels,
    d_key: Vec<f32>,
    d_value: Vec<f32>,
}

impl Attention {
    fn extents(&self, query: &Array, key: &Array) -> Extents<'_> {
        let [.., tokens, d_model] = *query.shape() else { unreachable!("of rank 3") };
        let [.., sources, _] = *key.shape() else { unreachable!("of rank 3") };
        let (width, dropout) = (d_model / self.heads, self.dropout.as_ref());
        Extents { tokens, sources, d_model, width, mask: self.mask, dropout }
    }
}

impl Extents<'_> {
    fn scale(&self) -> f32 {
        1.0 / (self.width as f32).sqrt()
    }

    /// How many sources a token may look at, those beyond the last included.
    fn visible(&self, token: usize) -> usize {
        match self.mask {
            Mask::None => self.sources,
            Mask::Causal { ahead } => token.saturating_add(ahead).saturating_add(1),
        }
    }

    /// How many sources the tokens up to `end` may look at.
    fn seen(&self, end: usize) -> usize {
        self.visible(end - 1).min(self.sources)
    }

    /// Leaves out numbers of rows of P, each `seen` long, from that of token `first` on, of the head that
    /// begins with `channel`.
    fn drop_out(
        &self,
        mask: &DropoutMask,
        [trajectory, channel, first]: [usize; 3],
        rows: &mut [f32],
        seen: usize,
    ) {
        let heads = self.d_model / self.width;
        let head = trajectory * heads + channel / self.width;
        mask.apply(rows, seen, head * self.tokens + first, heads * self.tokens);
    }

    /// Rows of P of the tokens from `first` on; each as long as the last one sees. `query` begins
    /// with the first token, at the head's first channel.
    fn probabilities(&self, query: Left<'_>, keys: &Panels, first: usize, into: &mut Vec<f32>) {
        let count = query.rows.len();
        let seen = self.seen(first + count);
        into.resize(count * seen, 0.0);
        keys.multiply_part(query, [self.width, seen], Onto::Nothing, into, seen);
        softmax(into, seen, self.scale(), self.visible(first));
    }

    /// O of the trajectory's tokens from `first` on.
    fn forward(
        &self,
        query: &[f32],
        value: &[f32],
        keys: &[Panels],
        [trajectory, first]: [usize; 2],
        output: &mut [f32],
        probabilities: &mut Vec<f32>,
    ) {
        let Self { d_model, width, .. } = *self;
        let count = output.len() / d_model;
        let rows = multiples(count, d_model);
        let seen = self.seen(first + count);
        let (of_p, of_value) = (multiples(count, seen), multiples(seen, d_model));
        for (head, keys) in (0..d_model).step_by(width).zip(keys) {
            let query = Left { values: &query[head..], rows: &rows, step: 1 };
            self.probabilities(query, keys, first, probabilities);
            if let Some(mask) = self.dropout {
                self.drop_out(mask, [trajectory, head, first], probabilities, seen);
            }
            let p = Left { values: probabilities, rows: &of_p, step: 1 };
            let value = Right { values: &value[head..], terms: &of_value };
            multiply(p, value, Onto::Nothing, &mut output[head..], width, d_model);
        }
    }

    /// dQ, dK and dV of a trajectory's head, at whose first channel everything begins.
    fn backward(
        &self,
        [trajectory, head]: [usize; 2],
        [query, key, value, d_output]: [&[f32]; 4],
        [d_query, d_key, d_value]: [&mut [f32]; 3],
        scratch: &mut Scratch,
    ) {
        let Self { tokens, sources, d_model, width, .. } = *self;
        scratch.keys.write_rows(key, sources, width, d_model);
        scratch.key_columns.write_columns(key, width, sources, d_model);
        scratch.value_columns.write_columns(value, width, sources, d_model);
        for sums in [&mut scratch.d_key, &mut scratch.d_value] {
            sums.clear();
            sums.resize(sources * width, 0.0);
        }
        for first in (0..tokens).step_by(TOKENS) {
            let count = TOKENS.min(tokens - first);
            let seen = self.seen(first + count);
            let (rows, of_p) = (multiples(count, d_model), multiples(count, seen));
            let each: Vec<usize> = (0..seen).collect();
            let query = &query[first * d_model..];
            let d_output = &d_output[first * d_model..];

            let of_query = Left { values: query, rows: &rows, step: 1 };
            self.probabilities(of_query, &scratch.key_columns, first, &mut scratch.probabilities);
            let probabilities = match self.dropout {
                None => &scratch.probabilities,
                Some(mask) => {
                    scratch.factors.clear();
                    scratch.factors.resize(count * seen, 1.0);
                    self.drop_out(mask, [trajectory, head, first], &mut scratch.factors, seen);
                    scratch.masked.clone_from(&scratch.probabilities);
                    vectorized::multiply(&mut scratch.masked, &scratch.factors);
                    &scratch.masked
                }
            };
            let p = Left { values: probabilities, rows: &each, step: seen };
            let of_output = Right { values: d_output, terms: &rows };
            multiply(p, of_output, Onto::Output, &mut scratch.d_value, width, width);

            scratch.scores.resize(count * seen, 0.0);
            let of_output = Left { values: d_output, rows: &rows, step: 1 };
            let extent = [width, seen];
            let scores = &mut scratch.scores;
            scratch.value_columns.multiply_part(of_output, extent, Onto::Nothing, scores, seen);
            if self.dropout.is_some() {
                vectorized::multiply(scores, &scratch.factors);
            }
            softmax_gradient(&scratch.probabilities, seen, self.scale(), scores);

            let ds = Left { values: scores, rows: &of_p, step: 1 };
            let d_query = &mut d_query[first * d_model..];
            scratch.keys.multiply_part(ds, [seen, width], Onto::Nothing, d_query, d_model);
            let ds = Left { values: scores, rows: &each, step: seen };
            let of_query = Right { values: query, terms: &rows };
            multiply(ds, of_query, Onto::Output, &mut scratch.d_key, width, width);
        }
        for (sums, gradient) in [(&scratch.d_key, d_key), (&scratch.d_value, d_value)] {
            for (row, sums) in gradient.chunks_mut(d_model).zip(sums.chunks_exact(width)) {
                row[..width].copy_from_slice(sums);
            }
        }
    }
}

impl FusedOp<3> for Attention {
    fn forward(&self, [query, key, value]: &[Array; 3]) -> Array {
        let extents = self.extents(query, key);
        let Extents { tokens, sources, d_model, width, .. } = extents;
        let (of_query, of_key) = (tokens * d_model, sources * d_model);
        let (output, _) = in_parts(
            query.values().len(),
            of_query,
            || (),
            |(), index, output| {
                let query = &query.values()[index * of_query..][..of_query];
                let key = &key.values()[index * of_key..][..of_key];
                let value = &value.values()[index * of_key..][..of_key];
                let keys: Vec<Panels> = (0..d_model)
                    .step_by(width)
                    .map(|head| Panels::of_columns(&key[head..], width, sources, d_model))
                    .collect();
                output
                    .par_chunks_mut(TOKENS * d_model)
                    .zip(query.par_chunks(TOKENS * d_model))
                    .enumerate()
                    .for_each_init(Vec::new, |probabilities, (part, (output, query))| {
                        let first = [index, part * TOKENS];
                        extents.forward(query, value, &keys, first, output, probabilities);
                    });
            },
        );
        Array::new(output, query.shape())
    }

    fn backward(&self, [query, key, value]: &[Array; 3], gradient: &Array) -> [Array; 3] {
        let extents = self.extents(query, key);
        let Extents { tokens, sources, d_model, width, .. } = extents;
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
        let tasks = inputs.zip(outputs).enumerate();
        tasks.for_each_init(Scratch::default, |scratch, (trajectory, (inputs, outputs))| {
            let (((query, key), value), gradient) = inputs;
            let ((d_query, d_key), d_value) = outputs;
            for head in (0..d_model).step_by(width) {
                let inputs = [query, key, value, gradient].map(|series| &series[head..]);
                let outputs = [&mut d_query[head..], &mut d_key[head..], &mut d_value[head..]];
                extents.backward([trajectory, head], inputs, outputs, scratch);
            }
        });
        [
            Array::new(d_query, query.shape()),
            Array::new(d_key, key.shape()),
            Array::new(d_value, value.shape()),
        ]
    }
}

/// Where rows begin that are `stride` apart.
fn multiples(count: usize, stride: usize) -> Vec<usize> {
    (0..count).map(|row| row * stride).collect()
}
