use crate::{
    CdcnnSpec, CdtSpec, Conditioning, DiffuserSpec, FlowSpec, Head, JOINTS, ModelSpec,
    RoboMorphSpec,
};

const CHANNELS: u64 = JOINTS as u64;
/// Of the convolutions inside the blocks of a U-Net.
const KERNEL: u64 = 5;
/// Of the tiles that these convolutions are computed in.
const POINTS: u64 = 8;

/// Numbers of a model, counted along its layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Tally {
    /// That it has to learn.
    pub parameters: u64,
    /// That a step keeps of one trajectory, from the way there for the way back: what layers were
    /// given and what their derivatives ask for, each array once. Sums keep nothing.
    pub kept: u64,
    /// That a step works with beside, whatever its batch: the largest kernel of a convolution that goes by
    /// tiles, at their points, and its derivative there.
    pub scratch: u64,
}

/// What a condition does to the channels of a block.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Modulation {
    Shift,
    ScaleAndShift,
}

impl Tally {
    pub fn of(model: &ModelSpec, context: u32, horizon: u32) -> Self {
        let (context, horizon) = (u64::from(context), u64::from(horizon));
        let mut tally = Self::default();
        match model {
            ModelSpec::RoboMorph(spec) => tally.robomorph(spec, context, horizon),
            ModelSpec::Diffuser(spec) => tally.diffuser(spec, context + horizon),
            ModelSpec::Cdcnn(spec) => tally.cdcnn(spec, context + horizon),
            ModelSpec::Cdt(spec) => tally.cdt(spec, context + horizon),
            ModelSpec::Flow(spec) => tally.flow(spec, context + horizon),
        }
        tally
    }

    fn robomorph(&mut self, spec: &RoboMorphSpec, context: u64, horizon: u64) {
        let (width, patch) = (u64::from(spec.d_model), u64::from(spec.patch.max(1)));
        let hidden = width * u64::from(spec.mlp_ratio);
        let (sources, tokens) = (context / patch, horizon / patch);
        let per_position = match spec.head {
            Head::Point => 1,
            Head::Gaussian => 2,
        };
        self.embedding(sources, 2 * CHANNELS * patch, width);
        for _ in 0..spec.encoder_layers {
            self.encoder_block(sources, width, hidden);
        }
        self.norm(sources, width);
        self.embedding(tokens, CHANNELS * patch, width);
        for _ in 0..spec.decoder_layers {
            self.decoder_block(tokens, sources, width, hidden);
        }
        self.norm(tokens, width);
        self.linear(width, per_position * CHANNELS * patch);
        self.kept += 2 * per_position * CHANNELS * horizon;
    }

    fn cdt(&mut self, spec: &CdtSpec, samples: u64) {
        let width = u64::from(spec.d_model);
        let hidden = width * u64::from(spec.mlp_ratio);
        let sources = samples + 1;
        self.embedding(samples, CHANNELS, width);
        self.parameters += width;
        for _ in 0..spec.encoder_layers {
            self.encoder_block(sources, width, hidden);
        }
        self.embedding(samples, CHANNELS, width);
        for _ in 0..spec.decoder_layers {
            self.decoder_block(samples, sources, width, hidden);
        }
        self.norm(samples, width);
        self.linear(width, CHANNELS);
        self.kept += 2 * CHANNELS * samples;
    }

    fn diffuser(&mut self, spec: &DiffuserSpec, samples: u64) {
        let width = u64::from(spec.width);
        let widths: Vec<u64> = spec.multipliers.iter().map(|&by| width * u64::from(by)).collect();
        self.level_embedding(width);
        self.unet(2 * CHANNELS, &widths, width, Modulation::Shift, samples);
    }

    fn cdcnn(&mut self, spec: &CdcnnSpec, samples: u64) {
        let widths: Vec<u64> = spec.widths.iter().map(|&width| u64::from(width)).collect();
        let embedding = u64::from(spec.embedding);
        self.level_embedding(embedding);
        let condition = match spec.conditioning {
            Conditioning::Local => embedding,
            Conditioning::Global => embedding + samples * CHANNELS,
        };
        if spec.conditioning == Conditioning::Local {
            self.local_condition(CHANNELS, &widths, condition, samples);
        }
        self.unet(CHANNELS, &widths, condition, Modulation::ScaleAndShift, samples);
    }

    fn flow(&mut self, spec: &FlowSpec, samples: u64) {
        let widths: Vec<u64> = spec.widths.iter().map(|&width| u64::from(width)).collect();
        let embedding = u64::from(spec.embedding);
        self.level_embedding(embedding);
        self.local_condition(2 * CHANNELS, &widths, embedding, samples);
        self.unet(CHANNELS, &widths, embedding, Modulation::ScaleAndShift, samples);
    }

