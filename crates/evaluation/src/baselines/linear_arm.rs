//! The torques of an arm as a linear function of its parameters, and their ridge regression.

use dynamics::{Friction, Joints, LINK_PARAMETERS, RigidBody, Robot, torque_regressor};
use nalgebra::{DMatrix, DVector};
use series::{JointMotion, LowPass};

use super::ridge::{Equations, ridge};
use crate::horizons::nearest_whole;

/// An arm whose torques are linear in its parameters: the [`LINK_PARAMETERS`] of each link, then the
/// damping, the friction φ1, the armature and the torque offset of each joint.
#[derive(Clone, Debug)]
pub(super) struct LinearArm {
    nominal: Robot,
    /// The shape of friction.
    friction: Friction,
}

/// A fitted arm.
#[derive(Clone, Debug)]
pub(super) struct FittedArm {
    pub robot: Robot,
    /// Torque of each joint beyond what the robot explains, N·m.
    pub offset_nm: Joints<f64>,
}

/// A motion of an arm and its torques, at even times.
pub(super) struct Record<'a> {
    pub motion: &'a JointMotion,
    /// `[instant, joint]`, N·m.
    pub torques: &'a [f64],
    /// Instants per second.
    pub rate_hz: f64,
}

/// Standard deviation of a parameter a priori, as a share of its nominal size. Descriptions of arms
/// are about as wrong, and a load in the hand counts as part of the last link.
const SPREAD: f64 = 0.3;
/// Standard deviation a priori of the torque of friction, damping, armature or an offset that the nominal arm lacks, as a share of
/// the joint's torque (root mean squares).
const MISSING_SPREAD: f64 = 0.03;
/// φ2 of friction that the nominal arm lacks, s/rad: it rises within about 0.1 rad/s, as that of the Panda.
const MISSING_STEEPNESS: f64 = 10.0;
/// φ2 of the steep shape of friction that is tried beside the nominal arm's, s/rad.
const STEEP: f64 = 40.0;
/// By how much the steep shape must be more likely, in nats.
const CLEARLY: f64 = 2.0;
/// Least mass, friction, damping and armature, as a share of the nominal one.
const LEAST_SHARE: f64 = 0.02;
/// Edge of the low-pass through which torques and regressors pass, Hz. Accelerations from measured positions are noise
/// above it.
const EDGE_HZ: f64 = 10.0;
/// Ends of the motion that the low-pass leaves uncertain, s.
const UNCERTAIN_S: f64 = 0.05;
/// Rate of the equations, Hz.
const EQUATIONS_HZ: f64 = 60.0;

/// The equations of one joint after the low-pass.
struct Rows {
    /// The place of each parameter on which the torque depends.
    places: Vec<usize>,
    /// The derivatives of the torque by them, `[instant, parameter]`.
    matrix: DMatrix<f64>,
    /// Torque that the nominal arm leaves unexplained, N·m.
    residual: DVector<f64>,
    /// Mean square of the torque.
    power: f64,
    /// The share of the equations that is independent of the others.
    independent: f64,
}

impl Rows {
    /// The equations of steps in these standard deviations a priori.
    fn equations(&self, spreads: &DVector<f64>) -> Equations {
        let Self { places, residual, .. } = self;
        let mut matrix = self.matrix.clone();
        for (mut column, &place) in matrix.column_iter_mut().zip(places) {
            column *= spreads[place];
        }
        let (small, of_places) = (matrix.tr_mul(&matrix), matrix.tr_mul(residual));
        let mut normal = DMatrix::zeros(spreads.len(), spreads.len());
        let mut right = DVector::zeros(spreads.len());
        for (row, &place) in places.iter().enumerate() {
            right[place] = of_places[row];
            for (column, &other) in places.iter().enumerate() {
                normal[(place, other)] = small[(row, column)];
            }
        }
        Equations {
            normal,
            right,
            squares: residual.norm_squared(),
            power: self.power,
            count: residual.len() as f64,
            independent: self.independent,
        }
    }
}

