//! The table of robots: one row per trajectory, with all values that determine it.

use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray, Float64Array, Int32Array, Int64Array};
use arrow_array::{RecordBatch, StringArray};
use arrow_schema::ArrowError;
use arrow_schema::SchemaRef;
use dynamics::{Kinematics, Pulses, Row, Scenario, Torques};
use spec::{Gravity, PULSES, RobotDescription, STEP_LEVELS, SimulateSpec};

const AXES: [&str; 3] = ["x", "y", "z"];

/// Arrays of the same length, each with its column's name.
#[derive(Default)]
struct Arrays {
    names: Vec<String>,
    arrays: Vec<ArrayRef>,
}

/// Parameters, initial state and excitation of each scenario. The columns are those of `schema`,
/// see [`SimulateSpec::robot_columns`].
pub(super) fn record_batch(
    schema: &SchemaRef,
    spec: &SimulateSpec,
    scenarios: &[Scenario],
) -> Result<RecordBatch, ArrowError> {
    let mut arrays = Arrays::default();
    arrays.design(spec, scenarios)?;
    let joints = spec.joints();
    arrays.initial_state(joints, scenarios);
    arrays.kinematics(spec.robot.description(), scenarios);
    (0..joints).for_each(|link| arrays.body(link, scenarios));
    arrays.friction(joints, scenarios);
    arrays.payload(scenarios);
    if spec.controller.is_some() {
        arrays.tracking(scenarios)?;
    } else {
        arrays.chirps(joints, scenarios);
        arrays.multisines(joints, scenarios);
        if spec.excitation.steps.is_some() {
            arrays.steps(joints, scenarios);
        }
        if spec.excitation.pulses.is_some() {
            arrays.pulses(joints, scenarios);
        }
    }
    let named = schema.fields().iter().map(|field| field.name());
    if !named.eq(&arrays.names) {
        let detail = "robots do not have the columns that their spec names".to_owned();
        return Err(ArrowError::SchemaError(detail));
    }
    RecordBatch::try_new(Arc::clone(schema), arrays.arrays)
}

impl Arrays {
    fn push(&mut self, name: impl Into<String>, array: ArrayRef) {
        self.names.push(name.into());
        self.arrays.push(array);
    }

    fn number(
        &mut self,
        name: impl Into<String>,
        scenarios: &[Scenario],
        value: impl Fn(&Scenario) -> f64,
    ) {
        let values: Vec<f64> = scenarios.iter().map(value).collect();
        self.push(name, Arc::new(Float64Array::from(values)));
    }

    /// The numbers; null for scenarios without one.
    fn number_or_null(
        &mut self,
        name: impl Into<String>,
        scenarios: &[Scenario],
        value: impl Fn(&Scenario) -> Option<f64>,
    ) {
        let array: Float64Array = scenarios.iter().map(value).collect();
        self.push(name, Arc::new(array));
    }

    fn design(&mut self, spec: &SimulateSpec, scenarios: &[Scenario]) -> Result<(), ArrowError> {
        let overflow = |what: &str, value: u64| {
            ArrowError::ArithmeticOverflow(format!("{what} {value} is too large"))
        };
        let mut indices = Vec::with_capacity(scenarios.len());
        let mut draws = Vec::with_capacity(scenarios.len());
        for scenario in scenarios {
            let index = scenario.index;
            indices.push(i32::try_from(index).map_err(|_| overflow("trajectory", index))?);
            let drawn = scenario.draws;
            draws.push(i32::try_from(drawn).map_err(|_| overflow("draws", drawn.into()))?);
        }
        let seed = i64::try_from(spec.seed).map_err(|_| overflow("seed", spec.seed))?;
        let families = scenarios.iter().map(|scenario| scenario.family.to_string());
        let compensated = spec.robot.gravity == Gravity::Compensated;
        self.push("trajectory", Arc::new(Int32Array::from(indices)));
        self.push("draws", Arc::new(Int32Array::from(draws)));
        self.push("seed", Arc::new(Int64Array::from(vec![seed; scenarios.len()])));
        self.push("family", Arc::new(StringArray::from_iter_values(families)));
        self.number("frequency_hz", scenarios, |s| s.frequency_hz);
        self.number("rate_hz", scenarios, |_| spec.rate_hz);
        self.number("gravity_m_s2", scenarios, |s| s.robot.gravity);
        let compensated = BooleanArray::from(vec![compensated; scenarios.len()]);
        self.push("gravity_compensated", Arc::new(compensated));
        Ok(())
    }

