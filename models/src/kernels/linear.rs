use burn::tensor::Tensor;

/// `x Wᵀ + b` for x `[batch, token, input]`, W `[output, input]`, b `[output]`.
pub(crate) fn linear(x: Tensor<3>, weight: Tensor<2>, bias: Tensor<1>) -> Tensor<3> {
    let [batch, tokens, input] = x.dims();
    let [output, _] = weight.dims();
    let rows = x.reshape([batch * tokens, input]).matmul(weight.transpose()) + bias.unsqueeze();
    rows.reshape([batch, tokens, output])
}
