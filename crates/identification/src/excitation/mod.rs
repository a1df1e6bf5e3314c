//! Motions that show an arm's parameters.
//!
//! [`excite`] looks for the periodic motion within the limits of an arm that shows most of its
//! parameters. It maximizes log det of their information, the prior's included (D-optimality, as
//! Swevers et al. 1997, "Optimal robot excitation and identification", with a prior). The
//! information, the prior and the standard deviations are those of [`crate::identify`] at the
//! description's arm.
//!
//! Torques are linear in all parameters but for the speed at which Coulomb friction bends. The
//! description's speed is taken, or a usual one, and counts as known. For torque limits, Coulomb
//! friction counts with its full size in the worse direction, because it changes faster than any
//! grid of times shows.
//!
//! The search begins with random motions, which are made as large as the limits allow. The best of
//! them climb with a barrier at the limits, which they never leave. The result is the best motion that
//! also stays within the limits at ten times as many times.

mod base_parameters;
mod basis;
mod error;
mod limits;
mod objective;
mod report;
mod search;
mod settings;
mod steps;

use dynamics::Joints;
use nalgebra::DVector;
use spec::RobotDescription;

use self::base_parameters::{BaseParameters, regressor_at};
use self::basis::Basis;
pub use self::error::ExcitationError;
use self::limits::{Limits, TIME_TO_FULL_SPEED_S, heights};
use self::objective::Objective;
use self::report::deviations;
pub use self::report::{ExcitationReport, JointExcitation, ParameterPrediction, RandomMotions};
use self::search::{Candidate, improved, random_motions, random_posture};
pub use self::settings::ExcitationSettings;
use self::settings::USUAL_NOISE;
pub use self::steps::ExcitationProgress;
use self::steps::Steps;
use crate::arm::{Arm, Prior, described_bends};
use crate::estimates::posterior;
use crate::fourier::{Fourier, MotionState};
use crate::identify::Settings;
use crate::motion::{Motion, Recording, UNCERTAIN_S, whole};
use crate::torques::{ROWS_PER_SECOND, Torques};

/// The speed at which Coulomb friction bends, rad/s, if the description has none.
const BEND_RAD_S: f64 = 0.04;
/// Postures that are drawn until enough are allowed.
const MOST_POSTURES: u64 = 10_000;
/// Times of the search's grid per wave of the highest harmonic.
const TIMES_PER_WAVE: usize = 16;
/// The limits of the search are closer by this share. Positions, velocities and accelerations are sums
/// of waves, so between the grid's times they are at most 1/cos(π / 16) = 1.0196 times as large.
const TIGHTER: f64 = 0.02;
/// Times of the fine grid per time of the search's.
const FINER: usize = 10;

/// A motion that shows an arm's parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Excitation {
    /// The motion.
    pub motion: Fourier,
    /// The parameters that it shows, and its use of the limits.
    pub report: ExcitationReport,
    arm: Arm,
    linear: DVector<f64>,
}

impl Excitation {
    /// The torques that the described arm needs in a state, friction included, N·m.
    pub fn torques(&self, state: &MotionState) -> Joints<f64> {
        torques(&self.arm, &self.linear, state)
    }
}

fn torques(arm: &Arm, linear: &DVector<f64>, state: &MotionState) -> Joints<f64> {
    let regressor = regressor_at(arm, state);
    let torque = |row: &[f64]| row.iter().zip(linear.iter()).map(|(y, value)| y * value).sum();
    regressor.chunks(linear.len()).map(torque).collect()
}

