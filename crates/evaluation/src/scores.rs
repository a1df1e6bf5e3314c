//! The measures of a prediction, and the scores of one predictor's answer to one scenario.
//!
//! A measure is declared here once, as a column of the result table, and beside the field of
//! [`PredictorScores`] that summarizes it, as a column of reports.

use spec::Range;
use wire::{Interval, PredictorScores};

use crate::ErrorHorizon;
use crate::metrics::{
    JitterMeter, beyond_limits_deg, central_interval, continuity, crps, energy_score,
    joint_rmse_deg, least_samples,
};

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

            /// The meaning of the measure, in a sentence.
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
    TorqueRmseNm torque_rmse_nm:
        "root mean square of the torque that the predictor's arm takes for the measured motion of \
         the horizon, minus the torque that acted"
        => Mean,
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
pub(crate) struct CentralInterval {
    /// The probability.
    pub nominal: f64,
    /// Share of the horizon inside the interval.
    pub coverage: Measure,
    /// Mean width over the horizon.
    pub width_deg: Measure,
}

/// The central intervals that are measured.
pub(crate) const INTERVALS: [CentralInterval; 2] = [
    CentralInterval { nominal: 0.5, coverage: Measure::Coverage50, width_deg: Measure::Width50Deg },
    CentralInterval { nominal: 0.9, coverage: Measure::Coverage90, width_deg: Measure::Width90Deg },
];

/// A number per joint, in f32 as in the stored table.
pub(crate) type PerJoint = Vec<f32>;

/// Probabilities at which coverage is stored for all joints together.
pub(crate) const CALIBRATION: [f64; 9] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];

/// One predictor's errors on one scenario.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScenarioErrors {
    /// A number per joint for each of [`Measure::ALL`]; `None` for what was not measured.
    values: [Option<PerJoint>; Measure::ALL.len()],
    /// RMSE over each of [`ScoredAs::horizons`], degrees.
    pub(crate) horizons: Vec<PerJoint>,
    /// Share of the horizon, over all joints, inside the central intervals of [`CALIBRATION`] for
    /// which there are enough samples. Rows of the table do not have it.
    pub calibration: Vec<f32>,
    /// Share of the joints inside each of [`INTERVALS`] at every step of the horizon, as far as there
    /// are enough samples. Rows of the table do not have it.
    pub(crate) step_coverage: Vec<PerStep>,
}

/// A number per step of the horizon.
pub(crate) type PerStep = Vec<f32>;

/// The robot and the settings of the scores.
#[derive(Clone, Copy)]
pub(crate) struct ScoredAs<'a> {
    /// Number of the robot's joints.
    pub joints: usize,
    /// Number of samples that the predictor computes at a time, if its answers have seams.
    pub patch: Option<usize>,
    /// Position limits of each joint; empty where they are not known.
    pub limits_rad: &'a [Range],
    /// First parts of the horizon whose RMSE is measured as well.
    pub horizons: &'a [ErrorHorizon],
    /// Measures jitter; `None` where no frequency lies above the band of the excitation.
    pub meter: Option<&'a JitterMeter>,
}

impl ScenarioErrors {
    /// Scores an answer. `truth`, `predicted` and each of `samples` are `[horizon, joint]` in rad.
    pub(crate) fn new(
        truth: &[f32],
        predicted: &[f32],
        samples: &[&[f32]],
        scored_as: ScoredAs<'_>,
    ) -> Self {
        let ScoredAs { joints, patch, limits_rad, horizons, meter } = scored_as;
        let mut errors = Self::default();
        errors.set(Measure::RmseDeg, joint_rmse_deg(truth, predicted, joints));
        let over = |horizon: &ErrorHorizon| {
            let values = horizon.samples * joints;
            let rmse = joint_rmse_deg(&truth[..values], &predicted[..values], joints);
            rmse.into_iter().map(to_f32).collect()
        };
        errors.horizons = horizons.iter().map(over).collect();
        if !limits_rad.is_empty() {
            errors.set(Measure::BeyondLimitsDeg, beyond_limits_deg(predicted, limits_rad));
        }
        errors.measure_continuity(truth, predicted, joints, patch);
        if let Some(meter) = meter {
            errors.measure_jitter(truth, predicted, joints, meter);
        }
        errors.measure_samples(truth, samples, joints);
        errors
    }

