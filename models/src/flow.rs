//! CDCNN's U-Net, trained to move noise to y along straight lines.
//!
//! A flow differs in two things: it has a process of its own ([`Process::flow`]), and its network is given the
//! integrator's path beside u.

use spec::{Conditioning, FlowSpec};

use crate::ModelError;
use crate::architecture::{Architecture, Extents};
use crate::cdcnn::{Cdcnn, CdcnnSizes};
use crate::denoiser::{Denoiser, Given, Task, Torques};
use crate::diffusion::Process;
use crate::initialization::InitialWeights;

impl Architecture for FlowSpec {
    type Model = Denoiser<Cdcnn>;

    fn init(
        &self,
        extents: Extents,
        weights: &mut InitialWeights<'_>,
    ) -> Result<Denoiser<Cdcnn>, ModelError> {
        let sizes = CdcnnSizes {
            embedding: self.embedding,
            widths: &self.widths,
            conditioning: Conditioning::Local,
            known: 2 * extents.joints,
        };
        let network = sizes.init(extents, weights)?;
        let task = Task::Denoise(Process::flow(self));
        Ok(Denoiser { network, task, torques: Torques::Apart, given: Given::TorquesAndPath })
    }
}