/// Designs a motion for the arm of a description. The same description and settings give the same
/// motion.
///
/// # Errors
/// See [`ExcitationError`].
pub fn excite(
    description: &RobotDescription,
    settings: &ExcitationSettings,
    progress: ExcitationProgress<'_>,
) -> Result<Excitation, ExcitationError> {
    let joints = description.joints.len();
    settings.check()?;
    settings.check_lists(joints)?;
    let bends_rad_s = described_bends(description).unwrap_or_else(|| vec![BEND_RAD_S; joints]);
    let prior = Prior::of(description, &bends_rad_s, settings.gain_deviation)?;
    let arm = &prior.arm;
    let limits = Limits::of(description, arm, settings)?;
    let tight = limits.tightened(TIGHTER);
    let (base_frequency_hz, harmonics) = (settings.base_frequency_hz(), settings.harmonics());
    let times = (TIMES_PER_WAVE * harmonics).max(96);
    let basis = Basis::new(base_frequency_hz, harmonics, times, &tight);
    let base = BaseParameters::of(&prior.with_known_bends(), &limits);
    let noise_nm = settings
        .noise_nm
        .clone()
        .unwrap_or_else(|| description.per_joint(|joint| USUAL_NOISE * joint.torque_nm));
    let rows = ROWS_PER_SECOND * (settings.seconds - 2.0 * UNCERTAIN_S) / times as f64;
    let weights: Vec<f64> = noise_nm.iter().map(|noise| rows / (noise * noise)).collect();
    let linear = arm.linear();
    let objective = Objective {
        arm,
        basis: &basis,
        base: &base,
        limits: &tight,
        weights: &weights,
        linear: &linear,
    };

    let postures = postures(description, settings, &objective)?;
    let steps = Steps::new(progress);
    let random = random_motions(&objective, &postures, &steps);
    // Between the times of the search's grid, a motion may be a little nearer to its limits.
    let on_fine_grid = Objective { limits: &limits, ..objective };
    let fine = times * FINER;
    let states_of = |motion: &Fourier| -> Vec<MotionState> {
        let time_s = |time: usize| time as f64 / (fine as f64 * base_frequency_hz);
        (0..fine).map(|time| motion.at(time_s(time))).collect()
    };
    let stays_within =
        |found: &Candidate| on_fine_grid.is_allowed(states_of(&basis.motion(&found.variables)));
    let improved = improved(&objective, &random, &steps);
    if steps.are_stopped() {
        return Err(ExcitationError::Stopped);
    }
    let Candidate { variables, information: log_det } = improved
        .into_iter()
        .find(stays_within)
        .ok_or(ExcitationError::NoMotion { random_motions: settings.random_motions })?;
    let motion = basis.motion(&variables);
    let identified =
        |motion: &Fourier| deviations_after(&prior, motion, settings.seconds, &noise_nm);
    let parameters = identified(&motion)?;
    let of_random = |random: &Candidate| identified(&basis.motion(&random.variables));
    let random = RandomMotions::beside(&random, of_random, &parameters)?;
    let states = states_of(&motion);
    let excited = |index: usize| {
        JointExcitation::of(index, description, &limits, &states, noise_nm[index], |state| {
            torques(arm, &linear, state)[index]
        })
    };
    let lowest_m = settings.table_z_m.map(|_| lowest(&objective, &states));
    let report = ExcitationReport {
        seconds: settings.seconds,
        base_frequency_hz,
        harmonics,
        margin: settings.margin,
        table_z_m: settings.table_z_m,
        lowest_m,
        unknown_numbers: prior.deviations.iter().filter(|deviation| **deviation > 0.0).count(),
        base_parameters: BaseParameters::of(&prior, &limits).count(),
        log_det,
        random,
        joints: (0..joints).map(excited).collect(),
        parameters,
        assumptions: assumptions(description, settings, &bends_rad_s),
    };
    Ok(Excitation { motion, report, arm: prior.arm, linear })
}

/// The standard deviations of all parameters after an identification from this motion.
fn deviations_after(
    prior: &Prior,
    motion: &Fourier,
    seconds: f64,
    noise_nm: &[f64],
) -> Result<Vec<ParameterPrediction>, ExcitationError> {
    const RATE_HZ: f64 = 100.0;

    let samples = whole(seconds * RATE_HZ);
    let q: Vec<Vec<f64>> =
        (0..samples).map(|sample| motion.at(sample as f64 / RATE_HZ).q.to_vec()).collect();
    let u = vec![vec![0.0; noise_nm.len()]; samples];
    let recording = Recording { name: "the motion".to_owned(), rate_hz: RATE_HZ, q, u };
    let unlimited_nm = vec![f64::INFINITY; noise_nm.len()];
    let motion = Motion::new(&recording, &unlimited_nm, Settings::default().low_pass_hz)?;
    let torques = Torques::new(&prior.arm, &[motion]).weighed_by(noise_nm);
    let curvature = torques.normal_equations(&prior.arm).curvature;
    Ok(deviations(prior, &posterior(&curvature, &prior.deviations)))
}

