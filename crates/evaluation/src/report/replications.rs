//! Combines trainings that differ only in their seeds: the interval of a mean over seeds and
//! robots.

use rayon::prelude::*;
use series::student_quantile_975;
use spec::Bootstrap;
use wire::{Interval, PredictorInfo, ReplicatedError, ReplicationDifference, ReplicationSummary};

use super::comparisons::is_compared;
use crate::CellResult;
use crate::bootstrap::{stratified_mean, stratified_ratio};
use crate::scores::ScenarioErrors;

/// Groups of predictors with the same training, in the order of every table.
pub(super) fn groups(predictors: &[PredictorInfo]) -> Vec<Vec<&PredictorInfo>> {
    let mut groups: Vec<Vec<&PredictorInfo>> = Vec::new();
    for info in predictors {
        match groups.iter_mut().find(|group| are_replications(group[0], info)) {
            Some(group) => group.push(info),
            None => groups.push(vec![info]),
        }
    }
    groups
}

/// The errors over each part of the horizon of the predictors that were asked about all `cells`, and
/// their differences. Empty unless several trainings differ only in seeds.
pub(super) fn over_horizons(
    predictors: &[PredictorInfo],
    cells: &[&CellResult],
    bootstrap: Bootstrap,
) -> (Vec<ReplicationSummary>, Vec<ReplicationDifference>) {
    let groups = groups(predictors);
    if groups.iter().all(|group| group.len() == 1) {
        return (Vec::new(), Vec::new());
    }
    let is_asked =
        |info: &&PredictorInfo| cells.iter().all(|cell| cell.errors(&info.name).is_some());
    let entries: Vec<Entry<'_>> = groups
        .into_iter()
        .filter(|group| group.iter().all(is_asked))
        .map(|group| Entry::new(group, cells))
        .collect();
    let pairs = entries
        .iter()
        .enumerate()
        .flat_map(|(k, ours)| entries[..k].iter().map(move |theirs| (ours, theirs)))
        .filter(|(ours, theirs)| is_compared(ours.group[0], theirs.group[0], predictors));
    let pairs: Vec<_> = pairs.collect();
    let differences = pairs
        .into_par_iter()
        .flat_map_iter(|(ours, theirs)| ours.differences(theirs, bootstrap))
        .collect();
    (entries.par_iter().map(|entry| entry.summary(bootstrap)).collect(), differences)
}

/// Trainings that differ only in seeds, or another predictor, with their errors.
struct Entry<'a> {
    group: Vec<&'a PredictorInfo>,
    /// The errors over each part of the horizon, with its length in seconds.
    errors: Vec<(f64, BySeed)>,
    diverged: f64,
}

impl<'a> Entry<'a> {
    fn new(group: Vec<&'a PredictorInfo>, cells: &[&CellResult]) -> Self {
        let horizons_s: &[f64] = cells.first().map_or(&[], |cell| &cell.horizons_s);
        let of_horizon = |(k, &seconds): (usize, &f64)| {
            let all_have = cells.iter().all(|cell| cell.horizons_s.get(k) == Some(&seconds));
            let rmse = |errors: &ScenarioErrors| errors.horizon(k);
            let of_seed = |info: &&PredictorInfo| values(&info.name, cells, rmse);
            let by_seed: BySeed = group.iter().map(of_seed).collect::<Option<_>>()?;
            all_have.then_some((seconds, by_seed))
        };
        let errors = horizons_s.iter().enumerate().filter_map(of_horizon).collect();
        let diverged = |info: &&PredictorInfo| {
            let found = cells.iter().filter_map(|cell| cell.errors(&info.name));
            found.map(|errors| errors.diverged.len()).sum::<usize>()
        };
        let scenarios: usize = cells.iter().map(|cell| cell.scenarios()).sum();
        let all = (group.len() * scenarios).max(1) as f64;
        let diverged = group.iter().map(diverged).sum::<usize>() as f64 / all;
        Self { group, errors, diverged }
    }

