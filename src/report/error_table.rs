use evaluation::{Interval, PredictorSummary, Report};

use super::label;
use crate::table::{Align, Table};

/// RMSE of every predictor in and out of distribution.
pub fn by_group(report: &Report) -> String {
    let mut table = predictor_columns(report, [("", Align::Left), ("scenarios", Align::Right)]);
    for group in &report.groups {
        let mut row = vec![group.name.clone(), group.scenarios.to_string()];
        row.extend(cells(report, &group.rmse_deg));
        table.push(row);
    }
    table.render()
}

/// RMSE of every predictor at every frequency; in distribution is marked by an asterisk.
pub fn by_frequency(report: &Report) -> String {
    let mut table = predictor_columns(report, [("excitation", Align::Left), ("Hz", Align::Right)]);
    for cell in &report.cells {
        let mark = if cell.in_distribution { "*" } else { " " };
        let mut row = vec![cell.family.to_string(), format!("{:.2}{mark}", cell.frequency_hz)];
        row.extend(cells(report, &cell.rmse_deg));
        table.push(row);
    }
    table.render()
}

fn predictor_columns(report: &Report, first: [(&str, Align); 2]) -> Table {
    let labels = report.predictors.iter().map(|predictor| (label(predictor), Align::Right));
    Table::new(first.map(|(name, align)| (name.to_owned(), align)).into_iter().chain(labels))
}

/// One cell per predictor, in the order of the columns.
fn cells(report: &Report, errors: &[PredictorSummary]) -> impl Iterator<Item = String> {
    report.predictors.iter().map(|predictor| {
        let error = errors.iter().find(|error| error.predictor == predictor.name);
        error.map_or_else(|| "-".to_owned(), |error| interval(error.interval))
    })
}

fn interval(Interval { mean, low, high }: Interval) -> String {
    format!("{mean:.2} [{low:.2}, {high:.2}]")
}

#[cfg(test)]
mod tests {
    use super::super::example;
    use super::*;

    #[test]
    fn in_and_out_of_distribution_are_apart_and_every_predictor_has_a_column() {
        let text = by_group(&example());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines,
            [
                "                     scenarios          hold-last  damped-integrator          robomorph",
                "in distribution            100  8.00 [7.50, 8.50]  2.00 [1.50, 2.50]  2.50 [2.00, 3.00]",
                "out of distribution        100  8.00 [7.50, 8.50]  2.00 [1.50, 2.50]  2.50 [2.00, 3.00]",
            ]
        );
    }

    #[test]
    fn a_frequency_in_distribution_is_marked() {
        let text = by_frequency(&example());
        assert!(text.contains("multisine   0.05 "), "{text}");
        assert!(text.contains("multisine   0.15*"), "{text}");
    }

    #[test]
    fn a_predictor_that_saw_the_future_is_labelled_in_the_table() {
        let mut report = example();
        report.predictors[2].normalization = Some(spec::Normalization::PaperLeaky);
        assert!(by_group(&report).contains("robomorph (paper-leaky)"));
    }
}
