use crate::shape::{Shape, ShapeError};

/// Least time over which positions are differentiated, s. At higher rates rounded positions would
/// dominate their second differences.
const LEAST_STEP_S: f64 = 1.0 / 60.0;

/// Positions, velocities and accelerations of a robot at some instants.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointMotion {
    joints: usize,
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
}

impl JointMotion {
    /// A motion that is known with its derivatives: `[instant, joint]` each, in rad, rad/s and
    /// rad/s².
    ///
    /// # Errors
    /// They are not as many velocities and accelerations as positions, of whole instants.
    pub fn new(
        joints: usize,
        q: Vec<f64>,
        qd: Vec<f64>,
        qdd: Vec<f64>,
    ) -> Result<Self, ShapeError> {
        let shape = Shape { robots: 1, samples: q.len() / joints.max(1), joints };
        shape.check("q", q.len())?;
        shape.check("qd", qd.len())?;
        shape.check("qdd", qdd.len())?;
        Ok(Self { joints, q, qd, qdd })
    }

    /// The motion of measured positions `[sample, joint]`, rad, by central differences. Samples with
    /// another one on both sides, 1/60 s away or a little more, are instants. Too few of them have
    /// no instant.
    ///
    /// The second difference of positions is a mean of accelerations with triangular weights.
    /// [`mean_torques`] is the same mean of the torques.
    pub fn measured(positions: &[f32], joints: usize, rate_hz: f64) -> Self {
        let reach = reach(rate_hz);
        let seconds = reach as f64 / rate_hz;
        let apart = reach * joints;
        let middles = apart..positions.len().saturating_sub(apart).max(apart);
        let at = |place: usize| f64::from(positions[place]);
        let qd = |k: usize| (at(k + apart) - at(k - apart)) / (2.0 * seconds);
        let qdd = |k: usize| (at(k + apart) - 2.0 * at(k) + at(k - apart)) / (seconds * seconds);
        Self {
            joints,
            q: middles.clone().map(at).collect(),
            qd: middles.clone().map(qd).collect(),
            qdd: middles.map(qdd).collect(),
        }
    }

    /// Joints of the robot.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Number of instants.
    pub fn instants(&self) -> usize {
        self.q.len() / self.joints.max(1)
    }

    /// Positions `[instant, joint]`, rad.
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Velocities `[instant, joint]`, rad/s.
    pub fn qd(&self) -> &[f64] {
        &self.qd
    }

    /// Accelerations `[instant, joint]`, rad/s².
    pub fn qdd(&self) -> &[f64] {
        &self.qdd
    }
}

/// The mean torques around each instant of a [measured](JointMotion::measured) motion, `[instant,
/// joint]`, of the torques `[sample, joint]` that acted at its samples. Each is held from its sample
/// to the next.
pub fn mean_torques(torques: &[f32], joints: usize, rate_hz: f64) -> Vec<f64> {
    let reach = reach(rate_hz);
    let around = 2 * reach * joints;
    let mean = |first: usize| -> f64 {
        let held = torques[first..first + around].iter().step_by(joints);
        let each = held.enumerate();
        each.map(|(k, torque)| f64::from(*torque) * weight(k, reach)).sum()
    };
    (0..torques.len().saturating_sub(around)).map(mean).collect()
}

/// The share of the `k`th of `2 · reach` periods in the second difference over `reach` periods.
fn weight(k: usize, reach: usize) -> f64 {
    let (k, reach) = (k as f64, reach as f64);
    (reach - (k + 0.5 - reach).abs()) / (reach * reach)
}

/// Number of periods of at least [`LEAST_STEP_S`] together.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "rates are at most 1000 Hz"
)]
fn reach(rate_hz: f64) -> usize {
    (LEAST_STEP_S * rate_hz - 1e-9).ceil().max(1.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[expect(clippy::cast_possible_truncation, reason = "positions are in f32")]
    fn a_parabola_has_its_velocities_and_its_acceleration() {
        for rate_hz in [60.0, 250.0] {
            let q = |time: f64| [0.5 + 0.25 * time + time * time, -2.0 * time];
            let at = |sample: u32| q(f64::from(sample) / rate_hz).map(|q| q as f32);
            let positions: Vec<f32> = (0..100).flat_map(at).collect();
            let motion = JointMotion::measured(&positions, 2, rate_hz);
            let reach = reach(rate_hz);
            assert_eq!(motion.instants(), 100 - 2 * reach);
            let middle = motion.instants() / 2;
            let time = (middle + reach) as f64 / rate_hz;
            let found = [motion.q(), motion.qd(), motion.qdd()]
                .map(|it| [it[2 * middle], it[2 * middle + 1]]);
            let expected = [q(time), [0.25 + 2.0 * time, -2.0], [2.0, 0.0]];
            for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
                assert!((found - expected).abs() < 1e-3, "{rate_hz} Hz: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_motion_without_a_second_difference_has_no_instant() {
        for samples in 0..3 {
            let motion = JointMotion::measured(&vec![0.0; 7 * samples], 7, 60.0);
            let held = mean_torques(&vec![0.0; 7 * samples], 7, 60.0);
            assert_eq!((motion.instants(), held), (0, vec![]));
        }
        assert_eq!(JointMotion::measured(&[0.0; 21], 7, 60.0).instants(), 1);
    }

    #[test]
    fn torques_have_the_weights_of_a_second_difference() {
        let of = |reach: usize| -> Vec<f64> { (0..2 * reach).map(|k| weight(k, reach)).collect() };
        assert_eq!(of(1), [0.5, 0.5]);
        assert_eq!(of(2), [0.125, 0.375, 0.375, 0.125]);
        assert_eq!([60.0, 61.0, 120.0, 1000.0].map(reach), [1, 2, 2, 17]);
        assert_eq!(mean_torques(&[1.0, 5.0, 2.0, 6.0, 9.0, 9.0], 2, 60.0), [1.5, 5.5]);
    }

    #[test]
    fn a_motion_has_as_many_velocities_and_accelerations_as_positions() {
        let of = |q: usize, qd: usize, qdd: usize| {
            JointMotion::new(2, vec![0.0; q], vec![0.0; qd], vec![0.0; qdd])
        };
        assert_eq!(of(6, 6, 6).unwrap().instants(), 3);
        for (lengths, name) in [((5, 5, 5), "q"), ((6, 4, 6), "qd"), ((6, 6, 8), "qdd")] {
            let error = of(lengths.0, lengths.1, lengths.2).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{name} has")), "{error}");
        }
    }
}
