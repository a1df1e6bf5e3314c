//! The report of a control job: its tables, and sentences about its setting and its result.

use wire::{ControlReport, ControllerSummary, PlanTime};

use crate::numbers::{count, degrees, value};
use crate::{Cell, Table, TableOf};

/// All tables with rows, in the order of the page.
pub fn tables(report: &ControlReport) -> Vec<Table> {
    let tables = [tracking(report), paired(report)];
    tables.into_iter().filter(|table| !table.rows.is_empty()).collect()
}

/// The setting of the closed loops, in two sentences.
pub fn setting(report: &ControlReport) -> String {
    let seconds = |samples: u32| value(f64::from(samples) / report.rate_hz);
    let (robots, context, control_s) =
        (count(report.robots), report.context, seconds(report.steps));
    let rate_hz = report.rate_hz;
    let Some(planner) = &report.planner else {
        return format!(
            "{robots} robots, each under its own controller. After {context} samples at {rate_hz} Hz, \
             each predictor adds the torques for the next {control_s} s of the reference."
        );
    };
    format!(
        "{robots} robots, each excited for {context} samples and then controlled for {control_s} s at \
         {rate_hz} Hz. Every {} samples ({} s) a plan of {} samples ({} s) is made from {} × {} \
         foreseen torque sequences.",
        planner.replan_every,
        seconds(planner.replan_every),
        planner.horizon,
        seconds(planner.horizon),
        planner.iterations,
        planner.samples,
    )
}

/// The tracking errors in one line.
pub fn headline(report: &ControlReport) -> String {
    let of = |controller: &ControllerSummary| match controller.rms_deg {
        Some(rms) => format!("{} {}°", controller.info.name, degrees(rms.mean)),
        None => format!("{} failed", controller.info.name),
    };
    report.controllers.iter().map(of).collect::<Vec<_>>().join(", ")
}

/// The report as text.
pub fn text(name: &str, report: &ControlReport) -> String {
    format!(
        "\n{name}: {}\n\n{}{}",
        setting(report),
        tracking(report).with_title(),
        crate::warnings(&report.warnings, report.robots, "robots")
    )
}

fn tracking(report: &ControlReport) -> Table {
    let joints = |controller: &&ControllerSummary| {
        let joints = controller.joint_rms_deg.as_ref()?.iter().map(|rms| degrees(*rms));
        Some(joints.collect::<Vec<_>>().join(" "))
    };
    let failure = |controller: &&ControllerSummary| {
        let reason = controller.failure.as_ref()?;
        Some(format!("on {} robots: {reason}", controller.failed))
    };
    let plan = |PlanTime { median_ms, p99_ms, threads }: PlanTime| {
        format!("{median_ms:.1} / {p99_ms:.1}, {threads} threads")
    };
    let time = match report.planner {
        Some(_) => "plan, median / p99 ms",
        None => "torques, median / p99 ms",
    };
    TableOf::new(&report.controllers)
        .text("controller", |controller| controller.info.name.as_str())
        .measures(ControllerSummary::measures(), |controller| Some(*controller))
        .number(time, |controller| controller.plan.map(plan))
        .text("RMS of each joint, °", joints)
        .text("failed", failure)
        .titled("Tracking error, with 95 % intervals", "")
        .without_empty_columns()
}

fn paired(report: &ControlReport) -> Table {
    TableOf::new(&report.paired)
        .text("controller", |pair| pair.controller.as_str())
        .text("against", |pair| pair.against.as_str())
        .number("difference of RMS, °", |pair| Cell::Difference(pair.difference_deg))
        .titled("Paired differences on the same robots", "")
}