impl LinearArm {
    pub fn new(nominal: Robot) -> Self {
        let joints = nominal.joints();
        let missing = || Friction {
            phi1_nm: Joints::splat(joints, 0.0),
            phi2_s_rad: Joints::splat(joints, MISSING_STEEPNESS),
            phi3_rad_s: Joints::splat(joints, 0.0),
        };
        let friction = nominal.friction.clone().unwrap_or_else(missing);
        Self { nominal, friction }
    }

    pub fn nominal(&self) -> &Robot {
        &self.nominal
    }

    fn joints(&self) -> usize {
        self.nominal.joints()
    }

    /// The place of the first parameter of the joints: a damping.
    fn of_joints(&self) -> usize {
        LINK_PARAMETERS * self.joints()
    }

    /// The parameters of the nominal arm.
    fn nominal_parameters(&self) -> DVector<f64> {
        let Self { nominal, friction } = self;
        let links = nominal.links.iter().flat_map(RigidBody::parameters);
        let offsets = std::iter::repeat_n(0.0, self.joints());
        let of_joints = nominal.damping.iter().chain(&friction.phi1_nm).chain(&nominal.armature);
        let all: Vec<f64> = links.chain(of_joints.copied()).chain(offsets).collect();
        DVector::from_vec(all)
    }

    /// Standard deviations of the parameters a priori.
    fn spreads(&self, nominal: &DVector<f64>, rows: &[Rows]) -> DVector<f64> {
        let of_link = |link: &RigidBody| {
            let [mass, hx, hy, hz, xx, _, _, yy, _, zz] = link.parameters();
            let moment = (hx * hx + hy * hy + hz * hz).sqrt();
            let inertia = (xx + yy + zz) / 3.0;
            let mut spreads = [SPREAD * inertia; LINK_PARAMETERS];
            spreads[0] = SPREAD * mass;
            spreads[1..4].fill(SPREAD * moment);
            spreads
        };
        let links = self.nominal.links.iter().flat_map(of_link);
        let mut spreads = DVector::from_iterator(
            nominal.len(),
            links.chain(nominal.iter().skip(self.of_joints()).map(|value| SPREAD * value)),
        );
        for Rows { places, matrix, power, .. } in rows {
            for (column, &place) in matrix.column_iter().zip(places) {
                if place >= self.of_joints() && spreads[place] == 0.0 {
                    let size = (column.norm_squared() / column.len() as f64).sqrt();
                    spreads[place] = MISSING_SPREAD * power.sqrt() / size.max(1e-9);
                }
            }
        }
        spreads
    }

    /// The arm of these parameters. A link without mass is the nominal one.
    fn arm_of(&self, parameters: &DVector<f64>, friction: &Friction) -> FittedArm {
        let joints = self.joints();
        let mut robot = self.nominal.clone();
        for (link, of_link) in
            robot.links.iter_mut().zip(parameters.as_slice().chunks_exact(LINK_PARAMETERS))
        {
            if let Ok(of_link) = <&[f64; LINK_PARAMETERS]>::try_from(of_link)
                && of_link[0] > 0.0
            {
                *link = RigidBody::from_parameters(of_link);
            }
        }
        let of_joints = |kind: usize| {
            Joints::from_fn(joints, |joint| parameters[self.of_joints() + kind * joints + joint])
        };
        robot.damping = of_joints(0);
        robot.friction = Some(Friction { phi1_nm: of_joints(1), ..friction.clone() });
        robot.armature = of_joints(2);
        FittedArm { robot, offset_nm: of_joints(3) }
    }