/// The lowest origin in all of these states, m.
fn lowest(objective: &Objective<'_>, states: &[MotionState]) -> f64 {
    let mut all = Vec::new();
    states.iter().fold(f64::INFINITY, |lowest, state| {
        heights(&objective.arm.nominal().kinematics, &state.q, &mut all);
        all.iter().copied().fold(lowest, f64::min)
    })
}

/// Postures in which the arm can stand.
fn postures(
    description: &RobotDescription,
    settings: &ExcitationSettings,
    objective: &Objective<'_>,
) -> Result<Vec<Joints<f64>>, ExcitationError> {
    let limits = objective.limits;
    let rest = Joints::splat(limits.half.len(), 0.0);
    let at_rest = |q: Joints<f64>| MotionState { q, qd: rest, qdd: rest };
    let (mut allowed, mut over_table) = (Vec::new(), Vec::new());
    let mut highest_m = f64::NEG_INFINITY;
    for number in 0..MOST_POSTURES {
        let q = random_posture(&limits.middle, &limits.half, number);
        let height_m = lowest(objective, &[at_rest(q)]);
        highest_m = highest_m.max(height_m);
        if limits.floor_m.is_some_and(|floor_m| height_m <= floor_m) {
            continue;
        }
        over_table.push(q);
        if objective.is_allowed(vec![at_rest(q)]) {
            allowed.push(q);
        }
        if allowed.len() == settings.random_motions {
            break;
        }
    }
    if !allowed.is_empty() {
        return Ok(allowed);
    }
    if let (Some(table_z_m), true) = (settings.table_z_m, over_table.is_empty()) {
        let clearance_m = settings.clearance_m;
        let highest_m = highest_m - clearance_m;
        return Err(ExcitationError::Table { table_z_m, clearance_m, highest_m });
    }
    // The joint that is too weak in the posture that needs the least.
    let kept = 1.0 - settings.margin;
    let needs = |q: &Joints<f64>| {
        let torques = torques(objective.arm, objective.linear, &at_rest(*q));
        let need = |index: usize| {
            let least_nm = (torques[index].abs() + objective.arm.coulomb_nm(index)) / kept;
            (least_nm / description.joints[index].torque_nm, index, least_nm)
        };
        (0..torques.len()).map(need).max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let weakest = over_table.iter().filter_map(needs).min_by(|a, b| a.0.total_cmp(&b.0));
    let (_, index, least_nm) = weakest.unwrap_or((1.0, 0, 0.0));
    let joint = &description.joints[index];
    let (name, torque_nm, margin) = (joint.name.clone(), joint.torque_nm, settings.margin);
    Err(ExcitationError::Hold { index, name, torque_nm, margin, least_nm })
}

fn assumptions(
    description: &RobotDescription,
    settings: &ExcitationSettings,
    bends_rad_s: &[f64],
) -> Vec<String> {
    let mut assumptions = Vec::new();
    if settings.accelerations_rad_s2.is_none() {
        assumptions.push(format!(
            "accelerations: every joint reaches its highest speed in {TIME_TO_FULL_SPEED_S} s at the earliest"
        ));
    }
    if settings.noise_nm.is_none() {
        let percent = 100.0 * USUAL_NOISE;
        assumptions.push(format!(
            "noise: {percent} % of each joint's torque limit is left unexplained; the standard deviations of what the \
             motion shows are proportional to it"
        ));
    }
    if description.joints.iter().any(|joint| joint.friction.is_none()) {
        assumptions.push(
            "friction: where the arm has no Coulomb friction, 1 % of the torque limit, within a factor of 4.5".to_owned(),
        );
    }
    // Described speeds may differ from joint to joint.
    let mut speeds: Vec<String> = bends_rad_s.iter().map(f64::to_string).collect();
    speeds.dedup();
    assumptions.push(format!(
        "Coulomb friction bends at {} rad/s, within a factor of 2.7; the motion is not designed to show it",
        speeds.join(", ")
    ));
    assumptions
}
