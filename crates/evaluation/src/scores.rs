//! The scores of one predictor's answer to one scenario.

use spec::Range;

use crate::metrics::{
    JitterMeter, beyond_limits_deg, central_interval, continuity, crps, energy_score,
    joint_rmse_deg, least_samples,
};

/// A number per joint, in f32 as in the stored table.
pub type PerJoint = Vec<f32>;

/// Probabilities of the central intervals whose coverage and width are stored for each joint.
pub const INTERVALS: [f64; 2] = [0.5, 0.9];

/// Probabilities at which coverage is stored for all joints together.
pub const CALIBRATION: [f64; 9] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9];

/// One predictor's errors on one scenario. All errors are in degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioErrors {
    pub rmse_deg: PerJoint,
    /// `None` in tables from before this measure existed.
    pub continuity: Option<ContinuityErrors>,
    /// The largest distance of the prediction beyond the limits of each joint; 0 within. `None`
    /// where limits are not known.
    pub beyond_limits_deg: Option<PerJoint>,
    pub jitter: Option<Jitter>,
    pub samples: Option<SampleErrors>,
}

/// How smoothly a prediction continues the measured positions, see [`continuity`].
#[derive(Clone, Debug, PartialEq)]
pub struct ContinuityErrors {
    pub first_sample_deg: PerJoint,
    pub jump_deg: PerJoint,
    pub largest_jump_deg: PerJoint,
    /// `None` without seams.
    pub seam_jump_deg: Option<PerJoint>,
}

/// The robot and the settings of the scores.
#[derive(Clone, Copy)]
pub struct ScoredAs<'a> {
    pub joints: usize,
    /// Number of samples that the predictor computes at a time, if its answers have seams.
    pub patch: Option<usize>,
    /// Position limits of each joint; empty where they are not known.
    pub limits_rad: &'a [Range],
    pub meter: Option<&'a JitterMeter>,
}

/// The part of a prediction above the signal's band.
#[derive(Clone, Debug, PartialEq)]
pub struct Jitter {
    /// Root mean square above the band.
    pub deg: PerJoint,
    /// The same after a zero-phase low-pass at the band's edge.
    pub smoothed_deg: PerJoint,
    /// RMSE after that low-pass.
    pub smoothed_rmse_deg: PerJoint,
}

/// The quality of several samples as a distribution.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleErrors {
    /// RMSE of the mean of the samples.
    pub mean_rmse_deg: PerJoint,
    /// Fair CRPS, mean over the horizon.
    pub crps_deg: PerJoint,
    /// Fair energy score of the whole horizon, all joints together.
    pub energy_score_deg: f32,
    /// The intervals of [`INTERVALS`] for which there are enough samples.
    pub intervals: Vec<IntervalErrors>,
    /// Share of the horizon, over all joints, inside the central intervals of [`CALIBRATION`] for
    /// which there are enough samples.
    pub calibration: Vec<f32>,
}

/// The central interval of one probability.
#[derive(Clone, Debug, PartialEq)]
pub struct IntervalErrors {
    pub nominal: f64,
    /// Share of the horizon inside the interval.
    pub coverage: PerJoint,
    /// Mean width over the horizon.
    pub width_deg: PerJoint,
}

impl ScenarioErrors {
    /// `truth`, `predicted` and each of `samples` are `[horizon, joint]` in rad.
    pub fn new(
        truth: &[f32],
        predicted: &[f32],
        samples: &[&[f32]],
        scored_as: ScoredAs<'_>,
    ) -> Self {
        let ScoredAs { joints, patch, limits_rad, meter } = scored_as;
        let rmse_deg = joint_rmse_deg(truth, predicted, joints);
        let beyond = (!limits_rad.is_empty()).then(|| beyond_limits_deg(predicted, limits_rad));
        Self {
            rmse_deg: rmse_deg.into_iter().map(to_f32).collect(),
            continuity: Some(ContinuityErrors::new(truth, predicted, joints, patch)),
            beyond_limits_deg: beyond.map(|beyond| beyond.into_iter().map(to_f32).collect()),
            jitter: meter.map(|meter| Jitter::new(truth, predicted, joints, meter)),
            samples: SampleErrors::new(truth, samples, joints),
        }
    }
}

impl ContinuityErrors {
    fn new(truth: &[f32], predicted: &[f32], joints: usize, patch: Option<usize>) -> Self {
        let of_joint = |joint: usize| {
            continuity(&degrees(truth, joint, joints), &degrees(predicted, joint, joints), patch)
        };
        let found: Vec<_> = (0..joints).map(of_joint).collect();
        Self {
            first_sample_deg: found.iter().map(|joint| to_f32(joint.first_sample_deg)).collect(),
            jump_deg: found.iter().map(|joint| to_f32(joint.jump_deg)).collect(),
            largest_jump_deg: found.iter().map(|joint| to_f32(joint.largest_jump_deg)).collect(),
            seam_jump_deg: found.iter().map(|joint| joint.seam_jump_deg.map(to_f32)).collect(),
        }
    }
}

