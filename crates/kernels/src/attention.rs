//! Multi-head attention of queries to keys and values, without the matrix of weights in memory.

use burn::tensor::{Bool, Tensor, TensorData, activation};
use rayon::prelude::*;

use super::dropout::{self, DropoutMask};
use super::factors::Factors;
use super::fused::{Array, FusedOp, apply, operand};
use super::panels::{Panels, multiples};
use super::parts::in_parts;
use super::product::{Left, Offsets, Onto};
use super::softmax::{softmax, softmax_gradient};
use super::vectorized;

/// The source tokens that a token may attend to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mask {
    /// All source tokens.
    None,
    /// Token t attends to the sources up to t + `ahead`. With 0 these are itself and those before.
    Causal {
        /// Sources beyond its own that a token sees.
        ahead: usize,
    },
    /// The first `length` tokens attend to each other. Later tokens attend to these and to all
    /// tokens up to themselves (a prefix language model, Raffel et al. 2020).
    Prefix {
        /// Tokens of the prefix.
        length: usize,
    },
}

/// softmax(Q Kᵀ / √width) V for each head. A head is `width = d_model / heads` neighbouring
/// channels. query `[batch, token, d_model]`, key and value `[batch, source, d_model]`. The result
/// has the shape of query. `dropout` applies to the softmax. Products read `factors`.
pub fn attention(
    query: Tensor<3>,
    key: Tensor<3>,
    value: Tensor<3>,
    heads: usize,
    mask: Mask,
    dropout: Option<DropoutMask>,
    factors: Factors,
) -> Tensor<3> {
    let operands = [operand(&query), operand(&key), operand(&value)];
    let op = Attention { heads, mask, dropout, factors };
    apply(op.clone(), operands)
        .unwrap_or_else(|| plain(query, key, value, heads, mask, op.dropout.as_ref()))
}

/// [`attention`] of a series to itself: `projected` `[batch, token, 3 d_model]` has query, key and
/// value side by side. The result is `[batch, token, d_model]`.
pub fn self_attention(
    projected: Tensor<3>,
    heads: usize,
    mask: Mask,
    dropout: Option<DropoutMask>,
    factors: Factors,
) -> Tensor<3> {
    let op = Attention { heads, mask, dropout, factors };
    apply(op.clone(), [operand(&projected)])
        .unwrap_or_else(|| plain_of_itself(projected, heads, mask, op.dropout.as_ref()))
}

pub(super) fn plain_of_itself(
    projected: Tensor<3>,
    heads: usize,
    mask: Mask,
    dropout: Option<&DropoutMask>,
) -> Tensor<3> {
    let parts = projected.chunk(3, 2).try_into();
    let [query, key, value] = parts.expect("three of the same width");
    plain(query, key, value, heads, mask, dropout)
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
    let future = match mask {
        Mask::None => None,
        Mask::Causal { ahead } => {
            let ahead = i64::try_from(ahead).unwrap_or(i64::MAX);
            Some(Tensor::<2, Bool>::tril_mask([tokens, sources], ahead, &scores.device()))
        }
        Mask::Prefix { length } => {
            let is_hidden = |at: usize| at % sources > (at / sources).max(length.saturating_sub(1));
            let hidden: Vec<bool> = (0..tokens * sources).map(is_hidden).collect();
            Some(Tensor::from_data(TensorData::new(hidden, [tokens, sources]), &scores.device()))
        }
    };
    let visible = match future {
        Some(future) => scores.mask_fill(future.unsqueeze::<4>(), f32::NEG_INFINITY),
        None => scores,
    };
    let p = dropout::plain(activation::softmax(visible, 3), dropout);
    let mixed = p.matmul(split(value, sources));
    mixed.swap_dims(1, 2).reshape([batch, tokens, d_model])
}

/// With P = softmax(S), S = Q Kᵀ / √width and O = P V:
/// dV = Pᵀ dO, dP = dO Vᵀ, dS = P (dP - Σ P dP), dQ = dS K / √width, dK = dSᵀ Q / √width.
/// With a dropout mask M, O = (M P) V, dV = (M P)ᵀ dO and dP = M (dO Vᵀ).
///
/// A block of rows of P is computed at a time and stays in a core's cache. The backward pass
/// computes it again, as in FlashAttention (Dao et al. 2022), because P is by far the largest array
/// and quick to compute. Masked blocks are skipped. The backward pass has a task per trajectory,
/// since dK and dV are sums over tokens.
#[derive(Clone, Debug)]
pub(super) struct Attention {
    pub heads: usize,
    pub mask: Mask,
    pub dropout: Option<DropoutMask>,
    pub factors: Factors,
}

/// Tokens in a block of rows of P: a multiple of a register tile's rows.
const TOKENS: usize = 48;