    fn summary(&self, bootstrap: Bootstrap) -> ReplicationSummary {
        let error = |(seconds, values): &(f64, BySeed)| ReplicatedError {
            seconds: *seconds,
            rmse_deg: interval(values, bootstrap),
            seed_rmse_deg: seed_means(values),
        };
        ReplicationSummary {
            predictors: self.group.iter().map(|info| info.name.clone()).collect(),
            errors: self.errors.iter().map(error).collect(),
            diverged: self.diverged,
        }
    }

    fn differences(&self, against: &Self, bootstrap: Bootstrap) -> Vec<ReplicationDifference> {
        let over = |(seconds, ours): &(f64, BySeed)| {
            let (_, theirs) = against.errors.iter().find(|(length, _)| length == seconds)?;
            Some(ReplicationDifference {
                predictor: self.group[0].name.clone(),
                against: against.group[0].name.clone(),
                seconds: *seconds,
                difference_deg: difference(ours, theirs, bootstrap),
            })
        };
        self.errors.iter().filter_map(over).collect()
    }
}

/// A value of each scenario, with a stratum per cell. `None` unless all have one.
fn values(
    predictor: &str,
    cells: &[&CellResult],
    of: impl Fn(&ScenarioErrors) -> Option<f64>,
) -> Option<Vec<Vec<f64>>> {
    let of_cell = |cell: &&CellResult| {
        let scenarios = cell.errors(predictor)?.scenarios.iter();
        scenarios.map(|errors| of(errors.as_ref()?)).collect::<Option<Vec<f64>>>()
    };
    let strata: Vec<Vec<f64>> = cells.iter().map(of_cell).collect::<Option<_>>()?;
    strata.iter().any(|stratum| !stratum.is_empty()).then_some(strata)
}

fn are_replications(a: &PredictorInfo, b: &PredictorInfo) -> bool {
    let way = |info: &PredictorInfo| {
        info.sampling.as_ref().map(|sampling| (sampling.kind, sampling.steps, sampling.start))
    };
    a.replicates.is_some()
        && a.replicates == b.replicates
        && a.digest != b.digest
        && way(a) == way(b)
}

/// Values of each seed on each scenario: `[seed][stratum][scenario]`. All seeds have the same
/// scenarios.
pub(super) type BySeed = Vec<Vec<Vec<f64>>>;

/// The mean over seeds and robots. The squares of two half-widths are added: that over robots is
/// from the bootstrap of the seeds' mean, and that over seeds is Student's t of the seeds' means.
/// With one seed there is no estimate for seeds, and the interval is that over robots.
pub(super) fn interval(values: &BySeed, bootstrap: Bootstrap) -> Interval {
    let over_robots = stratified_mean(&over_seeds(values), bootstrap);
    widened(over_robots, seed_half_width(&seed_means(values)))
}

/// 1 − (mean of `values`) / (mean of `reference`), with an interval of the same kind.
pub(super) fn skill(
    values: &BySeed,
    reference: &[Vec<f64>],
    bootstrap: Bootstrap,
) -> Option<Interval> {
    let of_reference = mean(reference);
    if of_reference <= 0.0 {
        return None;
    }
    let ratio = stratified_ratio(&over_seeds(values), reference, bootstrap);
    let over_robots =
        Interval { mean: 1.0 - ratio.mean, low: 1.0 - ratio.high, high: 1.0 - ratio.low };
    let of_seeds: Vec<f64> =
        seed_means(values).into_iter().map(|mean| 1.0 - mean / of_reference).collect();
    Some(widened(over_robots, seed_half_width(&of_seeds)))
}