    /// The most likely arm. `None` without equations. Friction of each joint has the nominal arm's shape, or a steep
    /// one if that is [`CLEARLY`] more likely.
    pub fn fit(&self, record: &Record<'_>) -> Option<FittedArm> {
        let joints = self.joints();
        let steep = Friction {
            phi1_nm: self.friction.phi1_nm,
            phi2_s_rad: Joints::splat(joints, STEEP),
            phi3_rad_s: Joints::splat(joints, 0.0),
        };
        let (fitted, likelihoods) = self.fit_with(record, &self.friction)?;
        let (_, of_steep) = self.fit_with(record, &steep)?;
        let is_steep: Vec<bool> = likelihoods
            .iter()
            .zip(&of_steep)
            .map(|(likelihood, of_steep)| of_steep - likelihood > CLEARLY)
            .collect();
        if !is_steep.contains(&true) {
            return Some(fitted);
        }
        let chosen = |of: fn(&Friction) -> &Joints<f64>| {
            let either = |joint: usize| if is_steep[joint] { &steep } else { &self.friction };
            Joints::from_fn(joints, |joint| of(either(joint))[joint])
        };
        let mixed = Friction {
            phi1_nm: self.friction.phi1_nm,
            phi2_s_rad: chosen(|shape| &shape.phi2_s_rad),
            phi3_rad_s: chosen(|shape| &shape.phi3_rad_s),
        };
        self.fit_with(record, &mixed).map(|(fitted, _)| fitted)
    }

    /// The most likely arm with this shape of friction, and the logarithm of the likelihood of each joint's torques.
    fn fit_with(&self, record: &Record<'_>, friction: &Friction) -> Option<(FittedArm, Vec<f64>)> {
        let nominal = self.nominal_parameters();
        let rows = self.rows(record, &nominal, friction)?;
        let spreads = self.spreads(&nominal, &rows);
        let equations: Vec<Equations> = rows.iter().map(|rows| rows.equations(&spreads)).collect();
        let least = self.least_steps(&nominal, &spreads);
        let steps = ridge(&equations, &least)?;
        let parameters = nominal + spreads.component_mul(&steps);
        let likelihoods = equations.iter().map(|equations| equations.log_likelihood(&steps));
        let is_finite = parameters.iter().all(|value| value.is_finite());
        is_finite.then(|| (self.arm_of(&parameters, friction), likelihoods.collect()))
    }

    /// The least step of each parameter that must not become negative.
    fn least_steps(&self, nominal: &DVector<f64>, spreads: &DVector<f64>) -> Vec<Option<f64>> {
        let (of_joints, offsets) = (self.of_joints(), self.of_joints() + 3 * self.joints());
        let is_positive = |place: usize| {
            if place < of_joints { place.is_multiple_of(LINK_PARAMETERS) } else { place < offsets }
        };
        let step = |place: usize| -(1.0 - LEAST_SHARE) * nominal[place] / spreads[place].max(1e-12);
        (0..nominal.len()).map(|place| is_positive(place).then(|| step(place))).collect()
    }

    /// The equations of each joint. `None` if the motion is too short.
    fn rows(
        &self,
        record: &Record<'_>,
        nominal: &DVector<f64>,
        friction: &Friction,
    ) -> Option<Vec<Rows>> {
        let (joints, instants) = (self.joints(), record.motion.instants());
        let uncertain = nearest_whole(UNCERTAIN_S * record.rate_hz);
        let stride = nearest_whole(record.rate_hz / EQUATIONS_HZ).max(1);
        let kept: Vec<usize> =
            (uncertain..instants.saturating_sub(uncertain)).step_by(stride).collect();
        if kept.is_empty() {
            return None;
        }
        let low_pass = LowPass::new(EDGE_HZ, record.rate_hz);
        let independent =
            if low_pass.is_some() { 2.0 * EDGE_HZ * stride as f64 / record.rate_hz } else { 1.0 };
        let smooth = |column: Vec<f64>| {
            low_pass.and_then(|low_pass| low_pass.apply(&column)).unwrap_or(column)
        };
        let regressors = self.regressors(record.motion, friction);
        let of_joint = |joint: usize| {
            let places: Vec<usize> = self.places(joint).collect();
            let mut matrix = DMatrix::zeros(kept.len(), places.len());
            let torques =
                smooth(record.torques.iter().skip(joint).step_by(joints).copied().collect());
            let mut residual = DVector::from_fn(kept.len(), |row, _| torques[kept[row]]);
            let power = residual.norm_squared() / kept.len() as f64;
            for (column, &place) in places.iter().enumerate() {
                let values = smooth(regressors[joint].column(column).iter().copied().collect());
                for (row, &instant) in kept.iter().enumerate() {
                    residual[row] -= values[instant] * nominal[place];
                    matrix[(row, column)] = values[instant];
                }
            }
            Rows { places, matrix, residual, power, independent: independent.min(1.0) }
        };
        Some((0..joints).map(of_joint).collect())
    }