    /// The errors of a scenario from the values of its rows, one row per joint. `None` without an
    /// answer.
    pub(crate) fn of_joints(
        values: impl Fn(Measure) -> Option<PerJoint>,
        horizons: Vec<PerJoint>,
    ) -> Option<Self> {
        let errors = Self { values: Measure::ALL.map(values), horizons, ..Self::default() };
        errors.get(Measure::RmseDeg).is_some().then_some(errors)
    }

    /// A number per joint. `None` if it was not measured, as in tables from before the measure
    /// existed.
    pub(crate) fn get(&self, measure: Measure) -> Option<&PerJoint> {
        self.values[measure as usize].as_ref()
    }

    /// The mean of a measure over joints.
    pub(crate) fn mean(&self, measure: Measure) -> Option<f64> {
        let values = self.get(measure)?;
        let sum: f64 = values.iter().map(|value| f64::from(*value)).sum();
        Some(sum / values.len() as f64)
    }

    /// The RMSE over the `k`th first part of the horizon, as a mean over joints, degrees. `None` if it
    /// was not measured.
    pub(crate) fn horizon(&self, k: usize) -> Option<f64> {
        let joints = self.horizons.get(k).filter(|joints| !joints.is_empty())?;
        Some(joints.iter().map(|rmse| f64::from(*rmse)).sum::<f64>() / joints.len() as f64)
    }

    pub(crate) fn set(&mut self, measure: Measure, values: impl IntoIterator<Item = f64>) {
        self.values[measure as usize] = Some(values.into_iter().map(to_f32).collect());
    }

    /// Measures how smoothly the prediction continues the measured positions, see [`continuity`].
    fn measure_continuity(
        &mut self,
        truth: &[f32],
        predicted: &[f32],
        joints: usize,
        patch: Option<usize>,
    ) {
        let of_joint = |joint: usize| {
            continuity(&degrees(truth, joint, joints), &degrees(predicted, joint, joints), patch)
        };
        let found: Vec<_> = (0..joints).map(of_joint).collect();
        self.set(Measure::FirstSampleDeg, found.iter().map(|joint| joint.first_sample_deg));
        self.set(Measure::JumpDeg, found.iter().map(|joint| joint.jump_deg));
        self.set(Measure::LargestJumpDeg, found.iter().map(|joint| joint.largest_jump_deg));
        let seams: Option<Vec<f64>> = found.iter().map(|joint| joint.seam_jump_deg).collect();
        if let Some(seams) = seams {
            self.set(Measure::SeamJumpDeg, seams);
        }
    }

    /// Measures the part of the prediction above the signal's band, before and after a zero-phase
    /// low-pass at the band's edge.
    fn measure_jitter(
        &mut self,
        truth: &[f32],
        predicted: &[f32],
        joints: usize,
        meter: &JitterMeter,
    ) {
        let of_joint = |joint: usize| {
            let (truth, predicted) =
                (degrees(truth, joint, joints), degrees(predicted, joint, joints));
            let smoothed = meter.smoothed(&predicted);
            let squares: f64 = smoothed.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum();
            let rmse = (squares / truth.len() as f64).sqrt();
            [meter.jitter(&predicted), meter.jitter(&smoothed), rmse]
        };
        let found: Vec<[f64; 3]> = (0..joints).map(of_joint).collect();
        let measures = [Measure::JitterDeg, Measure::SmoothedJitterDeg, Measure::SmoothedRmseDeg];
        for (k, measure) in measures.into_iter().enumerate() {
            self.set(measure, found.iter().map(|joint| joint[k]));
        }
    }

