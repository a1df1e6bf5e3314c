use evaluation::{Interval, PairedDifference, Report};

use super::models;

/// How each trained model stands against the damped integrator and against holding the last
/// position, from differences on the same scenarios: a sentence each.
///
/// A difference counts when its 95 % interval leaves zero out.
pub fn verdicts(report: &Report) -> Vec<String> {
    models(report).filter_map(|model| verdict(report, &model.name)).collect()
}

fn verdict(report: &Report, model: &str) -> Option<String> {
    let clauses: Vec<String> = ["damped-integrator", "hold-last"]
        .into_iter()
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
    let differences: Vec<&PairedDifference> = report
        .paired
        .iter()
        .filter(|paired| paired.predictor == model && paired.against == against)
        .collect();
    let stands = |paired: &&PairedDifference| Standing::of(paired.difference_deg);
    let first = differences.first().map(stands)?;
    if differences.iter().all(|paired| stands(paired) == first) {
        let groups: Vec<String> =
            differences.iter().map(|paired| in_group(paired, first)).collect();
        return Some(format!("{} {against} {}", first.words(), groups.join(" and ")));
    }
    let groups: Vec<String> = differences
        .iter()
        .map(|paired| {
            let standing = stands(paired);
            format!("{} {against} {}", standing.words(), in_group(paired, standing))
        })
        .collect();
    Some(groups.join(", but "))
}

fn in_group(paired: &PairedDifference, standing: Standing) -> String {
    let Interval { mean, low, high } = paired.difference_deg;
    let group = &paired.group;
    match standing {
        Standing::Better => {
            let (mean, low, high) = (-mean, -high, -low);
            format!("{group} (by {mean:.2}°, 95 % CI {low:.2}° to {high:.2}°)")
        }
        Standing::Worse => format!("{group} (by {mean:.2}°, 95 % CI {low:.2}° to {high:.2}°)"),
        Standing::NotClear => {
            format!("{group} (difference {mean:+.2}°, 95 % CI {low:+.2}° to {high:+.2}°)")
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Standing {
    Better,
    Worse,
    NotClear,
}

impl Standing {
    fn of(difference: Interval) -> Self {
        if difference.high < 0.0 {
            Self::Better
        } else if difference.low > 0.0 {
            Self::Worse
        } else {
            Self::NotClear
        }
    }

    const fn words(self) -> &'static str {
        match self {
            Self::Better => "better than",
            Self::Worse => "worse than",
            Self::NotClear => "not clearly different from",
        }
    }
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
    fn without_a_trained_model_there_is_nothing_to_say() {
        let mut report = example();
        report.predictors.truncate(2);
        assert!(verdicts(&report).is_empty());
    }
}