    /// The places of the parameters on which the torque of `joint` depends.
    fn places(&self, joint: usize) -> impl Iterator<Item = usize> + use<> {
        let (joints, of_joints) = (self.joints(), self.of_joints());
        let links = LINK_PARAMETERS * joint..of_joints;
        links.chain((0..4).map(move |kind| of_joints + kind * joints + joint))
    }

    /// The derivatives of each joint's torque by its parameters, `[instant, parameter]`, in the order of
    /// [`LinearArm::places`].
    fn regressors(&self, motion: &JointMotion, friction: &Friction) -> Vec<DMatrix<f64>> {
        let (joints, instants) = (self.joints(), motion.instants());
        let width = self.of_joints();
        let mut of_joint: Vec<DMatrix<f64>> = (0..joints)
            .map(|joint| DMatrix::zeros(instants, width - LINK_PARAMETERS * joint + 4))
            .collect();
        let mut regressor = vec![0.0; joints * width];
        for instant in 0..instants {
            let at = |values: &[f64]| -> Joints<f64> {
                values[instant * joints..][..joints].iter().copied().collect()
            };
            let (q, qd, qdd) = (at(motion.q()), at(motion.qd()), at(motion.qdd()));
            let Robot { kinematics, gravity, .. } = &self.nominal;
            torque_regressor(kinematics, *gravity, &q, &qd, &qdd, &mut regressor);
            for (joint, matrix) in of_joint.iter_mut().enumerate() {
                let links = &regressor[joint * width..][LINK_PARAMETERS * joint..width];
                let shape = friction_shape(friction, joint, qd[joint]);
                let own = [qd[joint], shape, qdd[joint], 1.0];
                for (column, value) in links.iter().chain(&own).enumerate() {
                    matrix[(instant, column)] = *value;
                }
            }
        }
        of_joint
    }
}

