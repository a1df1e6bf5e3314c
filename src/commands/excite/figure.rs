//! A motion beside its limits.

use figures::{Axis, Curve, Figure, FigureError, Point, Size, stacked};
use identification::{Excitation, JointExcitation, MotionState};

/// In pixels, for each of four drawings.
const SIZE: Size = Size { width: 860, height: 260 };

/// Positions, velocities, accelerations and torques over a period, as shares of their limits.
pub fn svg(found: &Excitation) -> Result<String, FigureError> {
    const POINTS: u32 = 600;

    let report = &found.report;
    let period_s = 1.0 / report.base_frequency_hz;
    let times: Vec<f64> =
        (0..=POINTS).map(|point| period_s * f64::from(point) / f64::from(POINTS)).collect();
    let states: Vec<MotionState> = times.iter().map(|&time_s| found.motion.at(time_s)).collect();
    let torques: Vec<_> = states.iter().map(|state| found.torques(state)).collect();

    let panel = |title: &str, share: &dyn Fn(&JointExcitation, usize, usize) -> f64| {
        let of_joint = |(index, joint): (usize, &JointExcitation)| {
            let points = times.iter().enumerate();
            let points =
                points.map(|(at, &time_s)| Point::new(time_s, share(joint, index, at))).collect();
            Curve::line(joint.name.clone(), points)
        };
        let mut series: Vec<Curve> = report.joints.iter().enumerate().map(of_joint).collect();
        let kept = 1.0 - report.margin;
        let frame = [(0.0, kept), (period_s, kept), (period_s, -kept), (0.0, -kept), (0.0, kept)];
        let frame = frame.map(|(time_s, share)| Point::new(time_s, share)).to_vec();
        series.push(Curve::line("margin", frame).dashed());
        Figure {
            title: title.to_owned(),
            x: Axis::linear("time").in_unit("s"),
            y: Axis { range: Some((-1.0, 1.0)), ..Axis::linear("share of the limit") },
            series,
            bands: Vec::new(),
        }
    };
    let panels = [
        panel("Positions, from the middle of their limits", &|joint, index, at| {
            let [low, high] = joint.position_limit_rad;
            (states[at].q[index] - 0.5 * (low + high)) / (0.5 * (high - low))
        }),
        panel("Velocities", &|joint, index, at| states[at].qd[index] / joint.velocity_limit_rad_s),
        panel("Accelerations", &|joint, index, at| {
            states[at].qdd[index] / joint.acceleration_limit_rad_s2
        }),
        panel("Torques of the described arm", &|joint, index, at| {
            torques[at][index] / joint.torque_limit_nm
        }),
    ];
    stacked("An exciting motion within its limits", &panels, SIZE)
}