    /// Measures samples as a distribution. Does nothing below two samples.
    fn measure_samples(&mut self, truth: &[f32], samples: &[&[f32]], joints: usize) -> Option<()> {
        let energy_score_deg = energy_score(samples, truth)?.to_degrees();
        let enough = |probability: f64| least_samples(probability) <= samples.len();
        let intervals = INTERVALS.iter().filter(|interval| enough(interval.nominal));
        let intervals: Vec<_> = intervals.copied().collect();
        let calibration: Vec<f64> = CALIBRATION.into_iter().filter(|&p| enough(p)).collect();

        let steps = (truth.len() / joints) as f64;
        let mut crps_sum = vec![0.0; joints];
        let mut mean_squares = vec![0.0; joints];
        let mut covered = vec![vec![0.0; joints]; intervals.len()];
        let mut step_covered = vec![vec![0.0; truth.len() / joints]; intervals.len()];
        let mut widths = vec![vec![0.0; joints]; intervals.len()];
        let mut calibrated = vec![0.0; calibration.len()];
        let mut drawn = Vec::with_capacity(samples.len());
        for (entry, truth) in truth.iter().enumerate() {
            let joint = entry % joints;
            let truth = f64::from(*truth).to_degrees();
            drawn.clear();
            drawn.extend(samples.iter().map(|sample| f64::from(sample[entry]).to_degrees()));
            let mean = drawn.iter().sum::<f64>() / drawn.len() as f64;
            mean_squares[joint] += (mean - truth).powi(2);
            // This also sorts the samples, as the intervals need them.
            crps_sum[joint] += crps(&mut drawn, truth)?;
            for (k, interval) in intervals.iter().enumerate() {
                let (low, high) = central_interval(&drawn, interval.nominal)?;
                let inside = one_if((low..=high).contains(&truth));
                covered[k][joint] += inside;
                step_covered[k][entry / joints] += inside;
                widths[k][joint] += high - low;
            }
            for (sum, &probability) in calibrated.iter_mut().zip(&calibration) {
                let (low, high) = central_interval(&drawn, probability)?;
                *sum += one_if((low..=high).contains(&truth));
            }
        }
        self.set(Measure::MeanRmseDeg, mean_squares.iter().map(|sum| (sum / steps).sqrt()));
        self.set(Measure::CrpsDeg, crps_sum.iter().map(|sum| sum / steps));
        self.set(Measure::EnergyScoreDeg, vec![energy_score_deg; joints]);
        for (interval, (covered, widths)) in intervals.iter().zip(covered.iter().zip(&widths)) {
            self.set(interval.coverage, covered.iter().map(|sum| sum / steps));
            self.set(interval.width_deg, widths.iter().map(|sum| sum / steps));
        }
        let share =
            |steps: &Vec<f64>| steps.iter().map(|sum| to_f32(sum / joints as f64)).collect();
        self.step_coverage = step_covered.iter().map(share).collect();
        self.calibration = calibrated.iter().map(|sum| to_f32(sum / truth.len() as f64)).collect();
        Some(())
    }
}

/// The positions of joint `joint` of `joints` over the horizon.
pub(crate) fn degrees(positions: &[f32], joint: usize, joints: usize) -> Vec<f64> {
    positions.iter().skip(joint).step_by(joints).map(|&q| f64::from(q).to_degrees()).collect()
}

fn one_if(condition: bool) -> f64 {
    f64::from(u8::from(condition))
}

