//! CDCNN's U-Net, trained to move noise to y along straight lines ([`Process::flow`]).

use spec::{Conditioning, FlowSpec};

use crate::ModelError;
use crate::architecture::{Architecture, Extents};
use crate::cdcnn::{Cdcnn, CdcnnSizes};
use crate::denoiser::{Denoiser, Task, Torques};
use crate::diffusion::Process;
use crate::frame::KnownInputs;
use crate::initialization::InitialWeights;

impl Architecture for FlowSpec {
    type Model = Denoiser<Cdcnn>;

    fn init(
        &self,
        extents: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Denoiser<Cdcnn>, ModelError> {
        let known_inputs = KnownInputs::of(self.residual);
        let sizes = CdcnnSizes {
            embedding: self.embedding,
            widths: &self.widths,
            conditioning: Conditioning::Local,
            known_inputs,
        };
        let network = sizes.init(extents, weights)?;
        let task = Task::Denoise(Process::flow(self));
        Ok(Denoiser { network, task, torques: Torques::Apart, known_inputs })
    }
}