    /// The block of what is known sample by sample.
    fn local_condition(&mut self, channels: u64, widths: &[u64], condition: u64, samples: u64) {
        if let Some(&first) = widths.first() {
            self.residual_block(channels, first, condition, Modulation::ScaleAndShift, samples);
        }
    }

    fn unet(
        &mut self,
        channels: u64,
        widths: &[u64],
        condition: u64,
        modulation: Modulation,
        samples: u64,
    ) {
        let mut input = channels;
        let mut length = samples;
        for (stage, &width) in widths.iter().enumerate() {
            self.residual_block(input, width, condition, modulation, length);
            self.residual_block(width, width, condition, modulation, length);
            if stage + 1 < widths.len() {
                length /= 2;
                self.convolution(width, width, 3);
                self.kept += width * length;
            }
            input = width;
        }
        for _ in 0..2 {
            self.residual_block(input, input, condition, modulation, length);
        }
        for pair in widths.windows(2).rev() {
            let (output, input) = (pair[0], pair[1]);
            // The series beside that of the stage down.
            self.kept += 2 * input * length;
            self.residual_block(2 * input, output, condition, modulation, length);
            self.residual_block(output, output, condition, modulation, length);
            self.convolution(output, output, 4);
            length *= 2;
            self.kept += output * length;
        }
        let first = widths.first().copied().unwrap_or(channels);
        self.convolution(first, first, KERNEL);
        self.parameters += 2 * first;
        self.kept += 2 * first * samples;
        self.convolution(first, channels, 1);
        self.kept += 2 * channels * samples;
    }

    /// What is conditioned passes two convolutions, each with a norm.
    fn residual_block(
        &mut self,
        input: u64,
        output: u64,
        condition: u64,
        modulation: Modulation,
        samples: u64,
    ) {
        self.convolution(input, output, KERNEL);
        self.convolution(output, output, KERNEL);
        self.parameters += 4 * output;
        let numbers = match modulation {
            Modulation::Shift => output,
            Modulation::ScaleAndShift => 2 * output,
        };
        self.linear(condition, numbers);
        self.kept += condition + numbers;
        if input != output {
            self.convolution(input, output, 1);
        }
        // Both convolutions' answers, what the second is given, the sum with what came in; to scale,
        // what is scaled.
        let arrays = match modulation {
            Modulation::Shift => 4,
            Modulation::ScaleAndShift => 5,
        };
        self.kept += arrays * output * samples;
    }

    fn level_embedding(&mut self, width: u64) {
        self.linear(width, 4 * width);
        self.linear(4 * width, width);
        self.kept += 10 * width;
    }

    fn encoder_block(&mut self, tokens: u64, width: u64, hidden: u64) {
        self.normed_inside(width);
        self.attention(tokens, tokens, width);
        self.feed_forward(tokens, width, hidden);
        self.kept += 2 * tokens * width;
    }

    fn decoder_block(&mut self, tokens: u64, sources: u64, width: u64, hidden: u64) {
        self.normed_inside(width);
        self.attention(tokens, tokens, width);
        self.normed_inside(width);
        self.attention(tokens, sources, width);
        self.feed_forward(tokens, width, hidden);
        self.kept += 3 * tokens * width;
    }

    /// A norm that the maps after it make again.
    fn normed_inside(&mut self, width: u64) {
        self.parameters += 2 * width;
    }

    /// Keeps queries, keys, values and what they mix.
    fn attention(&mut self, tokens: u64, sources: u64, width: u64) {
        for _ in 0..4 {
            self.linear(width, width);
        }
        self.kept += 2 * (tokens + sources) * width;
    }

    /// Keeps what the GELU is given; the norm before and what comes of the GELU are made again.
    fn feed_forward(&mut self, tokens: u64, width: u64, hidden: u64) {
        self.normed_inside(width);
        self.linear(width, hidden);
        self.linear(hidden, width);
        self.kept += tokens * hidden;
    }

    /// A map to the width of the tokens, and their positions.
    fn embedding(&mut self, tokens: u64, input: u64, width: u64) {
        self.linear(input, width);
        self.parameters += tokens * width;
        self.kept += tokens * (input + width);
    }

    fn norm(&mut self, tokens: u64, width: u64) {
        self.parameters += 2 * width;
        self.kept += tokens * width;
    }

    fn linear(&mut self, input: u64, output: u64) {
        self.parameters += (input + 1) * output;
    }

    fn convolution(&mut self, input: u64, output: u64, kernel: u64) {
        self.parameters += (input * kernel + 1) * output;
        if kernel == KERNEL {
            self.scratch = self.scratch.max(2 * POINTS * input * output);
        }
    }
}
