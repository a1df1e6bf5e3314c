//! The sequence models on burn: what they compute, how they are trained, how they are kept.
//!
//! A [`Trainer`] turns a [`spec::TrainSpec`] and batches of trajectories into weights; a
//! [`TrainedModel`] turns a checkpoint and a [`PredictionInput`] into predicted joint positions.
//! Which batch comes at which step is the caller's matter. Nothing here draws random numbers but
//! the initial weights, from the spec's seed, so that the same spec, batches and thread count give
//! the same weights, bit for bit, however often training was interrupted.
//!
//! All series are row-major `[trajectory, sample, joint]`, u in N·m and y in rad.

#[cfg(test)]
mod agreement_with_pytorch;
mod attention;
mod batch;
mod checkpoint;
mod device;
mod error;
mod initialization;
mod kernels;
mod layers;
mod normalization;
mod optimizer;
mod parameters;
mod robomorph;
mod schedule;
mod sequence_model;
mod trained_model;
mod trainer;
mod transformer;

pub use batch::{Batch, PredictionInput};
pub use checkpoint::{
    CONFIG_FILE, CheckpointConfig, CheckpointFiles, FORMAT_VERSION, MODEL_FILE, OPTIMIZER_FILE,
    Versions,
};
pub use device::Device;
pub use error::ModelError;
pub use normalization::{Normalizer, Statistics, StatisticsAccumulator};
pub use trained_model::TrainedModel;
pub use trainer::{StepReport, Trainer, TrainingData, ValidationReport};