/// Extents of one trajectory's arrays.
#[derive(Clone, Copy)]
struct Extents<'a> {
    tokens: usize,
    sources: usize,
    d_model: usize,
    /// Width of a head.
    width: usize,
    /// Row strides of queries, keys and values, and of their gradients.
    strides: [usize; 3],
    mask: Mask,
    dropout: Option<&'a DropoutMask>,
    factors: Factors,
}

/// Buffers of a task.
struct Scratch {
    /// Rows of P.
    probabilities: Vec<f32>,
    /// Rows of M and of M P, if there is a dropout.
    kept: Vec<f32>,
    masked: Vec<f32>,
    /// Rows of dP, then dS.
    scores: Vec<f32>,
    /// Panels of the rows of K, and of a block of rows of Q and of dO.
    keys: Panels,
    queries: Panels,
    d_outputs: Panels,
    /// Panels of the columns of K and V.
    key_columns: Panels,
    value_columns: Panels,
    d_key: Vec<f32>,
    d_value: Vec<f32>,
}

impl Scratch {
    fn new(factors: Factors) -> Self {
        let panels = || Panels::new(factors);
        Self {
            probabilities: Vec::new(),
            kept: Vec::new(),
            masked: Vec::new(),
            scores: Vec::new(),
            keys: panels(),
            queries: panels(),
            d_outputs: panels(),
            key_columns: panels(),
            value_columns: panels(),
            d_key: Vec::new(),
            d_value: Vec::new(),
        }
    }
}

impl Attention {
    fn extents(
        &self,
        tokens: usize,
        sources: usize,
        strides: [usize; 3],
        d_model: usize,
    ) -> Extents<'_> {
        let (width, dropout) = (d_model / self.heads, self.dropout.as_ref());
        let (mask, factors) = (self.mask, self.factors);
        Extents { tokens, sources, d_model, width, strides, mask, dropout, factors }
    }

    /// The extents for three separate arrays.
    fn apart(&self, query: &Array, key: &Array) -> Extents<'_> {
        let [_, tokens, d_model] = *query.shape() else { unreachable!("of rank 3") };
        let [_, sources, _] = *key.shape() else { unreachable!("of rank 3") };
        self.extents(tokens, sources, [d_model; 3], d_model)
    }

    /// The extents for one array with the three side by side.
    fn side_by_side(&self, projected: &Array) -> Extents<'_> {
        let [_, tokens, width] = *projected.shape() else { unreachable!("of rank 3") };
        self.extents(tokens, tokens, [width; 3], width / 3)
    }
}