    fn initial_state(&mut self, joints: usize, scenarios: &[Scenario]) {
        for joint in 0..joints {
            self.number(format!("q0_{}", joint + 1), scenarios, |s| s.q0[joint]);
        }
        for joint in 0..joints {
            self.number(format!("qd0_{}", joint + 1), scenarios, |s| s.qd0[joint]);
        }
    }

    fn kinematics(&mut self, robot: &RobotDescription, scenarios: &[Scenario]) {
        let joints = robot.joints.len();
        for joint in 0..joints {
            let name = format!("a_{}", joint + 1);
            self.number(name, scenarios, |s| s.robot.kinematics.joints[joint].a_m);
        }
        for joint in 0..joints {
            let name = format!("d_{}", joint + 1);
            self.number(name, scenarios, |s| s.robot.kinematics.joints[joint].d_m);
        }
        self.number("flange", scenarios, |s| s.robot.kinematics.hand.d_m);
        if robot.hand.a_m != 0.0 {
            self.number("hand_a", scenarios, |s| s.robot.kinematics.hand.a_m);
        }
        for (joint, described) in robot.joints.iter().enumerate() {
            if described.is_shifted() {
                let names = AXES.map(|axis| format!("shift_{axis}_{}", joint + 1));
                self.shift(names, scenarios, |kinematics| kinematics.joints[joint]);
            }
        }
        if robot.hand.is_shifted() {
            let names = AXES.map(|axis| format!("hand_shift_{axis}"));
            self.shift(names, scenarios, |kinematics| kinematics.hand);
        }
    }

    fn shift(
        &mut self,
        names: [String; 3],
        scenarios: &[Scenario],
        row: impl Fn(&Kinematics) -> Row,
    ) {
        for (axis, name) in names.into_iter().enumerate() {
            self.number(name, scenarios, |s| row(&s.robot.kinematics).shift_m[axis]);
        }
    }

    fn body(&mut self, link: usize, scenarios: &[Scenario]) {
        const INERTIA: [(&str, usize, usize); 6] = [
            ("ixx", 0, 0),
            ("ixy", 0, 1),
            ("ixz", 0, 2),
            ("iyy", 1, 1),
            ("iyz", 1, 2),
            ("izz", 2, 2),
        ];
        let number = link + 1;
        self.number(format!("mass_{number}"), scenarios, |s| s.robot.links[link].mass);
        for (axis, name) in AXES.into_iter().enumerate() {
            let name = format!("com_{name}_{number}");
            self.number(name, scenarios, |s| s.robot.links[link].com[axis]);
        }
        for (name, row, column) in INERTIA {
            let name = format!("{name}_{number}");
            self.number(name, scenarios, |s| s.robot.links[link].inertia[row][column]);
        }
        self.number(format!("damping_{number}"), scenarios, |s| s.robot.damping[link]);
        self.number(format!("armature_{number}"), scenarios, |s| s.robot.armature[link]);
    }

