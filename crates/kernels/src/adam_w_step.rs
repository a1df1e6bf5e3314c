//! The constants of a step of AdamW.

/// A step of AdamW (Loshchilov and Hutter 2019), the same for every parameter.
#[derive(Clone, Copy, Debug)]
pub struct AdamWStep {
    /// The number of the step. The first one is 1.
    pub time: usize,
    /// Factor of the gradient. It is applied first.
    pub scale: f64,
    /// The learning rate.
    pub learning_rate: f64,
    /// β₁ and β₂: the decay of the averages of the gradient and of its square.
    pub betas: [f64; 2],
    /// ε, which keeps the division finite.
    pub epsilon: f64,
    /// The share of a weight that a step takes away, divided by the learning rate.
    pub weight_decay: f64,
}

/// The numbers of an [`AdamWStep`] that its loop reads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constants {
    pub scale: f32,
    pub betas: [f32; 2],
    pub epsilon: f32,
    /// 1 / (1 - β₂ᵗ), the bias correction of the second moment.
    pub second_correction: f32,
    /// Learning rate / (1 - β₁ᵗ).
    pub rate: f32,
    /// 1 - learning rate · weight decay.
    pub keep: f32,
}

impl AdamWStep {
    #[expect(clippy::cast_possible_truncation, reason = "weights are updated in f32")]
    pub(super) fn constants(&self) -> Constants {
        let [beta_1, beta_2] = self.betas;
        let time = i32::try_from(self.time).unwrap_or(i32::MAX);
        Constants {
            scale: self.scale as f32,
            betas: self.betas.map(|beta| beta as f32),
            epsilon: self.epsilon as f32,
            second_correction: (1.0 / (1.0 - beta_2.powi(time))) as f32,
            rate: (self.learning_rate / (1.0 - beta_1.powi(time))) as f32,
            keep: (1.0 - self.learning_rate * self.weight_decay) as f32,
        }
    }
}
