//! Who is compared with whom: models come first, and baselines stand among those that know as much.

use wire::{GroupSummary, Interval, PredictorInfo, PredictorKind, Report};

use super::label;
use crate::ComparisonOutcome;
use crate::numbers::{degrees, signed_degrees};

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
    let best_model = best(report, group, Standing::Model);
    let model = best_model.map(|(info, error)| {
        let place = place(group);
        format!("{} predicts the horizon{place} with an error of {}.", label(info), shown(error))
    });
    let compared = best_model.map(|(info, _)| info);
    let sentences = model.into_iter().chain(baselines(report, group, compared));
    sentences.collect::<Vec<_>>().join(" ")
}

/// The errors of one predictor in a few sentences, and the best baselines beside it. Empty without an error of it.
pub fn answer_for(report: &Report, predictor: &str) -> String {
    let Some(info) = report.predictors.iter().find(|info| info.name == predictor) else {
        return String::new();
    };
    let error = |group: &GroupSummary| Some(shown(interval(group, info)?) + &place(group));
    let errors: Vec<String> = report.groups.iter().filter_map(error).collect();
    let (Some(group), [_, ..]) = (report.groups.first(), &errors[..]) else {
        return String::new();
    };
    let model = format!("{} predicts with an error of {}.", label(info), errors.join(" and "));
    [model].into_iter().chain(baselines(report, group, Some(info))).collect::<Vec<_>>().join(" ")
}

/// The predictor of this standing with the smallest error.
fn best<'a>(
    report: &'a Report,
    group: &GroupSummary,
    standing: Standing,
) -> Option<(&'a PredictorInfo, Interval)> {
    let of = report.predictors.iter().filter(|info| Standing::of(info) == standing);
    let errors = of.filter_map(|info| Some((info, interval(group, info)?)));
    errors.min_by(|(_, a), (_, b)| a.mean.total_cmp(&b.mean))
}

/// A sentence about the best baseline that is told nothing, and one about the best that is told
/// something. Each says if `model` is not clearly different.
fn baselines(
    report: &Report,
    group: &GroupSummary,
    model: Option<&PredictorInfo>,
) -> impl Iterator<Item = String> {
    let doubt = |baseline: &PredictorInfo| {
        let difference = report.difference(group, &model?.name, &baseline.name)?;
        let doubt = ComparisonOutcome::on(group.scenarios, difference).doubt()?;
        let [mean, low, high] =
            [difference.mean, difference.low, difference.high].map(signed_degrees);
        Some(format!(", {doubt} ({mean}° [{low}, {high}])"))
    };
    let says = |(info, Interval { mean, .. }): (&PredictorInfo, Interval)| {
        format!("{}, has {}°{}", label(info), degrees(mean), doubt(info).unwrap_or_default())
    };
    let untold = best(report, group, Standing::Untold).map(says);
    let told = best(report, group, Standing::Told).map(says);
    let untold = untold.map(|it| format!("The best baseline that is told nothing, {it}."));
    untold.into_iter().chain(told.map(|it| format!("The best that is told the arm, {it}.")))
}

/// Where the scenarios of a group are, to follow other words.
fn place(group: &GroupSummary) -> String {
    match group.name.as_str() {
        "" => String::new(),
        name if name.starts_with("in ") || name.starts_with("out of ") => format!(" {name}"),
        name => format!(" in {name}"),
    }
}

fn shown(Interval { mean, low, high }: Interval) -> String {
    let [mean, low, high] = [mean, low, high].map(degrees);
    format!("{mean}° [{low}, {high}]")
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
             damped-integrator, has 2.00°, not clearly different (+0.20° [-0.30, +0.70])."
        );
    }

    #[test]
    fn an_answer_says_when_scenarios_are_too_few_and_nothing_when_the_difference_counts() {
        let mut report = example();
        report.groups[0].scenarios = 4;
        let few = "has 2.00°, too few scenarios to tell (+0.20° [-0.30, +0.70]).";
        assert!(answer(&report).ends_with(few), "{}", answer(&report));
        report.groups[0].scenarios = 100;
        report.paired[1].difference_deg = Interval { mean: 0.5, low: 0.1, high: 0.9 };
        assert!(answer(&report).ends_with("damped-integrator, has 2.00°."), "{}", answer(&report));
        report.paired.clear();
        assert!(answer(&report).ends_with("damped-integrator, has 2.00°."), "an older report");
    }

    #[test]
    fn a_predictor_is_told_with_its_errors_everywhere_and_the_baselines_beside_it() {
        let report = example();
        assert_eq!(
            answer_for(&report, "robomorph"),
            "robomorph predicts with an error of 2.50° [2.00, 3.00] in distribution and 2.50° [2.00, \
             3.00] out of distribution. The best baseline that is told nothing, damped-integrator, \
             has 2.00°, not clearly different (+0.20° [-0.30, +0.70])."
        );
        assert_eq!(answer_for(&report, "cdt"), "");
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
