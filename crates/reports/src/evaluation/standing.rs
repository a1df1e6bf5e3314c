//! Who is compared with whom: models come first, and baselines stand among those that know as much.

use wire::{GroupSummary, Interval, PredictorInfo, PredictorKind, Report};

use super::label;
use crate::numbers::degrees;

/// Predictors that are equals. The best of each kind is marked, if it has several.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Standing {
    /// Learned from other robots.
    Model,
    /// A baseline that is told nothing.
    Untold,
    /// A baseline that is told something of the arm.
    Told,
    /// It knows what it predicts, or is the robot itself.
    Beyond,
}

impl Standing {
    pub(crate) fn of(info: &PredictorInfo) -> Self {
        match info.kind {
            _ if !info.competes() => Self::Beyond,
            PredictorKind::Checkpoint | PredictorKind::Predictions => Self::Model,
            PredictorKind::Baseline
                if info.told.as_deref().is_none_or(|told| told == "nothing") =>
            {
                Self::Untold
            }
            PredictorKind::Baseline => Self::Told,
        }
    }
}

/// The report with its predictors by standing, and by their errors in the first group.
pub fn ranked(report: &Report) -> Report {
    let mut ranked = report.clone();
    let error = |info: &PredictorInfo| {
        let found = report.groups.first().and_then(|group| interval(group, info));
        found.map_or(f64::INFINITY, |interval| interval.mean)
    };
    ranked
        .predictors
        .sort_by(|a, b| Standing::of(a).cmp(&Standing::of(b)).then(error(a).total_cmp(&error(b))));
    ranked
}

/// The result in a few sentences: the best model, and the best baselines beside it. Empty without
/// a group that has errors.
pub fn answer(report: &Report) -> String {
    let Some(group) = report.groups.first() else { return String::new() };
    let best = |standing: Standing| {
        let of = report.predictors.iter().filter(|info| Standing::of(info) == standing);
        let errors = of.filter_map(|info| Some((info, interval(group, info)?)));
        errors.min_by(|(_, a), (_, b)| a.mean.total_cmp(&b.mean))
    };
    let says = |(info, Interval { mean, .. }): (&PredictorInfo, Interval)| {
        format!("{}, has {}°", label(info), degrees(mean))
    };
    let mut sentences = Vec::new();
    if let Some((info, Interval { mean, low, high })) = best(Standing::Model) {
        let group = match group.name.as_str() {
            "" => String::new(),
            name if name.starts_with("in ") || name.starts_with("out of ") => format!(" {name}"),
            name => format!(" in {name}"),
        };
        let [mean, low, high] = [mean, low, high].map(degrees);
        sentences.push(format!(
            "{} predicts the horizon{group} with an error of {mean}° [{low}, {high}].",
            label(info),
        ));
    }
    if let Some(untold) = best(Standing::Untold) {
        sentences.push(format!("The best baseline that is told nothing, {}.", says(untold)));
    }
    if let Some(told) = best(Standing::Told) {
        sentences.push(format!("The best that is told the arm, {}.", says(told)));
    }
    sentences.join(" ")
}

fn interval(group: &GroupSummary, info: &PredictorInfo) -> Option<Interval> {
    group.rmse_deg.iter().find(|error| error.predictor == info.name).map(|error| error.interval)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example;

    #[test]
    fn models_come_first_and_baselines_by_what_they_are_told() {
        let mut report = example();
        report.predictors[1].told = Some("the nominal damping".to_owned());
        let names: Vec<String> =
            ranked(&report).predictors.into_iter().map(|info| info.name).collect();
        assert_eq!(names, ["robomorph", "hold-last", "damped-integrator"]);
        assert_eq!(
            answer(&report),
            "robomorph predicts the horizon in distribution with an error of 2.50° [2.00, 3.00]. The \
             best baseline that is told nothing, hold-last, has 8.00°. The best that is told the arm, \
             damped-integrator, has 2.00°."
        );
    }

    #[test]
    fn a_group_that_is_no_place_gets_a_preposition() {
        let mut report = example();
        report.groups[0].name = "all scenarios".to_owned();
        assert!(
            answer(&report).starts_with("robomorph predicts the horizon in all scenarios with")
        );
    }

    #[test]
    fn a_report_without_models_answers_with_its_baselines() {
        let mut report = example();
        report.predictors.remove(2);
        assert_eq!(
            answer(&report),
            "The best baseline that is told nothing, damped-integrator, has 2.00°."
        );
        report.groups.clear();
        assert_eq!(answer(&report), "");
    }
}