impl Extents<'_> {
    fn scale(&self) -> f32 {
        1.0 / (self.width as f32).sqrt()
    }

    /// Number of sources that a token may attend to, including those beyond the last.
    fn visible(&self, token: usize) -> usize {
        match self.mask {
            Mask::None => self.sources,
            Mask::Causal { ahead } => token.saturating_add(ahead).saturating_add(1),
            Mask::Prefix { length } => token.saturating_add(1).max(length),
        }
    }

    /// Number of tokens, of `count` from `first` on, that attend to as many sources as the first
    /// one. Each later token attends to one source more than the token before it.
    fn alike(&self, first: usize, count: usize) -> usize {
        match self.mask {
            // 0, so that all rows go into one call of softmax.
            Mask::None | Mask::Causal { .. } => 0,
            Mask::Prefix { length } => length.saturating_sub(first).min(count),
        }
    }

    /// Number of sources that the tokens before `end` attend to.
    fn seen(&self, end: usize) -> usize {
        self.visible(end - 1).min(self.sources)
    }

    /// Applies dropout to rows of P, each `seen` long. `first` is the token of the first row, and
    /// `channel` is the first channel of the head.
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

    /// Rows of P of the tokens from `first` on. All have the length of the last one. `query` begins
    /// with the first token, at the head's first channel.
    fn probabilities(&self, query: Left<'_>, keys: &Panels, first: usize, into: &mut Vec<f32>) {
        let count = query.rows.count();
        let seen = self.seen(first + count);
        into.resize(count * seen, 0.0);
        keys.multiply_part(query, [self.width, seen], Onto::Nothing, into, seen);
        let alike = self.alike(first, count);
        let (same, rising) = into.split_at_mut(alike * seen);
        for row in same.chunks_exact_mut(seen) {
            softmax(row, seen, self.scale(), self.visible(first));
        }
        softmax(rising, seen, self.scale(), self.visible(first + alike));
    }

    /// O of all trajectories. `of` gives the queries, keys and values of a trajectory.
    fn forward<'b>(
        &self,
        batch: usize,
        of: impl Fn(usize) -> [&'b [f32]; 3] + Sync + Send,
    ) -> Array {
        let Self { tokens, sources, d_model, width, strides, factors, .. } = *self;
        let part = tokens * d_model;
        let heads = || {
            let panels = || (Panels::new(factors), Panels::new(factors));
            (0..d_model / width).map(|_| panels()).collect::<Vec<_>>()
        };
        let (output, _) = in_parts(batch * part, part, heads, |heads, index, output| {
            let [query, key, value] = of(index);
            for (head, (keys, values)) in (0..d_model).step_by(width).zip(heads.iter_mut()) {
                keys.write_columns(&key[head..], [width, sources], strides[1]);
                values.write_rows(&value[head..], [sources, width], strides[2]);
            }
            let heads = &heads[..];
            output
                .par_chunks_mut(TOKENS * d_model)
                .zip(query.par_chunks(TOKENS * strides[0]))
                .enumerate()
                .for_each_init(Vec::new, |probabilities, (part, (output, query))| {
                    let first = [index, part * TOKENS];
                    self.rows(query, heads, first, output, probabilities);
                });
        });
        Array::new(output, &[batch, tokens, d_model])
    }

    /// O of the trajectory's tokens from `first` on. `heads` has the panels of the columns of K and
    /// of the rows of V.
    fn rows(
        &self,
        query: &[f32],
        heads: &[(Panels, Panels)],
        [trajectory, first]: [usize; 2],
        output: &mut [f32],
        probabilities: &mut Vec<f32>,
    ) {
        let Self { d_model, width, strides, .. } = *self;
        let count = output.len() / d_model;
        let rows = multiples(count, strides[0]);
        let seen = self.seen(first + count);
        let of_p = multiples(count, seen);
        let (rows, of_p) = (Offsets::of(&rows), Offsets::of(&of_p));
        for (head, (keys, values)) in (0..d_model).step_by(width).zip(heads) {
            let query = Left { values: &query[head..], rows, step: 1 };
            self.probabilities(query, keys, first, probabilities);
            if let Some(mask) = self.dropout {
                self.drop_out(mask, [trajectory, head, first], probabilities, seen);
            }
            let p = Left { values: probabilities, rows: of_p, step: 1 };
            values.multiply_part(p, [seen, width], Onto::Nothing, &mut output[head..], d_model);
        }
    }

    /// dQ, dK and dV of a trajectory's head. All inputs begin at the head's first channel. `places`
    /// are the places of the results in `gradients`.
    fn backward(
        &self,
        [trajectory, head]: [usize; 2],
        [query, key, value, d_output]: [&[f32]; 4],
        gradients: &mut [&mut [f32]],
        places: [Place; 3],
        scratch: &mut Scratch,
    ) {
        let Self { tokens, sources, d_model, width, strides, .. } = *self;
        let [of_query, of_key, of_value] = places;
        scratch.keys.write_rows(key, [sources, width], strides[1]);
        scratch.key_columns.write_columns(key, [width, sources], strides[1]);
        scratch.value_columns.write_columns(value, [width, sources], strides[2]);
        for sums in [&mut scratch.d_key, &mut scratch.d_value] {
            sums.clear();
            sums.resize(sources * width, 0.0);
        }
        for first in (0..tokens).step_by(TOKENS) {
            let count = TOKENS.min(tokens - first);
            let seen = self.seen(first + count);
            let (rows, of_p) = (multiples(count, d_model), multiples(count, seen));
            let query_rows = multiples(count, strides[0]);
            let each = multiples(seen, 1);
            let (rows, of_p) = (Offsets::of(&rows), Offsets::of(&of_p));
            let (query_rows, each) = (Offsets::of(&query_rows), Offsets::of(&each));
            let query = &query[first * strides[0]..];
            let d_output = &d_output[first * d_model..];

            let left = Left { values: query, rows: query_rows, step: 1 };
            self.probabilities(left, &scratch.key_columns, first, &mut scratch.probabilities);
            let probabilities = match self.dropout {
                None => &scratch.probabilities,
                Some(mask) => {
                    scratch.kept.clear();
                    scratch.kept.resize(count * seen, 1.0);
                    self.drop_out(mask, [trajectory, head, first], &mut scratch.kept, seen);
                    scratch.masked.clone_from(&scratch.probabilities);
                    vectorized::multiply(&mut scratch.masked, &scratch.kept);
                    &scratch.masked
                }
            };
            let p = Left { values: probabilities, rows: each, step: seen };
            scratch.d_outputs.write_rows(d_output, [count, width], d_model);
            scratch.d_outputs.multiply(p, Onto::Output, &mut scratch.d_value, width);

            scratch.scores.resize(count * seen, 0.0);
            let left = Left { values: d_output, rows, step: 1 };
            let extent = [width, seen];
            let scores = &mut scratch.scores;
            scratch.value_columns.multiply_part(left, extent, Onto::Nothing, scores, seen);
            if self.dropout.is_some() {
                vectorized::multiply(scores, &scratch.kept);
            }
            softmax_gradient(&scratch.probabilities, seen, self.scale(), scores);

            let ds = Left { values: scores, rows: of_p, step: 1 };
            let d_query = &mut of_query.begin(gradients, head)[first * strides[0]..];
            scratch.keys.multiply_part(ds, [seen, width], Onto::Nothing, d_query, strides[0]);
            let ds = Left { values: scores, rows: each, step: seen };
            scratch.queries.write_rows(query, [count, width], strides[0]);
            scratch.queries.multiply(ds, Onto::Output, &mut scratch.d_key, width);
        }
        let sums = [(&scratch.d_key, of_key, strides[1]), (&scratch.d_value, of_value, strides[2])];
        for (sums, place, stride) in sums {
            let gradient = place.begin(gradients, head);
            for (row, sums) in gradient.chunks_mut(stride).zip(sums.chunks_exact(width)) {
                row[..width].copy_from_slice(sums);
            }
        }
    }

    /// [`Extents::backward`] of all heads of a trajectory.
    fn backward_of_heads(
        &self,
        trajectory: usize,
        inputs: [&[f32]; 4],
        gradients: &mut [&mut [f32]],
        places: [Place; 3],
        scratch: &mut Scratch,
    ) {
        for head in (0..self.d_model).step_by(self.width) {
            let inputs = inputs.map(|series| &series[head..]);
            self.backward([trajectory, head], inputs, gradients, places, scratch);
        }
    }
}

