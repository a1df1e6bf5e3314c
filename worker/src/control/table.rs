//! Tables of closed loops.

use evaluation::control::{RobotTrials, Trace};

/// A table with one row per controller and sample: time, path and positions after the torque,
/// torques.
pub(super) fn csv(rate_hz: f64, traces: &[(String, Trace)]) -> Result<Vec<u8>, csv::Error> {
    let mut table = csv::Writer::from_writer(Vec::new());
    let joints = traces.iter().flat_map(|(_, trace)| trace.path.first()).map(|q| q.len()).max();
    let joints = joints.unwrap_or(0);
    let of_joints =
        |name: &str, unit: &str| (1..=joints).map(|k| format!("{name}{k}_{unit}")).collect();
    let columns: [Vec<String>; 3] =
        [of_joints("path", "rad"), of_joints("q", "rad"), of_joints("u", "nm")];
    let names = ["controller", "time_s"].map(str::to_owned).into_iter();
    table.write_record(names.chain(columns.into_iter().flatten()))?;
    for (controller, trace) in traces {
        let samples = trace.path.iter().zip(&trace.positions).zip(&trace.torques);
        for (step, ((path, positions), torques)) in (1_u32..).zip(samples) {
            let path = path.iter().map(f64::to_string);
            let others = positions.iter().chain(torques).map(f32::to_string);
            let time = (f64::from(step) / rate_hz).to_string();
            table.write_record([controller.clone(), time].into_iter().chain(path).chain(others))?;
        }
    }
    written(table)
}

/// A table with one row per robot and controller.
pub(super) fn trials_csv(robots: &[RobotTrials]) -> Result<Vec<u8>, csv::Error> {
    let mut table = csv::Writer::from_writer(Vec::new());
    let names =
        ["robot", "controller", "rms_deg", "peak_deg", "torque_rms_nm", "beyond_excitation"];
    let joints = robots.first().map_or(0, |robot| robot.joints);
    let of_joints = (1..=joints).map(|joint| format!("rms{joint}_deg"));
    let names = names.map(str::to_owned).into_iter().chain(of_joints);
    table.write_record(names.chain(["clearance_rad".to_owned(), "failure".to_owned()]))?;
    for robot in robots {
        for trial in &robot.trials {
            let mut row = vec![robot.robot.to_string(), trial.controller.clone()];
            let numbers = trial.tracking.as_ref().map(|tracking| {
                let of_all = [
                    tracking.rms_deg,
                    tracking.peak_deg,
                    tracking.torque_rms_nm,
                    tracking.beyond_excitation,
                ];
                of_all
                    .into_iter()
                    .chain(tracking.joint_rms_deg.iter().copied())
                    .chain([tracking.clearance_rad])
            });
            match numbers {
                Some(numbers) => row.extend(numbers.map(|number| number.to_string())),
                None => row.extend(std::iter::repeat_n(String::new(), 5 + joints)),
            }
            row.push(trial.failure.clone().unwrap_or_default());
            table.write_record(row)?;
        }
    }
    written(table)
}

fn written(table: csv::Writer<Vec<u8>>) -> Result<Vec<u8>, csv::Error> {
    table.into_inner().map_err(|error| error.into_error().into())
}
