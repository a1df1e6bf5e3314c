//! The report of an identification as tables.

use identification::{HORIZONS_S, HorizonErrors, ParameterEstimate, Report, TorqueResidual};
use reports::{Cell, Table, TableOf};
use wire::Unit;

fn number(value: f64) -> Cell {
    Cell::Number(value, Unit::Other)
}

/// Residual torques, errors and warnings.
pub fn text(report: &Report) -> String {
    let mut tables = vec![
        torques("Torque that is left of each joint, N·m", &report.torques),
        errors("Errors of predicted positions in degrees", &report.errors),
    ];
    if !report.validation_errors.is_empty() {
        tables.push(torques(
            "Torque that is left on the validation, N·m",
            &report.validation_torques,
        ));
        tables.push(errors("Errors on the validation in degrees", &report.validation_errors));
    }
    joined(tables, &report.warnings)
}

/// The load, and errors with it.
pub fn load(report: &Report) -> String {
    let of_load = report.parameters.iter().filter(|parameter| parameter.joint.is_none());
    let load = TableOf::new(of_load)
        .text("load", |parameter| parameter.name.clone())
        .number("value", |parameter| number(parameter.value))
        .number("standard deviation", |parameter| number(parameter.deviation))
        .text("unit", |parameter| parameter.unit)
        .titled("Load, in the hand's frame", "");
    let tables = vec![load, errors("Errors with the load in degrees", &report.errors)];
    joined(tables, &report.warnings)
}

/// Every parameter, as CSV.
pub fn parameters(report: &Report) -> String {
    let mut csv = String::from("joint,parameter,unit,described,value,standard_deviation,seen\n");
    for ParameterEstimate { name, unit, joint, nominal, value, deviation, seen } in
        &report.parameters
    {
        let joint = joint.map_or_else(String::new, |joint| joint.to_string());
        let seen = seen.map_or_else(String::new, |seen| format!("{seen:.3}"));
        csv += &format!("{joint},{name},{unit},{nominal},{value},{deviation},{seen}\n");
    }
    csv
}

fn torques(title: &str, residuals: &[TorqueResidual]) -> Table {
    TableOf::new(residuals)
        .number("joint", |residual| Cell::Count(residual.joint as u64))
        .number("measured", |residual| number(residual.deviation_nm))
        .number("description", |residual| number(residual.nominal_nm))
        .number("identified", |residual| number(residual.identified_nm))
        .titled(title, "measured: standard deviation of the torque; the others: root mean square of what they do not explain")
}

fn errors(title: &str, errors: &[HorizonErrors]) -> Table {
    let table = TableOf::new(errors).text("predictor", |errors| errors.predictor.clone());
    let table = HORIZONS_S.iter().enumerate().fold(table, |table, (at, horizon)| {
        table.number(&format!("{horizon} s"), |errors| number(errors.rmse_deg[at]))
    });
    table.titled(title, "root mean square over the time, mean over joints and windows; predictions begin at the smoothed state")
}

fn joined(tables: Vec<Table>, warnings: &[String]) -> String {
    let mut text: String = tables.into_iter().map(|table| table.with_title()).collect();
    for warning in warnings {
        text += &format!("\nwarning: {warning}\n");
    }
    text
}
