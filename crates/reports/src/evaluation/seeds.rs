//! Trainings that differ only in seeds, as one row each.

use wire::{GroupSummary, ReplicatedError, ReplicationSummary, Report, Unit};

use crate::numbers::value;
use crate::{Cell, Table, TableOf};

/// The RMSE over the first part of the horizon of each model with several trainings. Its intervals
/// cover robots and seeds.
pub(crate) fn over_seeds(report: &Report) -> Table {
    let rows: Vec<(&GroupSummary, &ReplicationSummary)> = report
        .groups
        .iter()
        .flat_map(|group| group.replications.iter().map(move |entry| (group, entry)))
        .filter(|(_, entry)| entry.predictors.len() > 1)
        .collect();
    let first = rows.first().map_or(&[][..], |(_, entry)| &entry.errors);
    let seconds: Vec<f64> = first.iter().map(|error| error.seconds).collect();
    let names = TableOf::new(rows)
        .text("trainings", |(_, entry)| entry.predictors.join(", "))
        .text("scenarios", |(group, _)| group.name.as_str());
    let with_seconds = seconds.into_iter().fold(names, |table, seconds| {
        let cell = |error: &ReplicatedError| Cell::Interval(error.rmse_deg, Unit::Degrees);
        table.number(&format!("{} s", value(seconds)), |(_, entry)| {
            entry.errors.iter().find(|error| error.seconds == seconds).map(cell)
        })
    });
    with_seconds.titled(
        "RMSE in degrees over the first part of the horizon, as a mean over trainings that differ only in seeds",
        "",
    )
}

#[cfg(test)]
mod tests {
    use wire::Interval;

    use super::*;
    use crate::example;

    #[test]
    fn only_models_with_several_trainings_have_a_row() {
        let mut report = example();
        assert!(over_seeds(&report).rows.is_empty());
        let entry = |names: &[&str], mean| ReplicationSummary {
            predictors: names.iter().map(|&name| name.to_owned()).collect(),
            errors: vec![ReplicatedError {
                seconds: 0.5,
                rmse_deg: Interval { mean, low: mean - 1.0, high: mean + 1.0 },
                seed_rmse_deg: vec![mean; names.len()],
            }],
            diverged: 0.0,
        };
        report.groups[0].replications = vec![entry(&["arx"], 3.0), entry(&["law-1", "law-2"], 2.0)];
        let text = over_seeds(&report).render();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 2, "{text}");
        assert!(lines[1].starts_with("law-1, law-2  in distribution  2.00 [1.00, 3.00]"), "{text}");
    }
}