    fn friction(&mut self, joints: usize, scenarios: &[Scenario]) {
        type Coefficient = (&'static str, fn(&dynamics::Friction) -> dynamics::Joints<f64>);
        const COEFFICIENTS: [Coefficient; 3] = [
            ("phi1", |friction| friction.phi1_nm),
            ("phi2", |friction| friction.phi2_s_rad),
            ("phi3", |friction| friction.phi3_rad_s),
        ];
        for (name, coefficient) in COEFFICIENTS {
            for joint in 0..joints {
                let name = format!("friction_{name}_{}", joint + 1);
                self.number_or_null(name, scenarios, |s| {
                    s.robot.friction.as_ref().map(|friction| coefficient(friction)[joint])
                });
            }
        }
    }

    fn payload(&mut self, scenarios: &[Scenario]) {
        let of = |s: &Scenario| s.robot.payload;
        self.number_or_null("payload_mass", scenarios, |s| of(s).map(|payload| payload.mass_kg));
        for (axis, name) in AXES.into_iter().enumerate() {
            let name = format!("payload_{name}");
            self.number_or_null(name, scenarios, |s| of(s).map(|payload| payload.center_m[axis]));
        }
        self.number_or_null("payload_radius", scenarios, |s| of(s).map(|payload| payload.radius_m));
    }

    fn tracking(&mut self, scenarios: &[Scenario]) -> Result<(), ArrowError> {
        let (mut references, mut controllers) = (Vec::new(), Vec::new());
        for scenario in scenarios {
            let tracking = scenario.excitation.tracking();
            references.push(json(tracking.map(|tracking| &tracking.reference))?);
            controllers.push(json(tracking.map(|tracking| &tracking.gains))?);
        }
        self.push("reference", Arc::new(StringArray::from(references)));
        self.push("controller", Arc::new(StringArray::from(controllers)));
        Ok(())
    }

    fn chirps(&mut self, joints: usize, scenarios: &[Scenario]) {
        type Coefficient = (&'static str, fn(&dynamics::Chirp) -> f64);
        const COEFFICIENTS: [Coefficient; 6] = [
            ("chirp_offset_nm", |chirp| chirp.offset_nm),
            ("chirp_amplitude_nm", |chirp| chirp.amplitude_nm),
            ("chirp_f1_hz", |chirp| chirp.f1_hz),
            ("chirp_f2_hz", |chirp| chirp.f2_hz),
            ("chirp_depth", |chirp| chirp.depth),
            ("chirp_phase_rad", |chirp| chirp.phase_rad),
        ];
        for (name, coefficient) in COEFFICIENTS {
            for joint in 0..joints {
                let name = format!("{name}_{}", joint + 1);
                self.number_or_null(name, scenarios, |s| match s.excitation.torques() {
                    Some(Torques::Chirp(joints)) => Some(coefficient(&joints[joint])),
                    _ => None,
                });
            }
        }
    }

    fn multisines(&mut self, joints: usize, scenarios: &[Scenario]) {
        for component in 0..4 {
            for joint in 0..joints {
                let of = |s: &Scenario| match s.excitation.torques() {
                    Some(Torques::Multisine(joints)) => Some(joints[joint]),
                    _ => None,
                };
                let number = joint + 1;
                let name = format!("multisine_amplitude{component}_nm_{number}");
                self.number_or_null(name, scenarios, |s| of(s).map(|m| m.amplitude_nm[component]));
                let name = format!("multisine_f{component}_hz_{number}");
                self.number_or_null(name, scenarios, |s| of(s).map(|m| m.frequency_hz[component]));
            }
        }
    }

    fn pulses(&mut self, joints: usize, scenarios: &[Scenario]) {
        for pulse in 0..PULSES {
            for joint in 0..joints {
                let of = |s: &Scenario| match s.excitation.torques() {
                    Some(Torques::Pulses(joints)) => Some(joints[joint]),
                    _ => None,
                };
                let number = joint + 1;
                let mut column = |name: &str, value: fn(&Pulses) -> [f64; PULSES]| {
                    let name = format!("pulses_{name}_{number}");
                    self.number_or_null(name, scenarios, |s| of(s).map(|p| value(&p)[pulse]));
                };
                column(&format!("level{pulse}_nm"), |pulses| pulses.level_nm);
                column(&format!("rest{pulse}_s"), |pulses| pulses.rest_s);
                column(&format!("rise{pulse}_s"), |pulses| pulses.rise_s);
                column(&format!("hold{pulse}_s"), |pulses| pulses.hold_s);
            }
        }
    }

    fn steps(&mut self, joints: usize, scenarios: &[Scenario]) {
        for level in 0..STEP_LEVELS {
            for joint in 0..joints {
                let of = |s: &Scenario| match s.excitation.torques() {
                    Some(Torques::Steps(joints)) => Some(joints[joint]),
                    _ => None,
                };
                let number = joint + 1;
                let name = format!("steps_level{level}_nm_{number}");
                self.number_or_null(name, scenarios, |s| of(s).map(|steps| steps.level_nm[level]));
                let name = format!("steps_hold{level}_s_{number}");
                self.number_or_null(name, scenarios, |s| of(s).map(|steps| steps.hold_s[level]));
            }
        }
    }
}

fn json(value: impl serde::Serialize) -> Result<String, ArrowError> {
    serde_json::to_string(&value).map_err(|error| ArrowError::JsonError(error.to_string()))
}