/// The torque of friction with φ1 = 1 N·m at `qd` (rad/s).
fn friction_shape(friction: &Friction, joint: usize, qd: f64) -> f64 {
    let Friction { phi2_s_rad, phi3_rad_s, .. } = friction;
    let sigmoid = |qd: f64| (1.0 + (-phi2_s_rad[joint] * (qd + phi3_rad_s[joint])).exp()).recip();
    sigmoid(qd) - sigmoid(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 100.0;

    /// Five seconds of sines, other ones for each `phase`.
    fn motion(phase: f64) -> JointMotion {
        let wave = |instant: usize, joint: usize, derivative: i32| -> f64 {
            let term = |rate: f64, amplitude: f64| {
                let angle = rate * instant as f64 / RATE_HZ + phase + 1.3 * joint as f64;
                let turned = angle + f64::from(derivative) * std::f64::consts::FRAC_PI_2;
                amplitude * rate.powi(derivative) * turned.sin()
            };
            term(1.1 + 0.3 * joint as f64, 0.6) + term(4.7 + 0.2 * joint as f64, 0.1)
        };
        let values = |derivative: i32| -> Vec<f64> {
            (0..500 * 7).map(|place| wave(place / 7, place % 7, derivative)).collect()
        };
        JointMotion::new(7, values(0), values(1), values(2)).unwrap()
    }

    fn torques(arm: &Robot, motion: &JointMotion) -> Vec<f64> {
        crate::metrics::torques_of_arm(arm, motion)
    }

    fn nominal(friction: Option<spec::Friction>) -> Robot {
        Robot::nominal(&spec::RobotSpec {
            gravity: spec::Gravity::On,
            friction,
            ..spec::RobotSpec::default()
        })
    }

    /// Heavier links, more friction, other rotors.
    fn other(mut arm: Robot) -> Robot {
        for (joint, link) in arm.links.iter_mut().enumerate() {
            link.mass *= 1.0 + 0.1 * (joint as f64 - 2.0).sin();
            link.com = link.com.map(|x| 1.1 * x);
        }
        arm.damping.iter_mut().for_each(|damping| *damping *= 0.8);
        arm.armature.iter_mut().for_each(|armature| *armature *= 1.3);
        if let Some(friction) = &mut arm.friction {
            friction.phi1_nm.iter_mut().for_each(|phi1| *phi1 *= 1.4);
        }
        arm
    }

    fn difference(some: &[f64], others: &[f64]) -> f64 {
        let squares = some.iter().zip(others).map(|(a, b)| (a - b).powi(2));
        (squares.sum::<f64>() / some.len() as f64).sqrt()
    }

    #[test]
    fn the_fit_takes_the_torques_of_a_known_arm_on_a_motion_that_it_has_not_seen() {
        for friction in [None, Some(spec::Friction::default())] {
            let nominal = nominal(friction);
            let truth = other(nominal.clone());
            let (seen, unseen) = (motion(0.0), motion(0.9));
            let acted = torques(&truth, &seen);
            let record = Record { motion: &seen, torques: &acted, rate_hz: RATE_HZ };
            let fitted = LinearArm::new(nominal.clone()).fit(&record).unwrap();
            let expected = torques(&truth, &unseen);
            let of_fitted = difference(&torques(&fitted.robot, &unseen), &expected);
            let of_nominal = difference(&torques(&nominal, &unseen), &expected);
            assert!(of_fitted < 0.02 * of_nominal, "{of_fitted} N·m, nominal {of_nominal} N·m");
        }
    }

    #[test]
    fn an_offset_of_the_torques_is_found_beside_the_arm() {
        let nominal = nominal(None);
        let seen = motion(0.0);
        let mut acted = torques(&nominal, &seen);
        acted.iter_mut().skip(3).step_by(7).for_each(|torque| *torque += 0.5);
        let record = Record { motion: &seen, torques: &acted, rate_hz: RATE_HZ };
        let fitted = LinearArm::new(nominal).fit(&record).unwrap();
        assert!((fitted.offset_nm[3] - 0.5).abs() < 0.05, "{:?}", fitted.offset_nm);
    }

    #[test]
    fn friction_that_is_steeper_than_the_nominal_one_is_found() {
        let nominal = nominal(Some(spec::Friction::default()));
        let mut truth = nominal.clone();
        if let Some(friction) = &mut truth.friction {
            friction.phi2_s_rad[3] = STEEP;
            friction.phi3_rad_s[3] = 0.0;
        }
        let seen = motion(0.0);
        let acted = torques(&truth, &seen);
        let record = Record { motion: &seen, torques: &acted, rate_hz: RATE_HZ };
        let found = LinearArm::new(nominal).fit(&record).unwrap().robot.friction.unwrap();
        assert_eq!(found.phi2_s_rad, truth.friction.unwrap().phi2_s_rad);
    }

    #[test]
    fn no_damping_and_no_friction_comes_out_negative() {
        let nominal = nominal(Some(spec::Friction::default()));
        let seen = motion(0.0);
        let pushed: Vec<f64> = torques(&nominal, &seen)
            .iter()
            .zip(seen.qd())
            .map(|(torque, qd)| torque - 30.0 * qd)
            .collect();
        let record = Record { motion: &seen, torques: &pushed, rate_hz: RATE_HZ };
        let fitted = LinearArm::new(nominal).fit(&record).unwrap().robot;
        let friction = fitted.friction.unwrap();
        let resistances = fitted.damping.iter().chain(&friction.phi1_nm).chain(&fitted.armature);
        assert!(resistances.into_iter().all(|value| *value >= 0.0));
        assert!(fitted.links.iter().all(|link| link.mass > 0.0));
    }

    #[test]
    fn a_motion_without_instants_has_no_fit() {
        let none = JointMotion::new(7, vec![], vec![], vec![]).unwrap();
        let record = Record { motion: &none, torques: &[], rate_hz: RATE_HZ };
        assert!(LinearArm::new(nominal(None)).fit(&record).is_none());
    }
}
