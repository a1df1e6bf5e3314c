//! The report of an identification: its tables, its headline, and its parameters as CSV.

use wire::{
    ArmReport, Correlation, HorizonErrors, IdentificationReport, LoadReport, ParameterEstimate,
    TorqueResidual, Unit,
};

use crate::numbers::{degrees, value};
use crate::{Cell, Table, TableOf};

/// All tables with rows, in the order of the page.
pub fn tables(report: &IdentificationReport) -> Vec<Table> {
    let arm = &report.arm;
    let mut tables = vec![
        errors("Errors on the validation, °", arm, &arm.validation_errors),
        torques("Torque that is left on the validation, N·m", &arm.validation_torques),
        errors("Errors on the recordings of the fit, °", arm, &arm.errors),
        torques("Torque that is left on the recordings of the fit, N·m", &arm.torques),
    ];
    if report.loads.len() > 1 {
        tables.push(loads(&report.loads, &arm.horizons_s));
    } else if let Some(load) = &report.load {
        tables.push(of_load(load));
        tables.push(errors("Errors with the load, °", load, &load.errors));
        tables.push(errors(
            "Errors on the validation with the load, °",
            load,
            &load.validation_errors,
        ));
    }
    tables.push(parameters(arm));
    tables.push(correlations(&arm.correlated));
    tables.retain(|table| !table.rows.is_empty());
    tables
}

/// What the recordings determine, in a few sentences.
pub fn setting(report: &IdentificationReport) -> String {
    let ArmReport { directions, parameters, .. } = &report.arm;
    let mut setting = format!(
        "The recordings determine {} of {} combinations of parameters better than the description. \
         The condition number of these is {}.",
        directions.determined,
        directions.unknown,
        value(directions.condition),
    );
    if let Some(delay) = parameters.iter().find(|parameter| parameter.name == "delay") {
        setting += &timing(1e3 * delay.value, 1e3 * delay.deviation);
    }
    setting
}

/// A sentence about a delay of the torques and its standard deviation.
fn timing(late_ms: f64, deviation_ms: f64) -> String {
    let word = if late_ms < 0.0 { "early" } else { "late" };
    format!(" Torques are recorded {:.1} ± {deviation_ms:.1} ms {word}.", late_ms.abs())
}

/// Warnings about the arm and its load, one sentence each.
pub fn warnings(report: &IdentificationReport) -> Vec<String> {
    let of_load = report.load.iter().flat_map(|load| &load.warnings);
    let of_load = of_load.map(|warning| format!("with the load: {warning}"));
    let of_others = report.loads.iter().skip(1).flat_map(|load| {
        load.warnings
            .iter()
            .map(|warning| format!("with the load of {}: {warning}", load.recordings))
    });
    report.arm.warnings.iter().cloned().chain(of_load).chain(of_others).collect()
}

/// The error over the longest horizon in one line, and the mass of each load.
pub fn headline(report: &IdentificationReport) -> String {
    let arm = &report.arm;
    let (errors, on) = if arm.validation_errors.is_empty() {
        (&arm.errors, "on its own recordings")
    } else {
        (&arm.validation_errors, "on the validation")
    };
    let last = |name: &str| {
        let errors = errors.iter().find(|errors| errors.predictor == name)?;
        *errors.rmse_deg.last()?
    };
    let shown =
        |error: Option<f64>| error.map_or("diverged".to_owned(), |error| degrees(error) + "°");
    let horizon = arm.horizons_s.last().copied().unwrap_or_default();
    let mut line = format!(
        "{} over {horizon} s {on}; the description {}",
        shown(last("identified")),
        shown(last("description")),
    );
    let mut masses: Vec<(f64, f64)> =
        report.loads.iter().map(|load| (load.mass_kg, load.mass_deviation_kg)).collect();
    if masses.is_empty() {
        // A report of an older version.
        let mass = report.load.iter().flat_map(|load| &load.parameters);
        let mass = mass.filter(|parameter| parameter.name == "load_mass");
        masses.extend(mass.map(|mass| (mass.value, mass.deviation)));
    }
    let masses: Vec<String> = masses
        .into_iter()
        .map(|(mass, deviation)| format!("{} ± {} kg", value(mass), value(deviation)))
        .collect();
    match masses.as_slice() {
        [] => {}
        [mass] => line += &format!("; load {mass}"),
        masses => line += &format!("; loads {}", masses.join(", ")),
    }
    line
}

/// The report as text: all tables but those of single parameters.
pub fn text(report: &IdentificationReport) -> String {
    let shown = tables(report).into_iter().filter(|table| table.title != PARAMETERS);
    let mut text: String = shown.map(|table| table.with_title()).collect();
    text += &format!("{}\n", setting(report));
    for warning in warnings(report) {
        text += &format!("\nwarning: {warning}\n");
    }
    text
}

