//! The measures of a prediction, declared once: their columns in the result table, and how a report
//! summarizes them.

use wire::{Interval, PredictorScores};

/// How a report summarizes a measure over scenarios and joints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Aggregate {
    Mean,
    RootMeanSquare,
}

/// The summary of a measure in a report.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Summarized {
    pub measure: Measure,
    pub aggregate: Aggregate,
    pub field: fn(&mut PredictorScores) -> &mut Option<Interval>,
}

/// A measure that a report summarizes has the name of its field in [`PredictorScores`].
macro_rules! measures {
    ($($measure:ident $name:ident: $about:literal $(=> $aggregate:ident)?,)+) => {
        /// A measure of each scenario, joint and predictor.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Measure {
            $(#[doc = $about] $measure,)+
        }

        impl Measure {
            /// All measures, in the order of the table's columns.
            pub const ALL: [Self; [$(Self::$measure),+].len()] = [$(Self::$measure),+];

            /// The name of its column.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$measure => stringify!($name),)+ }
            }

            /// What it means.
            pub const fn about(self) -> &'static str {
                match self { $(Self::$measure => $about,)+ }
            }
        }

        pub(crate) const SUMMARIZED: &[Summarized] = &[$($(Summarized {
            measure: Measure::$measure,
            aggregate: Aggregate::$aggregate,
            field: |scores| &mut scores.$name,
        },)?)+];
    };
}

measures! {
    RmseDeg rmse_deg: "root mean square error over the horizon",
    FirstSampleDeg first_sample_deg: "size of the error of the first sample of the horizon"
        => RootMeanSquare,
    JumpDeg jump_deg:
        "root mean square of the change of the error from one sample to the next, seams left out"
        => RootMeanSquare,
    SeamJumpDeg seam_jump_deg:
        "the same over the seams between the patches that a model predicts one by one"
        => RootMeanSquare,
    LargestJumpDeg largest_jump_deg: "the largest change of the error from one sample to the next"
        => Mean,
    BeyondLimitsDeg beyond_limits_deg:
        "how far the prediction lies beyond the limits of the joint at most; 0 within",
    JitterDeg jitter_deg: "root mean square of the prediction above the band of the excitation"
        => Mean,
    SmoothedJitterDeg smoothed_jitter_deg:
        "the same after a zero-phase low-pass at the edge of the band"
        => Mean,
    SmoothedRmseDeg smoothed_rmse_deg: "root mean square error after that low-pass" => Mean,
    MeanRmseDeg mean_rmse_deg: "root mean square error of the mean of the samples" => Mean,
    CrpsDeg crps_deg: "fair continuous ranked probability score, mean over the horizon" => Mean,
    EnergyScoreDeg energy_score_deg:
        "fair energy score of the scenario, the same for all its joints"
        => Mean,
    Coverage50 coverage_50: "share of the horizon inside the central 50 % interval",
    Width50Deg width_50_deg: "mean width of that interval",
    Coverage90 coverage_90: "share of the horizon inside the central 90 % interval",
    Width90Deg width_90_deg: "mean width of that interval",
}

/// A central interval whose coverage and width are stored for each joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CentralInterval {
    /// The probability.
    pub nominal: f64,
    /// Share of the horizon inside the interval.
    pub coverage: Measure,
    /// Mean width over the horizon.
    pub width_deg: Measure,
}

/// The central intervals that are measured.
pub const INTERVALS: [CentralInterval; 2] = [
    CentralInterval { nominal: 0.5, coverage: Measure::Coverage50, width_deg: Measure::Width50Deg },
    CentralInterval { nominal: 0.9, coverage: Measure::Coverage90, width_deg: Measure::Width90Deg },
];
