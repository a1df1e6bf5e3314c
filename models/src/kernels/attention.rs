use burn::tensor::{Bool, Tensor, activation};

/// Which source tokens a token may look at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mask {
    /// All.
    None,
    /// Itself and those before.
    Causal,
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
    let [batch, tokens, d_model] = query.dims();
    let [_, sources, _] = key.dims();
    let width = d_model / heads;
    let split = |x: Tensor<3>, length| x.reshape([batch, length, heads, width]).swap_dims(1, 2);

    let scores =
        split(query, tokens).matmul(split(key, sources).transpose()) / (width as f32).sqrt();
    let visible = match mask {
        Mask::None => scores,
        Mask::Causal => {
            let future = Tensor::<2, Bool>::tril_mask([tokens, sources], 0, &scores.device());
            scores.mask_fill(future.unsqueeze::<4>(), f32::NEG_INFINITY)
        }
    };
    let mixed = activation::softmax(visible, 3).matmul(split(value, sources));
    mixed.swap_dims(1, 2).reshape([batch, tokens, d_model])
}