/// The place of a gradient in the arrays.
#[derive(Clone, Copy)]
struct Place {
    array: usize,
    /// Its first channel.
    channel: usize,
}

impl Place {
    /// The rest of the array from a head's first channel on.
    fn begin<'a>(self, arrays: &'a mut [&mut [f32]], head: usize) -> &'a mut [f32] {
        &mut arrays[self.array][self.channel + head..]
    }
}

impl FusedOp<3> for Attention {
    fn forward(&self, [query, key, value]: &[Array; 3]) -> Array {
        let extents = self.apart(query, key);
        let batch = query.shape()[0];
        let series = [query, key, value].map(Array::values);
        extents.forward(batch, |index| series.map(|values| nth(values, batch, index)))
    }

    fn backward(&self, [query, key, value]: &[Array; 3], gradient: &Array) -> [Array; 3] {
        let extents = self.apart(query, key);
        let batch = query.shape()[0];
        let places = [0, 1, 2].map(|array| Place { array, channel: 0 });
        let inputs = [query, key, value, gradient].map(Array::values);
        let part = |array: &Array| array.values().len() / batch;
        let mut d_query = vec![0.0; query.values().len()];
        let mut d_key = vec![0.0; key.values().len()];
        let mut d_value = vec![0.0; value.values().len()];
        let outputs = d_query
            .par_chunks_mut(part(query))
            .zip(d_key.par_chunks_mut(part(key)))
            .zip(d_value.par_chunks_mut(part(value)))
            .enumerate();
        let scratch = || Scratch::new(self.factors);
        outputs.for_each_init(scratch, |scratch, (index, ((d_query, d_key), d_value))| {
            let inputs = inputs.map(|values| nth(values, batch, index));
            let outputs = &mut [d_query, d_key, d_value];
            extents.backward_of_heads(index, inputs, outputs, places, scratch);
        });
        [
            Array::new(d_query, query.shape()),
            Array::new(d_key, key.shape()),
            Array::new(d_value, value.shape()),
        ]
    }
}

impl FusedOp<1> for Attention {
    fn forward(&self, [projected]: &[Array; 1]) -> Array {
        let extents = self.side_by_side(projected);
        let batch = projected.shape()[0];
        extents.forward(batch, |index| {
            let series = nth(projected.values(), batch, index);
            [0, 1, 2].map(|part| &series[part * extents.d_model..])
        })
    }

    fn backward(&self, [projected]: &[Array; 1], gradient: &Array) -> [Array; 1] {
        let extents = self.side_by_side(projected);
        let batch = projected.shape()[0];
        let places = [0, 1, 2].map(|part| Place { array: 0, channel: part * extents.d_model });
        let length = projected.values().len();
        let (d_projected, _) = in_parts(
            length,
            length / batch,
            || Scratch::new(self.factors),
            |scratch, index, output| {
                let series = nth(projected.values(), batch, index);
                let [query, key, value] = [0, 1, 2].map(|part| &series[part * extents.d_model..]);
                let inputs = [query, key, value, nth(gradient.values(), batch, index)];
                extents.backward_of_heads(index, inputs, &mut [output], places, scratch);
            },
        );
        [Array::new(d_projected, projected.shape())]
    }
}

/// A trajectory's part of `values`.
fn nth(values: &[f32], batch: usize, index: usize) -> &[f32] {
    let part = values.len() / batch;
    &values[index * part..][..part]
}