#[expect(clippy::cast_possible_truncation, reason = "the table holds f32")]
fn to_f32(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::normal::samples as normal;

    const STEPS: usize = 40;
    const JOINTS: usize = 7;

    /// A truth and `count` samples, all from the same normal distribution with standard deviation
    /// 1°.
    fn calibrated(count: usize) -> (Vec<f32>, Vec<Vec<f32>>) {
        let series = |key: usize| -> Vec<f32> {
            normal(key as u64, STEPS * JOINTS).iter().map(|x| to_f32(x.to_radians())).collect()
        };
        (series(1000), (0..count).map(series).collect())
    }

    const AS: ScoredAs<'_> =
        ScoredAs { joints: JOINTS, patch: None, limits_rad: &[], horizons: &[], meter: None };

    fn errors(count: usize) -> ScenarioErrors {
        let (truth, samples) = calibrated(count);
        let views: Vec<&[f32]> = samples.iter().map(Vec::as_slice).collect();
        ScenarioErrors::new(&truth, &vec![0.0; STEPS * JOINTS], &views, AS)
    }

    #[test]
    fn calibrated_samples_cover_what_they_say_and_no_more() {
        let found = errors(60);
        assert_eq!(found.calibration.len(), CALIBRATION.len());
        for (coverage, nominal) in found.calibration.iter().zip(CALIBRATION) {
            assert!((f64::from(*coverage) - nominal).abs() < 0.09, "{coverage} {nominal}");
        }
        let mean = |measure: Measure| found.mean(measure).unwrap();
        for (interval, width) in INTERVALS.into_iter().zip([1.349, 3.290]) {
            assert!((mean(interval.width_deg) - width).abs() < 0.1 * width, "{interval:?}");
            assert!((mean(interval.coverage) - interval.nominal).abs() < 0.09, "{interval:?}");
        }
        // E |X - X'| / 2 for two standard normal numbers is 1 / √π.
        assert!((mean(Measure::CrpsDeg) - 0.5642).abs() < 0.06, "{}", mean(Measure::CrpsDeg));
        assert!((mean(Measure::MeanRmseDeg) - 1.0).abs() < 0.1);
    }

    #[test]
    fn every_measure_is_in_the_docs() {
        let docs = include_str!("../../../docs/evaluation.md");
        for measure in Measure::ALL {
            let name = format!("`{}`", measure.name());
            assert!(docs.contains(&name), "{name} is not in docs/evaluation.md");
        }
    }

    #[test]
    fn few_samples_have_no_wide_interval_and_one_has_none() {
        let found = errors(10);
        let measured = INTERVALS.map(|interval| found.get(interval.width_deg).is_some());
        assert_eq!(measured, [true, false]);
        assert_eq!(found.calibration.len(), 8);
        assert_eq!(errors(1).get(Measure::CrpsDeg), None);
    }

    #[test]
    fn a_tone_above_the_band_is_jitter_and_the_low_pass_takes_it_and_its_error_away() {
        let truth = vec![0.0; 80 * JOINTS];
        let mut predicted = truth.clone();
        for step in 0..80 {
            let turns = 12.0 * f64::from(step) / 60.0;
            let at = (std::f64::consts::TAU * turns).sin().to_radians();
            predicted[usize::try_from(step).unwrap() * JOINTS + 4] = to_f32(at);
        }
        let meter = JitterMeter::new(80, 5.0, 60.0).unwrap();
        let errors =
            ScenarioErrors::new(&truth, &predicted, &[], ScoredAs { meter: Some(&meter), ..AS });
        let of_joint = |measure: Measure, joint: usize| errors.get(measure).unwrap()[joint];
        let expected = std::f32::consts::FRAC_1_SQRT_2;
        assert!((of_joint(Measure::JitterDeg, 4) - expected).abs() < 0.02, "{errors:?}");
        assert!(of_joint(Measure::SmoothedJitterDeg, 4) < 0.02, "{errors:?}");
        assert!(of_joint(Measure::SmoothedRmseDeg, 4) < 0.2, "{errors:?}");
        assert!(of_joint(Measure::JitterDeg, 3) < 1e-6, "{errors:?}");
        assert!((of_joint(Measure::RmseDeg, 4) - expected).abs() < 0.02);
    }
}