impl Jitter {
    fn new(truth: &[f32], predicted: &[f32], joints: usize, meter: &JitterMeter) -> Self {
        let mut jitter =
            Self { deg: Vec::new(), smoothed_deg: Vec::new(), smoothed_rmse_deg: Vec::new() };
        for joint in 0..joints {
            let (truth, predicted) =
                (degrees(truth, joint, joints), degrees(predicted, joint, joints));
            let smoothed = meter.smoothed(&predicted);
            let squares: f64 = smoothed.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum();
            jitter.deg.push(to_f32(meter.jitter(&predicted)));
            jitter.smoothed_deg.push(to_f32(meter.jitter(&smoothed)));
            jitter.smoothed_rmse_deg.push(to_f32((squares / truth.len() as f64).sqrt()));
        }
        jitter
    }
}

/// The positions of joint `joint` of `joints` over the horizon.
pub(crate) fn degrees(positions: &[f32], joint: usize, joints: usize) -> Vec<f64> {
    positions.iter().skip(joint).step_by(joints).map(|&q| f64::from(q).to_degrees()).collect()
}

impl SampleErrors {
    /// Scores of samples. `None` below two samples.
    fn new(truth: &[f32], samples: &[&[f32]], joints: usize) -> Option<Self> {
        let energy_score_deg = to_f32(energy_score(samples, truth)?.to_degrees());
        let enough = |probability: &&f64| least_samples(**probability) <= samples.len();
        let intervals: Vec<f64> = INTERVALS.iter().filter(enough).copied().collect();
        let calibration: Vec<f64> = CALIBRATION.iter().filter(enough).copied().collect();

        let steps = truth.len() / joints;
        let mut crps_sum = vec![0.0; joints];
        let mut mean_squares = vec![0.0; joints];
        let mut covered = vec![vec![0.0; joints]; intervals.len()];
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
            for (k, &probability) in intervals.iter().enumerate() {
                let (low, high) = central_interval(&drawn, probability)?;
                covered[k][joint] += one_if((low..=high).contains(&truth));
                widths[k][joint] += high - low;
            }
            for (sum, &probability) in calibrated.iter_mut().zip(&calibration) {
                let (low, high) = central_interval(&drawn, probability)?;
                *sum += one_if((low..=high).contains(&truth));
            }
        }
        let over_steps =
            |sums: &[f64]| sums.iter().map(|sum| to_f32(sum / steps as f64)).collect::<PerJoint>();
        let root = |sum: &f64| to_f32((sum / steps as f64).sqrt());
        Some(Self {
            mean_rmse_deg: mean_squares.iter().map(root).collect(),
            crps_deg: over_steps(&crps_sum),
            energy_score_deg,
            intervals: intervals
                .iter()
                .zip(covered.into_iter().zip(widths))
                .map(|(&nominal, (covered, widths))| IntervalErrors {
                    nominal,
                    coverage: over_steps(&covered),
                    width_deg: over_steps(&widths),
                })
                .collect(),
            calibration: calibrated.iter().map(|sum| to_f32(sum / truth.len() as f64)).collect(),
        })
    }
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

    const AS: ScoredAs<'_> = ScoredAs { joints: JOINTS, patch: None, limits_rad: &[], meter: None };

    fn errors(count: usize) -> ScenarioErrors {
        let (truth, samples) = calibrated(count);
        let views: Vec<&[f32]> = samples.iter().map(Vec::as_slice).collect();
        ScenarioErrors::new(&truth, &vec![0.0; STEPS * JOINTS], &views, AS)
    }

    #[test]
    fn calibrated_samples_cover_what_they_say_and_no_more() {
        let found = errors(60).samples.unwrap();
        assert_eq!(found.calibration.len(), CALIBRATION.len());
        for (coverage, nominal) in found.calibration.iter().zip(CALIBRATION) {
            assert!((f64::from(*coverage) - nominal).abs() < 0.09, "{coverage} {nominal}");
        }
        let mean = |values: &PerJoint| f64::from(values.iter().sum::<f32>()) / JOINTS as f64;
        for (interval, width) in found.intervals.iter().zip([1.349, 3.290]) {
            assert!((mean(&interval.width_deg) - width).abs() < 0.1 * width, "{interval:?}");
            assert!((mean(&interval.coverage) - interval.nominal).abs() < 0.09, "{interval:?}");
        }
        // E |X - X'| / 2 for two standard normal numbers is 1 / √π.
        assert!((mean(&found.crps_deg) - 0.5642).abs() < 0.06, "{}", mean(&found.crps_deg));
        assert!((mean(&found.mean_rmse_deg) - 1.0).abs() < 0.1);
    }

    #[test]
    fn few_samples_have_no_wide_interval_and_one_has_none() {
        let found = errors(10).samples.unwrap();
        let nominal: Vec<f64> = found.intervals.iter().map(|interval| interval.nominal).collect();
        assert_eq!(nominal, [0.5]);
        assert_eq!(found.calibration.len(), 8);
        assert_eq!(errors(1).samples, None);
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
        let jitter = errors.jitter.unwrap();
        let expected = std::f32::consts::FRAC_1_SQRT_2;
        assert!((jitter.deg[4] - expected).abs() < 0.02, "{jitter:?}");
        assert!(jitter.smoothed_deg[4] < 0.02 && jitter.smoothed_rmse_deg[4] < 0.2, "{jitter:?}");
        assert!(jitter.deg[3] < 1e-6 && (errors.rmse_deg[4] - expected).abs() < 0.02);
    }
}
