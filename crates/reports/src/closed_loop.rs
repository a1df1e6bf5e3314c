use wire::{ControlReport, ControllerSummary, Interval};

use crate::table::{Align, Table};

/// The report of a control job as text, with one row per controller.
pub fn closed_loop_text(name: &str, report: &ControlReport) -> String {
    let seconds = f64::from(report.steps) / report.rate_hz;
    format!(
        "\n{name}: tracking error in degrees of {} robots over {seconds} s: mean [95 % confidence \
         interval]\n\n{}\n{}",
        report.robots,
        table(report),
        crate::warnings(&report.warnings, report.robots, "robots")
    )
}

fn table(report: &ControlReport) -> String {
    let columns = [
        ("", Align::Left),
        ("RMS", Align::Right),
        ("largest", Align::Right),
        ("torque, N·m", Align::Right),
        ("beyond excitation", Align::Right),
        ("plan, median / p99 ms", Align::Right),
    ];
    let mut table = Table::new(columns);
    for controller in &report.controllers {
        table.push(row(controller));
    }
    table.render()
}

fn row(controller: &ControllerSummary) -> Vec<String> {
    let number = |value: Option<f64>| value.map_or_else(none, |value| format!("{value:.2}"));
    let rms = match (controller.rms_deg, &controller.failure) {
        (Some(Interval { mean, low, high }), _) => format!("{mean:.2} [{low:.2}, {high:.2}]"),
        (None, Some(reason)) => format!("failed {reason}"),
        (None, None) => none(),
    };
    let share = controller.beyond_excitation.map(|share| format!("{:.1} %", 100.0 * share));
    let plan = controller.plan.map(|plan| format!("{:.1} / {:.1}", plan.median_ms, plan.p99_ms));
    vec![
        controller.info.name.clone(),
        rms,
        number(controller.peak_deg),
        number(controller.torque_rms_nm),
        share.unwrap_or_else(none),
        plan.unwrap_or_else(none),
    ]
}

fn none() -> String {
    "-".to_owned()
}
