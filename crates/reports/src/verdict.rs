//! Verdicts: how a trained model compares with baselines, in a sentence.

use wire::{Interval, PairedDifference, PredictorKind, PredictorSummary, Report};

use super::{ComparisonOutcome, degrees, models, signed_degrees};

/// Verdicts on trained models, one sentence each. A model is compared with the strongest baseline,
/// with the damped integrator and with holding the last position, from differences on the same
/// scenarios.
///
/// With several levels of noise, the first level is used. Models that see the future get no
/// verdict. A difference counts if its 95 % confidence interval does not contain zero.
pub fn verdicts(report: &Report) -> Vec<String> {
    let honest = models(report).filter(|model| !model.sees_the_future());
    honest.filter_map(|model| verdict(report, &model.name)).collect()
}

/// The baseline with the lowest error in the first group. If there is one in distribution, it is
/// the first.
fn strongest(report: &Report) -> Option<&str> {
    let is_baseline = |rmse: &&PredictorSummary| {
        let mut infos = report.predictors.iter().filter(|info| info.competes());
        infos.any(|info| info.kind == PredictorKind::Baseline && info.name == rmse.predictor)
    };
    let errors = report.groups.first()?.rmse_deg.iter().filter(is_baseline);
    let best = errors.min_by(|a, b| a.interval.mean.total_cmp(&b.interval.mean))?;
    Some(&best.predictor)
}

fn verdict(report: &Report, model: &str) -> Option<String> {
    let plain = ["damped-integrator", "hold-last"];
    let strongest = strongest(report).filter(|name| !plain.contains(name));
    let clauses: Vec<String> = strongest
        .into_iter()
        .chain(plain)
        .filter_map(|against| clause(report, model, against))
        .collect();
    if clauses.is_empty() {
        None
    } else {
        Some(format!("{model} is {}.", clauses.join("; it is ")))
    }
}

/// For example "better than hold-last in distribution (by 5.50°, 95 % CI 5.00° to 6.00°)".
fn clause(report: &Report, model: &str, against: &str) -> Option<String> {
    let level = report.groups.first().map(|group| group.position_noise_rad);
    let differences: Vec<&PairedDifference> = report
        .paired
        .iter()
        .filter(|paired| paired.predictor == model && paired.against == against)
        .filter(|paired| Some(paired.position_noise_rad) == level)
        .collect();
    let outcome_of = |paired: &&PairedDifference| ComparisonOutcome::of(report, paired);
    let first = differences.first().map(outcome_of)?;
    if differences.iter().all(|paired| outcome_of(paired) == first) {
        let groups: Vec<String> =
            differences.iter().map(|paired| in_group(paired, first)).collect();
        return Some(format!("{} {against} {}", first.words(), groups.join(" and ")));
    }
    let groups: Vec<String> = differences
        .iter()
        .map(|paired| {
            let outcome = outcome_of(paired);
            format!("{} {against} {}", outcome.words(), in_group(paired, outcome))
        })
        .collect();
    Some(groups.join(", but "))
}

fn in_group(paired: &PairedDifference, outcome: ComparisonOutcome) -> String {
    let Interval { mean, low, high } = paired.difference_deg;
    let group = match paired.group.as_str() {
        "all scenarios" => "over all scenarios",
        group => group,
    };
    let (mean, low, high) = match outcome {
        ComparisonOutcome::Better => (-mean, -high, -low),
        ComparisonOutcome::Worse | ComparisonOutcome::NotClear | ComparisonOutcome::TooFew => {
            (mean, low, high)
        }
    };
    if matches!(outcome, ComparisonOutcome::NotClear | ComparisonOutcome::TooFew) {
        let [mean, low, high] = [mean, low, high].map(signed_degrees);
        return format!("{group} (difference {mean}°, 95 % CI {low}° to {high}°)");
    }
    let [mean, low, high] = [mean, low, high].map(degrees);
    format!("{group} (by {mean}°, 95 % CI {low}° to {high}°)")
}

#[cfg(test)]
mod tests {
    use super::super::example;
    use super::*;

    #[test]
    fn the_sentence_admits_a_baseline_that_wins_and_a_difference_that_is_not_clear() {
        assert_eq!(
            verdicts(&example()),
            ["robomorph is not clearly different from damped-integrator in distribution \
             (difference +0.20°, 95 % CI -0.30° to +0.70°), but worse than damped-integrator out of \
             distribution (by 1.20°, 95 % CI 0.70° to 1.70°); it is better than hold-last in \
             distribution (by 5.50°, 95 % CI 5.00° to 6.00°) and out of distribution (by 5.50°, \
             95 % CI 5.00° to 6.00°)."]
        );
    }

    #[test]
    fn a_few_scenarios_decide_nothing() {
        let mut report = example();
        report.groups[0].scenarios = 2;
        let verdict = &verdicts(&report)[0];
        let expected = "robomorph is compared on too few scenarios with damped-integrator in distribution \
                        (difference +0.20°, 95 % CI -0.30° to +0.70°), but worse than";
        assert!(verdict.starts_with(expected), "{verdict}");
    }

    #[test]
    fn the_strongest_baseline_comes_first_with_the_digits_that_matter() {
        let mut report = example();
        let identification = PredictorSummary {
            predictor: "identification".to_owned(),
            interval: Interval { mean: 0.0009, low: 0.0008, high: 0.001 },
        };
        let info = wire::PredictorInfo {
            name: "identification".to_owned(),
            ..report.predictors[0].clone()
        };
        report.predictors.insert(2, info);
        report.groups[0].rmse_deg.push(identification);
        let difference_deg = Interval { mean: 0.0042, low: 0.003, high: 0.005 };
        report.paired.push(PairedDifference {
            against: "identification".to_owned(),
            difference_deg,
            ..report.paired[0].clone()
        });
        let text = verdicts(&report).concat();
        let expected = "robomorph is worse than identification in distribution (by 0.0042°, \
                        95 % CI 0.0030° to 0.0050°); it is ";
        assert!(text.starts_with(expected), "{text}");
        assert!(super::super::text(&report).contains("0.00090 [0.00080, 0.0010]"));
    }

    #[test]
    fn without_a_trained_model_there_is_nothing_to_say() {
        let mut report = example();
        report.predictors.truncate(2);
        assert!(verdicts(&report).is_empty());
    }
}