/// The mean difference on the same scenarios. The seeds of both sides are independent.
pub(super) fn difference(ours: &BySeed, theirs: &BySeed, bootstrap: Bootstrap) -> Interval {
    let (of_ours, of_theirs) = (over_seeds(ours), over_seeds(theirs));
    let differences: Vec<Vec<f64>> = of_ours
        .iter()
        .zip(&of_theirs)
        .map(|(ours, theirs)| ours.iter().zip(theirs).map(|(a, b)| a - b).collect())
        .collect();
    let over_robots = stratified_mean(&differences, bootstrap);
    let seeds = [ours, theirs].map(|values| seed_half_width(&seed_means(values)));
    widened(over_robots, seeds[0].hypot(seeds[1]))
}

/// The mean over all scenarios, for each seed.
pub(super) fn seed_means(values: &BySeed) -> Vec<f64> {
    values.iter().map(|strata| mean(strata)).collect()
}

fn mean(strata: &[Vec<f64>]) -> f64 {
    let count = strata.iter().map(Vec::len).sum::<usize>() as f64;
    strata.iter().flatten().sum::<f64>() / count
}

/// The mean over seeds of each scenario.
fn over_seeds(values: &BySeed) -> Vec<Vec<f64>> {
    let seeds = values.len() as f64;
    let mut sums = values[0].clone();
    for strata in &values[1..] {
        for (sum, value) in sums.iter_mut().flatten().zip(strata.iter().flatten()) {
            *sum += value;
        }
    }
    sums.iter_mut().flatten().for_each(|sum| *sum /= seeds);
    sums
}

/// Half the width of the 95 % interval of the mean over seeds; 0 for a single seed.
fn seed_half_width(means: &[f64]) -> f64 {
    let count = means.len() as f64;
    if means.len() < 2 {
        return 0.0;
    }
    let mean = means.iter().sum::<f64>() / count;
    let squares = means.iter().map(|seed_mean| (seed_mean - mean).powi(2)).sum::<f64>();
    let variance = squares / (count - 1.0);
    student_quantile_975(means.len() - 1) * (variance / count).sqrt()
}

fn widened(Interval { mean, low, high }: Interval, by: f64) -> Interval {
    Interval { mean, low: mean - (mean - low).hypot(by), high: mean + (high - mean).hypot(by) }
}

#[cfg(test)]
mod tests {
    use spec::Digest;
    use wire::PredictorKind;

    use super::*;
    use crate::report::tests::{cell, named};

    const BOOTSTRAP: Bootstrap = Bootstrap { resamples: 2000, seed: 0 };

    #[test]
    fn of_one_seed_the_interval_is_that_over_robots() {
        let values: BySeed = vec![vec![(0..40).map(f64::from).collect()]];
        assert_eq!(interval(&values, BOOTSTRAP), stratified_mean(&values[0], BOOTSTRAP));
    }

