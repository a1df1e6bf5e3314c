use spec::Family;
use wire::{
    CellSummary, GroupSummary, Interval, PredictorInfo, PredictorSummary, Report, at_noise,
};

use super::{degrees, label};
use crate::table::{Align, Table};

/// A table of every predictor's RMSE in and out of distribution, and of its knowledge about the
/// arms.
pub fn by_group(report: &Report) -> String {
    let groups = report.groups.iter().map(|group| {
        let GroupSummary { name, scenarios, position_noise_rad, .. } = group;
        // All levels of noise use the same scenarios.
        let is_noisy = *position_noise_rad > 0.0;
        let heading =
            if is_noisy { name.clone() } else { format!("{name} ({scenarios} scenarios)") };
        (heading, Align::Right)
    });
    let tells = report.predictors.iter().any(|predictor| predictor.told.is_some());
    let told = tells.then(|| ("told".to_owned(), Align::Left));
    let mut table =
        Table::new([(String::new(), Align::Left)].into_iter().chain(groups).chain(told));
    for predictor in &report.predictors {
        let errors = report.groups.iter().map(|group| error(predictor, &group.rmse_deg));
        let errors = errors.map(|error| error.map_or_else(none, interval));
        let told = tells.then(|| predictor.told.clone().unwrap_or_default());
        table.push(std::iter::once(label(predictor)).chain(errors).chain(told).collect());
    }
    table.render()
}

/// A table of every predictor's mean RMSE at every frequency, family by family. An asterisk marks
/// frequencies in distribution.
pub fn by_frequency(report: &Report) -> String {
    let mut levels: Vec<f64> = Vec::new();
    for cell in &report.cells {
        if !levels.contains(&cell.position_noise_rad) {
            levels.push(cell.position_noise_rad);
        }
    }
    let tables = Family::ALL.into_iter().flat_map(|family| {
        levels.iter().filter_map(move |&level| family_by_frequency(report, family, level))
    });
    tables.collect::<Vec<_>>().join("\n")
}

fn family_by_frequency(report: &Report, family: Family, level: f64) -> Option<String> {
    let is_here =
        |cell: &&CellSummary| cell.family == Some(family) && cell.position_noise_rad == level;
    let cells: Vec<&CellSummary> = report.cells.iter().filter(is_here).collect();
    if cells.is_empty() {
        return None;
    }
    let frequencies = cells.iter().map(|cell| {
        let mark = if cell.in_distribution { "*" } else { " " };
        (format!("{:.2}{mark}", cell.frequency_hz.unwrap_or_default()), Align::Right)
    });
    let mut table = Table::new(
        [(format!("{family}{}, Hz", at_noise(level)), Align::Left)].into_iter().chain(frequencies),
    );
    for predictor in &report.predictors {
        // Aligned with the frequencies, whose last place is for the mark.
        let errors = cells.iter().map(|cell| error(predictor, &cell.rmse_deg));
        let errors = errors
            .map(|error| error.map_or_else(none, |error| format!("{} ", degrees(error.mean))));
        table.push(std::iter::once(label(predictor)).chain(errors).collect());
    }
    Some(table.render())
}

fn error(predictor: &PredictorInfo, errors: &[PredictorSummary]) -> Option<Interval> {
    errors.iter().find(|error| error.predictor == predictor.name).map(|error| error.interval)
}

fn none() -> String {
    "-".to_owned()
}

fn interval(Interval { mean, low, high }: Interval) -> String {
    format!("{} [{}, {}]", degrees(mean), degrees(low), degrees(high))
}

#[cfg(test)]
mod tests {
    use super::super::example;
    use super::*;

    #[test]
    fn in_and_out_of_distribution_are_apart_and_every_predictor_has_a_row() {
        let text = by_group(&example());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines,
            [
                "                   in distribution (100 scenarios)  out of distribution (100 scenarios)",
                "hold-last                        8.00 [7.50, 8.50]                    8.00 [7.50, 8.50]",
                "damped-integrator                2.00 [1.50, 2.50]                    2.00 [1.50, 2.50]",
                "robomorph                        2.50 [2.00, 3.00]                    2.50 [2.00, 3.00]",
            ]
        );
    }

    #[test]
    fn levels_of_noise_stand_beside_each_other() {
        let mut report = example();
        let mut noisy = report.groups[0].clone();
        noisy.name = "in distribution at 0.001 rad".to_owned();
        noisy.position_noise_rad = 1e-3;
        report.groups.push(noisy);
        let cells = report
            .cells
            .iter()
            .map(|cell| CellSummary { position_noise_rad: 1e-3, ..cell.clone() });
        let noisy: Vec<CellSummary> = cells.collect();
        report.cells.extend(noisy);
        let text = by_group(&report);
        assert!(text.lines().next().unwrap().ends_with("  in distribution at 0.001 rad"), "{text}");
        let text = by_frequency(&report);
        let headings = text.lines().filter(|line| line.starts_with("multisine"));
        assert_eq!(
            headings.collect::<Vec<_>>(),
            ["multisine, Hz      0.05   0.15*", "multisine at 0.001 rad, Hz  0.05   0.15*"]
        );
    }

    #[test]
    fn what_predictors_are_told_is_the_last_column() {
        let mut report = example();
        report.predictors[1].told = Some("the nominal damping".to_owned());
        let text = by_group(&report);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].ends_with("  told"), "{text}");
        assert!(lines[2].ends_with("2.00 [1.50, 2.50]  the nominal damping"), "{text}");
        assert!(lines[3].ends_with("2.50 [2.00, 3.00]"), "{text}");
    }

    #[test]
    fn a_frequency_in_distribution_is_marked() {
        let text = by_frequency(&example());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "multisine, Hz      0.05   0.15*");
        assert_eq!(lines[1], "hold-last          8.00   8.00");
    }

    #[test]
    fn a_predictor_that_saw_the_future_is_labelled_in_the_table() {
        let mut report = example();
        report.predictors[2].sampling = Some(wire::SamplingInfo {
            curve: "robomorph ddpm oracle".to_owned(),
            kind: spec::SamplerKind::Ddpm,
            steps: 5,
            start: spec::Start::Oracle,
        });
        assert!(by_group(&report).contains("robomorph (leak: starts with the truth)"));
    }
}
