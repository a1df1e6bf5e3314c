//! The answers of the HTTP API and the reports of jobs. They are declared once, here.
//!
//! The server writes these types, the command line reads them, and the OpenAPI document is
//! generated from them. There is one file per resource. The only computations here are the wording
//! of sentences that the server, its page and the command line share, and the headline of a report.
//!
//! Ids are those of the database. Times are RFC 3339 in UTC. Lists are newest first unless they are
//! sorted. `next` is the `cursor` of the following page, and `null` on the last one. In attempts
//! and the audit log, `next` is the following page's `before`. In tasks, which are in the order in
//! which they run, it is the following page's `after`. In logs it is also `after`, and every page
//! has it. Readers ignore fields that they do not know.

#![warn(missing_docs)]

mod access;
mod attempts;
mod checkpoints;
mod closed_loop;
mod datasets;
mod drawn;
mod evaluations;
mod events;
mod headline;
mod health;
mod identification;
mod imports;
mod jobs;
mod labels;
mod lists;
mod log_check;
mod logs;
mod measures;
mod predictions;
mod presets;
mod problem;
mod queue;
mod replications;
mod report;
mod robots;
mod runs;
mod shifts;
mod states;
mod streams;
mod summaries;
mod tasks;
mod trajectories;
mod trajectory_predictions;
mod trash;
mod verifications;
mod warnings;
mod workers;

pub use access::{Audit, AuditEntry, CreatedToken, NewToken, Token, Tokens};
pub use attempts::{Attempt, Attempts};
pub use checkpoints::{Checkpoint, StoredFile};
pub use closed_loop::{
    ControlDifference, ControlReport, ControllerInfo, ControllerSummary, PlanTime,
};
pub use datasets::{Dataset, DatasetFile, FileKind};
pub use drawn::{DrawnPredictions, DrawnPredictor, DrawnScenario, ScenarioRank};
pub use evaluations::{CellTask, Evaluation};
pub use events::{
    CheckpointEvent, DeletionEvent, Event, EventEnd, EventGap, JobEvent, JobProgress, MetricsEvent,
    TaskEvent,
};
pub use headline::{EvaluationResult, Headline, MeanError};
pub use health::{Health, Readiness};
pub use identification::{
    ArmReport, Correlation, Directions, HorizonErrors, IdentificationReport, LoadReport,
    ParameterEstimate, TorqueResidual,
};
pub use imports::ImportCounts;
pub use jobs::{Job, Member, Membership, Progress};
pub use labels::{LabelChange, TextChange};
pub use lists::{
    Checkpoints, Datasets, Evaluations, Jobs, List, ListCell, ListColumn, ListPage, Listed, Robots,
    Runs, Tabled,
};
pub use log_check::{ChannelCheck, LogCheck, Measurement};
pub use logs::{LogChunk, Logs, left_out};
pub use measures::{Measure, Measured, Topic, Unit};
pub use predictions::{
    MovedScenario, ObservedScenario, PredictedQuantile, PredictedScenario, PredictingModel,
    Prediction, PredictionLatency, PredictionRequest, PredictionSampling, SaidTorques,
    TorqueAnswer, TorqueRequest, WantedMotion,
};
pub use presets::Presets;
pub use problem::Problem;
pub use queue::Queue;
pub use replications::{ReplicatedError, ReplicationDifference, ReplicationSummary};
pub use report::{
    Calibration, CellSummary, DataNoise, FailureSummary, GroupSummary, HorizonError, Interval,
    IntervalSummary, Latency, ORACLE, PairedDifference, PredictorInfo, PredictorKind,
    PredictorScores, PredictorSummary, Report, RolloutSummary, SamplingInfo, TrainedOn, WorstCase,
    at_noise,
};
pub use robots::{RemovedRobot, Robot, RobotLink, RobotUrdf};
pub use runs::{Artifact, LatestMetric, Metric, MetricPoint, Run, RunName};
pub use shifts::{Shift, ShiftDifference, ShiftScores, ShiftSummary};
pub use states::{
    AttemptOutcome, DatasetState, DeletionChange, EventKind, ItemKind, JobState, PlacementState,
    Relation, Scope, Sort, TaskState, UnknownState,
};
pub use streams::{
    FilledContext, Nothing, StreamFitted, StreamLatency, StreamMessage, StreamOpened, StreamReply,
    StreamSettings, StreamStep, StreamedPrediction, StreamedTorques,
};
pub use summaries::{ARM_PARAMETERS, ArmParameter, ChannelSummary, SpectrumSummary, Summary};
pub use tasks::{Task, Tasks, findings, findings_of};
pub use trajectories::Trajectory;
pub use trajectory_predictions::{TrajectoryPrediction, TrajectoryPredictions};
pub use trash::{Deleted, Dependent, Dependents, Item, Restored, Trash, TrashedItem};
pub use verifications::{Verification, VerifiedShard};
pub use warnings::{Warning, WarningKind};
pub use workers::{Placement, Worker, Workers, WorkersTask};
