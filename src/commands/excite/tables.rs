//! The report of an exciting motion as tables.

use identification::{ExcitationReport, JointExcitation, ParameterPrediction};
use reports::{Cell, Table, TableOf};
use series::median;
use wire::Unit;

fn number(value: f64) -> Cell {
    Cell::Number(value, Unit::Other)
}

/// Joints, parameters, the comparison with random motions, and assumptions.
pub fn text(report: &ExcitationReport) -> String {
    let mut text = joints(report).with_title();
    if let (Some(lowest_m), Some(table_z_m)) = (report.lowest_m, report.table_z_m) {
        text += &format!(
            "The joints from the third on and the hand stay {:.3} m above the table.\n\n",
            lowest_m - table_z_m
        );
    }
    text += &parameters_by_kind(&report.parameters).with_title();
    let random = &report.random;
    text += &format!(
        "{} combinations of {} unknown numbers show in some motion. The log det of their information is {:.1}; of {} random \
         motions within the same limits, the best has {:.1} and the middle one {:.1}.",
        report.base_parameters,
        report.unknown_numbers,
        report.log_det,
        random.count,
        random.best_log_det,
        random.median_log_det,
    );
    if let (Some(to_best), Some(to_median)) = (random.deviation_to_best, random.deviation_to_median)
    {
        text += &format!(
            " The standard deviations are {to_best:.2} and {to_median:.2} times theirs (median of the parameters that are \
             seen)."
        );
    }
    text += "\n";
    for assumption in &report.assumptions {
        text += &format!("assumed: {assumption}\n");
    }
    text
}

/// Every parameter, as CSV.
pub fn parameters(report: &ExcitationReport) -> String {
    let mut csv = String::from(
        "joint,parameter,unit,described,prior_standard_deviation,standard_deviation,seen\n",
    );
    for parameter in &report.parameters {
        let ParameterPrediction { name, unit, joint, value, prior_deviation, deviation, seen } =
            parameter;
        let seen = seen.map_or_else(String::new, |seen| format!("{seen:.3}"));
        csv += &format!("{joint},{name},{unit},{value},{prior_deviation},{deviation},{seen}\n");
    }
    csv
}

fn joints(report: &ExcitationReport) -> Table {
    type Of = fn(&JointExcitation) -> f64;
    let columns: [(&str, Of); 10] = [
        ("from, °", |joint| joint.position_rad[0].to_degrees()),
        ("to, °", |joint| joint.position_rad[1].to_degrees()),
        ("least, °", |joint| joint.position_limit_rad[0].to_degrees()),
        ("most, °", |joint| joint.position_limit_rad[1].to_degrees()),
        ("speed, rad/s", |joint| joint.velocity_rad_s),
        ("limit", |joint| joint.velocity_limit_rad_s),
        ("acceleration, rad/s²", |joint| joint.acceleration_rad_s2),
        ("limit", |joint| joint.acceleration_limit_rad_s2),
        ("torque, N·m", |joint| joint.torque_nm),
        ("limit", |joint| joint.torque_limit_nm),
    ];
    let table = TableOf::new(&report.joints).text("joint", |joint| joint.name.clone());
    let table = columns
        .into_iter()
        .fold(table, |table, (heading, of)| table.number(heading, move |joint| number(of(joint))));
    let title = format!(
        "A motion of {} s: {} harmonics of {:.4} Hz",
        report.seconds, report.harmonics, report.base_frequency_hz
    );
    let percent = 100.0 * report.margin;
    table.titled(title, format!("{percent:.0} % of each limit stays free"))
}

/// Kinds of parameters, each with its share of the joints' parameters that the motion shows.
fn parameters_by_kind(parameters: &[ParameterPrediction]) -> Table {
    const KINDS: [&str; 9] =
        ["mass", "center", "inertia", "coulomb", "viscous", "offset", "rotor", "gain", "bend"];
    const SEEN: f64 = 0.5;

    struct Kind {
        name: &'static str,
        count: usize,
        seen: usize,
        ratio: f64,
    }
    let kind = |name: &'static str| {
        let of_kind: Vec<&ParameterPrediction> = parameters
            .iter()
            .filter(|parameter| parameter.name.starts_with(name) && parameter.seen.is_some())
            .collect();
        let is_seen = |of: &&&ParameterPrediction| of.seen.is_some_and(|seen| seen >= SEEN);
        let ratios = of_kind.iter().map(|of| of.deviation / of.prior_deviation).collect();
        let (count, seen) = (of_kind.len(), of_kind.iter().filter(is_seen).count());
        Kind { name, count, seen, ratio: if count == 0 { 1.0 } else { median(ratios) } }
    };
    TableOf::new(KINDS.map(kind).into_iter().filter(|kind| kind.count > 0))
        .text("parameter", |kind| kind.name)
        .number("all", |kind| Cell::Count(kind.count as u64))
        .number("seen", |kind| Cell::Count(kind.seen as u64))
        .number("deviation, % of before", |kind| number(100.0 * kind.ratio))
        .titled(
            "Parameters after a recording of the motion",
            "seen: the recording removes half of the variance or more; deviation: the median of what is left of the \
             standard deviations",
        )
}
