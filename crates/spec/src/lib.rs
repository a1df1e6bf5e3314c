//! Specs: the language for every job that a user can submit.
//!
//! [`parse`] is the only way in. It resolves presets, refuses unknown fields, checks every value
//! and reports all violations at once. Every other crate can trust its result.
//!
//! Units are SI and named in the field (`_hz`, `_rad`, `_nm`). Angles are in radians, and torques
//! in N·m.
//!
//! # Presets
//!
//! `"preset": NAME` is replaced by that preset, with the other fields merged over it. The merge
//! goes into objects field by field. Every other value replaces the preset's value, `null` as well,
//! which removes nothing. Fields with one of several choices (`frequency_hz`, `data`, `integrator`,
//! `checkpoints`, `path`, `residual`) are replaced as a whole. A preset is a JSON file of
//! `presets/`; the number in its file name is its place in lists.
//!
//! # Checks
//!
//! A spec is compared with its schema before it is deserialized, so wrong types, unknown fields and
//! missing fields are all reported. A violation is (field, value, allowed). The first hundred are
//! listed and the others counted, texts in them are cut, and a check takes time in proportion to
//! the text. No bound is written twice: the schemas get their bounds from the checks, which note
//! them while they check the specs of `specimens/`.
//!
//! # Digests and references
//!
//! A job refers to another's output in one of three ways: `{"job": NAME}` inside a pipeline,
//! `{"dataset": ID}` or `{"checkpoint": ID}`, and `{"digest": HEX}`. Submission resolves the first
//! two into the third, the digest of the spec that produces the data. A checkpoint that is not the
//! final one is the digest of its training with `best` or a step. So a stored spec contains no
//! database ids and means the same on every machine, and the digest of a job covers everything
//! upstream of it, like a Merkle tree.
//!
//! A server may keep descriptions of robots. `{"robot": ID}` or `{"digest": HEX}` as a `robot.model`
//! names one, and the server puts the description in its place before the spec is read
//! ([`named_robots`]). A digest covers its numbers.
//!
//! The digest is SHA-256 over RFC 8785 canonical JSON of the resolved spec without `execution`
//! (priority, attempts, time limit, resources, moment), which cannot change any result. Labels are
//! parameters of the request that submits a job, and no part of its spec. An evaluation of all
//! baselines is digested without `constant-velocity`, as before that baseline existed.
//!
//! # Kinds
//!
//! `for_each_kind` is the one list of kinds. The enums here, the planner in `jobs` and the dispatch
//! in `worker` are made from it. A kind has the name of its module in each of them.
//!
//! A training's spec says once which contexts and horizons the training answers (`Lengths`).
//! Evaluations, models and planners ask there.

#![warn(missing_docs)]

mod canonical;
mod check;
mod control;
mod data;
mod doubt;
mod error;
mod error_text;
mod evaluate;
mod execution;
mod given;
mod identify;
mod import;
mod job;
mod job_kind;
mod json;
mod kind;
mod merge;
mod model;
mod moment;
mod omitted;
mod parse;
mod pipeline;
mod preset;
mod range;
mod reference;
mod resources;
mod robot;
mod schema;
mod shorten;
mod simulate;
mod stream;
mod study;
mod train;
mod verify;

pub use canonical::{Digest, ParseDigestError};
pub use control::{
    ControlBaseline, ControlPath, ControlSpec, PlanWeights, Planner, PointToPoint, Swing,
};
pub use data::{DataSpec, MAX_SAMPLING_RATE_HZ};
pub use doubt::Doubt;
pub use error::{
    ALLOWED_BYTES, FIELD_BYTES, LISTED_VIOLATIONS, SpecError, VALUE_BYTES, Violation, cut,
};
pub use error_text::{causes, panic_message};
pub use evaluate::{
    Baseline, Bootstrap, EvaluateSpec, EvaluationSampler, FilePredictions, LatencySpec,
    SamplerSteps, SamplingRun, ScenarioCell, Start,
};
pub use execution::Execution;
pub use given::Given;
pub use identify::{IdentifyRobot, IdentifySpec};
pub use import::{
    AngleUnit, CsvLayout, FileFormat, ImportColumns, ImportRanges, ImportSpec, ImportUnits,
    LowPassHz, McapMessages, NamedFile, NoLowPass, Resampling, Split, TimeUnit, list_elements,
};
pub use job::JobSpec;
pub use job_kind::JobKind;
pub use json::{JsonFault, read_json};
pub use model::*;
pub use moment::{Moment, ParseMomentError};
pub use parse::{parse, parse_json};
pub use pipeline::{PipelineMember, PipelineSpec};
pub use preset::{Preset, PresetPlace, presets};
pub use range::Range;
pub use reference::{
    CheckpointRef, DataSource, DataSources, Product, Reference, Referred, TrainingRef, TrainingStep,
};
pub use resources::Resources;
pub use robot::{
    AttachedBody, BaseDescription, BodyDescription, BuiltInRobot, HandDescription, InertiaScheme,
    InitialState, JointDescription, JointFriction, MAX_JOINTS, MAX_ROBOT_REFERENCES, NamedRobot,
    Randomization, RobotDescription, RobotModel, RobotReference, named_robots,
};
pub use schema::{nearest, schemas, shape_violations};
pub use simulate::{
    CartesianImpedance, Cell, Chirp, ChirpBand, Column, ColumnType, ComputedTorque, ControlLaw,
    Controller, Excitation, Family, FourierSeries, Frequency, Friction, Gravity, HandPaths,
    Integrator, JointPd, MAX_DELAY_PERIODS, MAX_POSITION_NOISE_RAD, MAX_TRAJECTORIES, MoveProfile,
    Multisine, Observations, OperationalSpace, PULSES, PathShape, Payload, PointToPointMoves,
    Precision, Pulses, Rejection, RobotSpec, STEP_LEVELS, SimulateSpec, Steps, ViaPoints,
};
pub use study::{
    StudyEdition, StudyEvaluation, StudyModel, StudyPlan, StudyQuestion, StudyRecording,
    StudyScale, StudyTraining, real_study, study_models,
};
pub use train::{
    EarlyStopSpec, EmaSpec, Normalization, OptimizerSpec, TrainSpec, Training, ValidationMetric,
};
pub use verify::VerifySpec;
