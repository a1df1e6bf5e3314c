//! Combines trainings that differ only in their seeds: the interval of a mean over seeds and
//! robots.

use series::student_quantile_975;
use spec::Bootstrap;
use wire::{Interval, PredictorInfo};

use crate::bootstrap::{stratified_mean, stratified_ratio};

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
    use super::*;

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
}