/// Every parameter, as CSV.
pub fn parameters_csv(report: &ArmReport) -> String {
    let mut csv = String::from("joint,parameter,unit,described,value,standard_deviation,seen\n");
    for ParameterEstimate { name, unit, joint, described, value, deviation, seen } in
        &report.parameters
    {
        let joint = joint.map_or_else(String::new, |joint| joint.to_string());
        let seen = seen.map_or_else(String::new, |seen| format!("{seen:.3}"));
        csv += &format!("{joint},{name},{unit},{described},{value},{deviation},{seen}\n");
    }
    csv
}

const PARAMETERS: &str = "Parameters";

fn number(value: f64) -> Cell {
    Cell::Number(value, Unit::Other)
}

fn parameters(arm: &ArmReport) -> Table {
    TableOf::new(&arm.parameters)
        .number("joint", |parameter| parameter.joint.map(|joint| Cell::Count(joint.into())))
        .text("parameter", |parameter| parameter.name.clone())
        .number("description", |parameter| number(parameter.described))
        .number("identified", |parameter| number(parameter.value))
        .number("standard deviation", |parameter| number(parameter.deviation))
        .text("unit", |parameter| parameter.unit.clone())
        .number("seen", |parameter| parameter.seen.map(|seen| Cell::Number(seen, Unit::Share)))
        .titled(
            PARAMETERS,
            "Links in the frames of the description. Seen: the share of the prior's variance that the recordings removed.",
        )
}

fn of_load(load: &ArmReport) -> Table {
    TableOf::new(load.parameters.iter().filter(|parameter| parameter.joint.is_none()))
        .text("load", |parameter| parameter.name.clone())
        .number("value", |parameter| number(parameter.value))
        .number("standard deviation", |parameter| number(parameter.deviation))
        .text("unit", |parameter| parameter.unit.clone())
        .titled("Load, in the hand's frame", "")
}

fn loads(loads: &[LoadReport], horizons_s: &[f64]) -> Table {
    let table = TableOf::new(loads)
        .text("recordings", |load| load.recordings.clone())
        .number("mass, kg", |load| number(load.mass_kg))
        .number("±", |load| number(load.mass_deviation_kg));
    let table = ["x", "y", "z"].into_iter().enumerate().fold(table, |table, (axis, name)| {
        table
            .number(&format!("centre {name}, m"), move |load| number(load.center_m[axis]))
            .number("±", move |load| number(load.center_deviation_m[axis]))
    });
    let table = horizons_s.iter().enumerate().fold(table, |table, (at, horizon)| {
        table.number(&format!("{horizon} s, °"), move |load| {
            let errors = load.errors.iter().find(|errors| errors.predictor == "identified");
            let error = errors.and_then(|errors| errors.rmse_deg.get(at).copied().flatten());
            error.map_or_else(|| Cell::Text("diverged".to_owned()), number)
        })
    });
    table.titled(
        "Loads, in the hand's frame",
        "±: standard deviation. The last columns: errors of the arm with its load on the load's recordings.",
    )
}

fn torques(title: &str, residuals: &[TorqueResidual]) -> Table {
    TableOf::new(residuals)
        .number("joint", |residual| Cell::Count(residual.joint.into()))
        .number("measured", |residual| number(residual.deviation_nm))
        .number("description", |residual| number(residual.described_nm))
        .number("identified", |residual| number(residual.identified_nm))
        .titled(title, "Measured: standard deviation of the torque. The others: root mean square of what they do not explain.")
}

fn errors(title: &str, arm: &ArmReport, errors: &[HorizonErrors]) -> Table {
    let table = TableOf::new(errors).text("predictor", |errors| errors.predictor.clone());
    let table = arm.horizons_s.iter().enumerate().fold(table, |table, (at, horizon)| {
        table.number(&format!("{horizon} s"), |errors| {
            let error = errors.rmse_deg.get(at).copied().flatten();
            error.map_or_else(|| Cell::Text("diverged".to_owned()), number)
        })
    });
    table.titled(title, "Root mean square over the time, mean over joints and windows. Predictions begin at the smoothed state.")
}

fn correlations(pairs: &[Correlation]) -> Table {
    TableOf::new(pairs)
        .text("parameter", |pair| pair.a.clone())
        .text("goes with", |pair| pair.b.clone())
        .number("correlation", |pair| number(pair.coefficient))
        .titled(
            "Parameters that are hard to tell apart",
            "The ten worst pairs whose coefficient of correlation is above 0.9.",
        )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torques_are_late_or_early() {
        assert_eq!(timing(11.76, 0.22), " Torques are recorded 11.8 ± 0.2 ms late.");
        assert_eq!(timing(-2.4, 0.1), " Torques are recorded 2.4 ± 0.1 ms early.");
    }
}
