//! Looks up the errors of predictors in an evaluation's report.

use wire::{Interval, Report};

pub const IN_DISTRIBUTION: &str = "in distribution";
pub const OUT_OF_DISTRIBUTION: &str = "out of distribution";

/// Mean RMSE of a predictor over a group of cells.
pub fn rmse(report: &Report, group: &str, predictor: &str) -> Option<Interval> {
    let group = report.groups.iter().find(|found| found.name == group)?;
    let error = group.rmse_deg.iter().find(|error| error.predictor == predictor)?;
    Some(error.interval)
}

/// RMSE of `predictor` minus that of `against` on the same scenarios. Below 0 is better.
pub fn difference(
    report: &Report,
    group: &str,
    predictor: &str,
    against: &str,
) -> Option<Interval> {
    let find = |predictor: &str, against: &str| {
        let mut of_group = report.paired.iter().filter(|paired| paired.group == group);
        of_group.find(|paired| paired.predictor == predictor && paired.against == against)
    };
    find(predictor, against).map(|paired| paired.difference_deg).or_else(|| {
        let Interval { mean, low, high } = find(against, predictor)?.difference_deg;
        Some(Interval { mean: -mean, low: -high, high: -low })
    })
}
