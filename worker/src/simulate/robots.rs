//! The table of robots: one row per trajectory, with all that made it.

use std::sync::Arc;

use arrow::array::{ArrayRef, Float64Array, Int32Array, RecordBatch, StringArray};
use arrow::datatypes::{DataType, Field, Schema};
use arrow::error::ArrowError;
use dynamics::{Scenario, Torques};
use spec::JOINTS;

/// Columns of a table, all of the same length.
struct Columns {
    fields: Vec<Field>,
    arrays: Vec<ArrayRef>,
}

/// Parameters, initial state and excitation of each scenario.
///
/// Columns of a joint or link end in its number, 1 to 7. Lengths in m, masses in kg, inertias in
/// kg·m² about the centre of mass in the axes of the link's frame (modified DH), damping in
/// N·m·s/rad, armature in kg·m², angles in rad, torques in N·m, frequencies in Hz. Coefficients
/// of the other excitation family are null.
pub(super) fn record_batch(scenarios: &[Scenario]) -> Result<RecordBatch, ArrowError> {
    let mut columns = Columns { fields: Vec::new(), arrays: Vec::new() };
    let int = |value: u64| i32::try_from(value).unwrap_or(i32::MAX);
    let indices = Int32Array::from_iter_values(scenarios.iter().map(|s| int(s.index)));
    let draws = Int32Array::from_iter_values(scenarios.iter().map(|s| int(s.draws.into())));
    let families = StringArray::from_iter_values(scenarios.iter().map(|s| s.family.to_string()));
    columns.push("trajectory", DataType::Int32, Arc::new(indices));
    columns.push("draws", DataType::Int32, Arc::new(draws));
    columns.push("family", DataType::Utf8, Arc::new(families));
    columns.number("frequency_hz", scenarios, |s| Some(s.frequency_hz));
    columns.number("gravity_m_s2", scenarios, |s| Some(s.robot.gravity));
    columns.initial_state(scenarios);
    columns.links(scenarios);
    columns.chirps(scenarios);
    columns.multisines(scenarios);
    RecordBatch::try_new(Arc::new(Schema::new(columns.fields)), columns.arrays)
}

impl Columns {
    fn push(&mut self, name: impl Into<String>, data_type: DataType, array: ArrayRef) {
        self.fields.push(Field::new(name, data_type, false));
        self.arrays.push(array);
    }

    /// A column of numbers; null where a scenario has none.
    fn number(
        &mut self,
        name: impl Into<String>,
        scenarios: &[Scenario],
        value: impl Fn(&Scenario) -> Option<f64>,
    ) {
        let array: Float64Array = scenarios.iter().map(value).collect();
        self.fields.push(Field::new(name, DataType::Float64, true));
        self.arrays.push(Arc::new(array));
    }

    fn initial_state(&mut self, scenarios: &[Scenario]) {
        for joint in 0..JOINTS {
            self.number(format!("q0_{}", joint + 1), scenarios, |s| Some(s.q0[joint]));
        }
        for joint in 0..JOINTS {
            self.number(format!("qd0_{}", joint + 1), scenarios, |s| Some(s.qd0[joint]));
        }
    }

    fn links(&mut self, scenarios: &[Scenario]) {
        const INERTIA: [(&str, usize, usize); 6] = [
            ("ixx", 0, 0),
            ("ixy", 0, 1),
            ("ixz", 0, 2),
            ("iyy", 1, 1),
            ("iyz", 1, 2),
            ("izz", 2, 2),
        ];
        for link in 0..JOINTS {
            let number = link + 1;
            self.number(format!("mass_{number}"), scenarios, |s| Some(s.robot.links[link].mass));
            for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
                let name = format!("com_{name}_{number}");
                self.number(name, scenarios, |s| Some(s.robot.links[link].com[axis]));
            }
            for (name, row, column) in INERTIA {
                let name = format!("{name}_{number}");
                self.number(name, scenarios, |s| Some(s.robot.links[link].inertia[row][column]));
            }
            self.number(format!("damping_{number}"), scenarios, |s| Some(s.robot.damping[link]));
            self.number(format!("armature_{number}"), scenarios, |s| Some(s.robot.armature[link]));
        }
    }

    fn chirps(&mut self, scenarios: &[Scenario]) {
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
            for joint in 0..JOINTS {
                self.number(format!("{name}_{}", joint + 1), scenarios, |s| match &s.torques {
                    Torques::Chirp(joints) => Some(coefficient(&joints[joint])),
                    Torques::Multisine(_) => None,
                });
            }
        }
    }

    fn multisines(&mut self, scenarios: &[Scenario]) {
        for component in 0..4 {
            for joint in 0..JOINTS {
                let of = |s: &Scenario| match &s.torques {
                    Torques::Multisine(joints) => Some(joints[joint]),
                    Torques::Chirp(_) => None,
                };
                let number = joint + 1;
                let name = format!("multisine_amplitude{component}_nm_{number}");
                self.number(name, scenarios, |s| of(s).map(|m| m.amplitude_nm[component]));
                let name = format!("multisine_f{component}_hz_{number}");
                self.number(name, scenarios, |s| of(s).map(|m| m.frequency_hz[component]));
            }
        }
    }
}
