//! Predictors that learn nothing from other robots. A learned model has to beat them.

mod arx;
mod base_parameters;
mod constant_velocity;
mod continuation;
mod damped_integrator;
mod end_state;
mod filtered;
mod fitted_damping;
#[cfg(test)]
pub(crate) mod fixture;
mod follow_reference;
mod hold_last;
mod identification;
mod joint_ekf;
mod known_controller;
mod least_squares;
mod linear_arm;
mod oracle;
mod prior;
mod ridge;
mod rollout;

use dynamics::{InstructionSet, Joints, Replay, Scenario};
use spec::{
    Baseline, DataSpec, Given, InertiaScheme, Integrator, Precision, RobotSpec, SimulateSpec,
};

use self::filtered::Filtered;
use crate::Predictor;

pub use arx::Arx;
pub use base_parameters::BaseParameters;
pub use constant_velocity::ConstantVelocity;
pub use damped_integrator::DampedIntegrator;
pub use fitted_damping::FittedDamping;
pub use follow_reference::FollowReference;
pub use hold_last::HoldLast;
pub use identification::Identification;
pub use joint_ekf::JointEkf;
pub use known_controller::KnownController;
pub use least_squares::LeastSquares;
pub use oracle::Oracle;
pub(crate) use rollout::to_f32;

/// The knowledge that baselines may have of the arms: the nominal arm around which robots are
/// drawn, the ranges of the draws, and the simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct NominalArm {
    /// The arm and how robots differ from it.
    pub robot: RobotSpec,
    /// Samples per second.
    pub rate_hz: f64,
    /// The scheme of the simulation.
    pub integrator: Integrator,
    /// The format of its numbers.
    pub precision: Precision,
}

impl NominalArm {
    /// The arm around which a simulation draws robots. For recordings, the import names it. By
    /// default it is the Panda of the default spec, ±10 %.
    pub fn of(data: &DataSpec) -> Self {
        match data {
            DataSpec::Simulation(spec) => Self::of_simulation(spec),
            DataSpec::Import(spec) => Self {
                robot: spec.robot(),
                rate_hz: spec.rate_hz,
                integrator: Integrator::default(),
                precision: Precision::default(),
            },
        }
    }

    /// The arm around which a simulation draws robots.
    pub fn of_simulation(spec: &SimulateSpec) -> Self {
        Self {
            robot: spec.robot.clone(),
            rate_hz: spec.rate_hz,
            integrator: spec.sample_integrator(),
            precision: spec.precision,
        }
    }

    /// The simulation, on the best instruction set.
    fn replay(&self) -> Replay {
        let Self { rate_hz, integrator, precision, .. } = *self;
        Replay { rate_hz, integrator, precision, instructions: InstructionSet::best() }
    }
}

/// A simulation knows this of the scenarios of a question, in order.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// The spec that they were drawn by.
    pub spec: SimulateSpec,
    /// The random choices: robots, and references with gains.
    pub scenarios: Vec<Scenario>,
    /// The velocities at the last sample of the context, rad/s.
    pub velocities: Vec<Joints<f64>>,
}

/// The prior knowledge of a baseline about the arms of `data`, where it is `given` one kind of
/// series. Reports call it `told`.
///
/// `identification` and `joint-ekf` are told how simulated robots differ. Nobody knows that of recordings: there they
/// assume the randomization of the arm that their import names, and friction and payload only if
/// the import gives them.
pub fn prior_knowledge(name: Baseline, given: Given, data: &DataSpec) -> String {
    let told = name.prior_knowledge(given);
    if !matches!(name, Baseline::Identification | Baseline::JointEkf) {
        return told.to_owned();
    }
    let untold: Vec<&str> = match data {
        DataSpec::Simulation(spec) => {
            let robot = &spec.robot;
            let is_free = robot.inertia_scheme == InertiaScheme::PerEntry;
            if is_free && robot.inertia_fraction > 0.0 {
                vec!["products of inertia"]
            } else {
                vec![]
            }
        }
        DataSpec::Import(spec) => {
            let robot = spec.robot();
            let parts =
                [("friction", robot.friction.is_none()), ("payload", robot.payload.is_none())];
            parts.into_iter().filter_map(|(part, is_absent)| is_absent.then_some(part)).collect()
        }
    };
    match untold.as_slice() {
        [] => told.to_owned(),
        parts => format!("{told}; not {}", parts.join(" and ")),
    }
}

/// The predictor with the name `baseline`. An [`Oracle`] knows no robots here. With noise, most use
/// smoothed positions ([`Filtered`]). `arx` and those that simulate an arm use both kinds.
pub fn baseline(baseline: Baseline, arm: &NominalArm) -> Box<dyn Predictor> {
    let damping = || arm.robot.damping_nm_s_rad.clone();
    let filtered = |predictor| -> Box<dyn Predictor> { Box::new(Filtered(predictor)) };
    match baseline {
        Baseline::HoldLast => filtered(Box::new(HoldLast)),
        Baseline::ConstantVelocity => filtered(Box::new(ConstantVelocity)),
        Baseline::FollowReference => filtered(Box::new(FollowReference)),
        Baseline::DampedIntegrator => {
            filtered(Box::new(DampedIntegrator { damping_nm_s_rad: damping() }))
        }
        Baseline::FittedDamping => filtered(Box::new(FittedDamping)),
        Baseline::LeastSquares => Box::new(LeastSquares),
        Baseline::Arx => Box::new(Arx),
        Baseline::NominalSimulator => Box::new(Identification::nothing(arm)),
        Baseline::BaseParameters => Box::new(BaseParameters::new(arm)),
        Baseline::SimulatorFittedDamping => Box::new(Identification::dampings(arm)),
        Baseline::JointEkf => Box::new(JointEkf::new(arm)),
        Baseline::Identification => Box::new(Identification::new(arm)),
        Baseline::Oracle => Box::new(Oracle::new(arm, None)),
    }
}
