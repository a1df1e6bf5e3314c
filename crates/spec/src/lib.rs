//! Specs: the language for every job that a user can submit.
//!
//! [`parse`] is the only way in. It resolves presets, refuses unknown fields, checks every value
//! and reports all violations at once. Every other crate can trust its result.
//!
//! Units are SI and named in the field (`_hz`, `_rad`, `_nm`). Angles are in radians, and torques
//! in N·m.

mod canonical;
mod check;
mod control;
mod data;
mod error;
mod error_text;
mod evaluate;
mod execution;
mod fields;
mod import;
mod job;
mod json;
mod kind;
mod model;
mod moment;
mod parse;
mod pipeline;
mod preset;
mod range;
mod reference;
mod resources;
mod robot;
mod schema;
mod simulate;
mod stream;
mod study;
mod train;
mod verify;

pub use canonical::{Digest, ParseDigestError};
pub use control::{
    ControlBaseline, ControlPath, ControlSpec, PlanWeights, Planner, PointToPoint, Swing,
};
pub use data::DataSpec;
pub use error::{
    ALLOWED_BYTES, FIELD_BYTES, LISTED_VIOLATIONS, SpecError, VALUE_BYTES, Violation, cut,
};
pub use error_text::{causes, panic_message};
pub use evaluate::{
    Baseline, Bootstrap, EvaluateSpec, EvaluationSampler, FilePredictions, LatencySpec,
    SamplerSteps, SamplingRun, ScenarioCell, Start, UNGRIDDED_SCENARIOS,
};
pub use execution::Execution;
pub use import::{
    AngleUnit, FileFormat, ImportColumns, ImportRanges, ImportSpec, ImportUnits, Resampling, Split,
    TimeUnit,
};
pub use job::{JobKind, JobSpec};
pub use json::{JsonFault, read_json};
pub use model::*;
pub use moment::{Moment, ParseMomentError};
pub use parse::parse;
pub use pipeline::{PipelineMember, PipelineSpec};
pub use preset::{Preset, PresetPlace, presets};
pub use range::Range;
pub use reference::{
    CheckpointRef, DataSource, Product, Reference, Referred, TrainingRef, TrainingStep,
};
pub use resources::Resources;
pub use robot::{
    AttachedBody, BodyDescription, BuiltInRobot, HandDescription, InertiaScheme, InitialState,
    JointDescription, JointFriction, MAX_JOINTS, Randomization, RobotDescription, RobotModel,
};
pub use schema::{nearest, schemas, shape_violations};
pub use simulate::{
    Cell, Chirp, ChirpBand, Column, ColumnType, Doubt, Excitation, Family, Frequency, Friction,
    Gravity, Integrator, MAX_POSITION_NOISE_RAD, MAX_TRAJECTORIES, Multisine, Observations,
    Payload, Precision, Rejection, RobotSpec, STEP_LEVELS, SimulateSpec, Steps,
};
pub use study::{
    StudyEvaluation, StudyModel, StudyPlan, StudyQuestion, StudyScale, StudyTraining, study_models,
};
pub use train::{
    EarlyStopSpec, EmaSpec, Normalization, OptimizerSpec, TrainSpec, Training, ValidationMetric,
};
pub use verify::VerifySpec;