    #[test]
    fn seeds_that_differ_widen_the_interval_as_students_t() {
        // Every robot has the same error, so that only seeds contribute to the interval.
        let values: BySeed = [1.0, 2.0, 3.0].map(|mean| vec![vec![mean; 10]]).into();
        let found = interval(&values, BOOTSTRAP);
        // t for 2 degrees of freedom is 4.303, and the standard error is 1 / √3.
        assert!((found.high - found.mean - 4.303 / 3.0_f64.sqrt()).abs() < 1e-3, "{found:?}");
        assert_eq!(found.mean, 2.0);
        assert_eq!(seed_means(&values), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_difference_to_the_same_values_is_certain_but_for_seeds() {
        let robots: Vec<f64> = (0..30).map(|k| f64::from(k).sin() + 2.0).collect();
        let one: BySeed = vec![vec![robots.clone()]];
        let found = difference(&one, &one, BOOTSTRAP);
        assert_eq!((found.mean, found.low, found.high), (0.0, 0.0, 0.0));
        let more: Vec<f64> = robots.iter().map(|error| error + 1.0).collect();
        let two: BySeed = vec![vec![robots], vec![more]];
        let found = difference(&two, &one, BOOTSTRAP);
        assert!((found.mean - 0.5).abs() < 1e-12 && found.low < -5.0, "{found:?}");
    }

    #[test]
    fn the_skill_of_a_half_of_the_reference_is_a_half() {
        let reference = vec![vec![2.0, 4.0], vec![6.0]];
        let values: BySeed = vec![vec![vec![1.0, 2.0], vec![3.0]]];
        let found = skill(&values, &reference, BOOTSTRAP).unwrap();
        assert_eq!((found.mean, found.low, found.high), (0.5, 0.5, 0.5));
        assert_eq!(skill(&values, &[vec![0.0, 0.0], vec![0.0]], BOOTSTRAP), None);
    }

    /// Two trainings that differ in seeds, and a baseline. Over the two parts of the horizon the
    /// scenarios of the first training have 1 and 2°, those of the second 3 and 4°, and those of the
    /// baseline 5 and 6°.
    fn replicated() -> (Vec<PredictorInfo>, CellResult) {
        let digest = |number: u64| -> Digest { format!("{number:064x}").parse().unwrap() };
        let seed = |name: &str, number| PredictorInfo {
            digest: Some(digest(number)),
            replicates: Some(digest(9)),
            ..named(name, PredictorKind::Checkpoint)
        };
        let predictors =
            vec![named("baseline", PredictorKind::Baseline), seed("law-1", 1), seed("law-2", 2)];
        let errors = |name: &str, [short, long]: [f32; 2]| crate::PredictorErrors {
            predictor: name.to_owned(),
            rmse_deg: vec![Some(f64::from(long)); 3],
            scenarios: vec![
                ScenarioErrors::of_joints(
                    |_| Some(vec![long; 2]),
                    vec![vec![short - 0.5, short + 0.5], vec![long; 2]],
                );
                3
            ],
            diverged: if name == "law-2" { vec![1] } else { Vec::new() },
            ..crate::PredictorErrors::default()
        };
        let result = CellResult {
            horizons_s: vec![0.1, 1.0],
            predictors: vec![
                errors("baseline", [5.0, 6.0]),
                errors("law-1", [1.0, 2.0]),
                errors("law-2", [3.0, 4.0]),
            ],
            ..cell(0, 0.15, 1.0, 2.0)
        };
        (predictors, result)
    }

    #[test]
    fn trainings_are_one_entry_over_each_part_of_the_horizon() {
        let (predictors, result) = replicated();
        let (entries, differences) = over_horizons(&predictors, &[&result], BOOTSTRAP);
        let [baseline, law] = &entries[..] else { panic!("{entries:?}") };
        assert_eq!(law.predictors, ["law-1", "law-2"]);
        let means = |entry: &ReplicationSummary| -> Vec<(f64, f64)> {
            entry.errors.iter().map(|error| (error.seconds, error.rmse_deg.mean)).collect()
        };
        assert_eq!(means(baseline), [(0.1, 5.0), (1.0, 6.0)]);
        assert_eq!(means(law), [(0.1, 2.0), (1.0, 3.0)]);
        assert_eq!(law.errors[1].seed_rmse_deg, [2.0, 4.0]);
        // One of two trainings diverged on one of three robots.
        assert!((law.diverged - 1.0 / 6.0).abs() < 1e-12);
        let found: Vec<(f64, f64)> =
            differences.iter().map(|it| (it.seconds, it.difference_deg.mean)).collect();
        assert_eq!(found, [(0.1, -3.0), (1.0, -3.0)]);
        assert_eq!((&*differences[0].predictor, &*differences[0].against), ("law-1", "baseline"));
    }

    #[test]
    fn a_missing_answer_leaves_errors_out_and_one_training_each_leaves_all_out() {
        let (mut predictors, mut result) = replicated();
        result.predictors[2].scenarios[1] = None;
        let (entries, differences) = over_horizons(&predictors, &[&result], BOOTSTRAP);
        assert!(entries[1].errors.is_empty() && differences.is_empty(), "{entries:?}");
        predictors.pop();
        assert_eq!(over_horizons(&predictors, &[&result], BOOTSTRAP), (Vec::new(), Vec::new()));
    }
}
