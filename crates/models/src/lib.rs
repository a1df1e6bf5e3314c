//! The sequence models on burn: their architectures, their training and their checkpoints.
//!
//! A [`Trainer`] trains the model of a [`spec::TrainSpec`] on batches of trajectories. The caller
//! chooses the batch of each step. A [`TrainedModel`] predicts joint positions from a checkpoint
//! and [`series::Observed`] arms. Random numbers are keyed by the spec's seed and by their purpose,
//! and have no state. So the same spec and batches give the same weights on one kind of processor,
//! bit for bit, however often training was interrupted.
//!
//! Answers are row-major `[trajectory, sample, joint]`, in rad, like [`series::Series`].
//!
//! # Noise
//!
//! Noise of a training step is keyed by (seed, step, trajectory), noise of a sample by (seed,
//! scenario, sample), and dropout by (seed, step, trajectory, place, element). A table of
//! coefficients, known before the first pass of a network, says how noise is removed. Results do
//! not depend on batches, parts of batches and threads.
//!
//! # Micro-batches
//!
//! The processor computes a batch in micro-batches of up to 16 or 32 trajectories, whose
//! activations fit into a core's caches. Each thread computes another one, with a copy of the model
//! that shares its weights, because burn locks all operations on the same parameters. Of a large
//! model, all threads compute one micro-batch after the other. Gradients are added in the order of
//! the micro-batches, so that threads do not change the result. An interrupt unwinds a step out of
//! the operation it is in, and a trainer changes only when all gradients of a step are there.
//!
//! # Architectures
//!
//! `SequenceModel` is an enum with an arm for each entry of the list `spec::architectures`; all
//! share training, normalization and checkpoints. A network over a path gets the path and its unit
//! as inputs, because its answers contain neither. The reference of a model's positions is made
//! from what it observes alone.

#![warn(missing_docs)]

#[cfg(test)]
mod agreement_with_pytorch;
#[cfg(test)]
mod allocations;
mod architecture;
mod attention;
mod cdcnn;
mod cdt;
mod checkpoint;
mod denoiser;
mod device;
mod diffuser;
mod diffusion;
mod ema;
mod error;
mod flow;
mod frame;
mod frozen;
mod gradient_sum;
mod gru;
mod initialization;
mod lag;
mod lagrangian;
mod layers;
mod loss;
mod memory;
mod micro_batches;
mod normalization;
mod optimizer;
mod parameters;
mod path_tokens;
mod prediction;
mod prefix_transformer;
mod randomness;
mod ranges;
mod robomorph;
mod sampling;
mod sequence_model;
mod shapes;
mod single_threads;
mod sizes;
mod trained_model;
mod trainer;
mod transformer;
mod unet;
mod validation;

pub use architecture::FittedRobot;
pub use checkpoint::{
    CONFIG_FILE, CheckpointConfig, CheckpointFiles, FORMAT_VERSION, InitialCheckpoint, MODEL_FILE,
    OPTIMIZER_FILE, Origin, Versions,
};
pub use device::{Device, DeviceDescription, DeviceError, DeviceKind};
pub use error::ModelError;
pub use kernels::{Interrupt, Interrupted};
pub use memory::{TrainingMemory, memory_doubt};
pub use normalization::{Normalizer, Statistics, StatisticsAccumulator};
pub use ranges::{DataRanges, POSITION_ROUNDING_RAD, context_warnings, limit_warnings};
pub use sampling::{Sampling, WarmStart};
pub use trained_model::TrainedModel;
pub use trainer::{StepReport, Trainer, TrainingData};
pub use validation::{ValidationPart, ValidationReport};
