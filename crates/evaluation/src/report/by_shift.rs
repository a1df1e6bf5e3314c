//! Groups cells by how their torques differ from those of the trainings, over the scenarios whose
//! torques the robot's motors can give.

use models::Interrupt;
use rayon::prelude::*;
use spec::{Bootstrap, Family};
use wire::{PredictorInfo, Shift, ShiftDifference, ShiftScores, ShiftSummary};

use super::comparisons::is_compared;
use super::replications::{self, BySeed};
use crate::scores::{Measure, ScenarioErrors};
use crate::{CellResult, PredictorErrors};

/// Cells with their shift, in order.
type Shifted<'a> = [(&'a CellResult, Option<Shift>)];

/// Summaries of each shift that occurs, for all its families together and for each family.
pub(super) fn by_shift(
    predictors: &[PredictorInfo],
    cells: &Shifted<'_>,
    levels: &[f64],
    bootstrap: Bootstrap,
) -> Vec<ShiftSummary> {
    let mut groups = Vec::new();
    for &level in levels {
        for shift in Shift::ALL {
            let of_shift: Vec<&CellResult> = cells
                .iter()
                .filter(|(cell, cell_shift)| {
                    cell.position_noise_rad == level && *cell_shift == Some(shift)
                })
                .map(|(cell, _)| *cell)
                .collect();
            let families: Vec<Family> = Family::ALL
                .into_iter()
                .filter(|family| of_shift.iter().any(|cell| cell.family == Some(*family)))
                .collect();
            if families.is_empty() {
                continue;
            }
            groups.push((shift, None, level, of_shift.clone()));
            for family in &families {
                let is_here = |cell: &&CellResult| cell.family == Some(*family);
                let of_family = of_shift.iter().copied().filter(is_here).collect();
                groups.push((shift, Some(*family), level, of_family));
            }
        }
    }
    let interrupt = Interrupt::current();
    groups
        .into_par_iter()
        .inspect(|_| interrupt.leave_if_raised())
        .map(|(shift, family, level, cells)| {
            let group = Group::new(cells, bootstrap);
            let (models, differences) = group.models(predictors);
            ShiftSummary {
                shift,
                family,
                position_noise_rad: level,
                scenarios: group.scenarios as u64,
                scored: group.scored as u64,
                models,
                differences,
            }
        })
        .collect()
}

/// The name of the predictor that is the reference of the skill.
const REFERENCE: &str = "damped-integrator";

struct Group<'a> {
    cells: Vec<&'a CellResult>,
    scenarios: usize,
    /// Number of scenarios whose torques the motors can give.
    scored: usize,
    bootstrap: Bootstrap,
}

impl<'a> Group<'a> {
    fn new(cells: Vec<&'a CellResult>, bootstrap: Bootstrap) -> Self {
        let scenarios = cells.iter().map(|cell| cell.scenarios()).sum();
        let scored = cells
            .iter()
            .map(|cell| (0..cell.scenarios()).filter(|&scenario| is_scored(cell, scenario)).count())
            .sum();
        Self { cells, scenarios, scored, bootstrap }
    }

    fn models(&self, predictors: &[PredictorInfo]) -> (Vec<ShiftScores>, Vec<ShiftDifference>) {
        if self.scored == 0 {
            return (Vec::new(), Vec::new());
        }
        let rmse = |errors: &PredictorErrors, scenario: usize| errors.rmse_deg[scenario];
        let reference = self.values(REFERENCE, rmse);
        let asked: Vec<(Vec<&PredictorInfo>, Option<BySeed>)> = replications::groups(predictors)
            .into_iter()
            .filter(|group| group.iter().all(|info| self.is_asked(&info.name)))
            .map(|group| {
                let values = group.iter().map(|info| self.values(&info.name, rmse)).collect();
                (group, values)
            })
            .collect();
        let scores = |(group, values): &(Vec<&PredictorInfo>, Option<BySeed>)| {
            self.scores(group, values.as_ref(), reference.as_deref())
        };
        let pairs = asked
            .iter()
            .enumerate()
            .flat_map(|(k, ours)| asked[..k].iter().map(move |theirs| (ours, theirs)));
        let compared: Vec<_> = pairs
            .filter(|((ours, _), (theirs, _))| is_compared(ours[0], theirs[0], predictors))
            .collect();
        let differences =
            compared.into_par_iter().filter_map(|((ours, of_ours), (theirs, of_theirs))| {
                let difference_deg = replications::difference(
                    of_ours.as_ref()?,
                    of_theirs.as_ref()?,
                    self.bootstrap,
                );
                let (predictor, against) = (ours[0].name.clone(), theirs[0].name.clone());
                Some(ShiftDifference { predictor, against, difference_deg })
            });
        (asked.par_iter().map(scores).collect(), differences.collect())
    }

    fn scores(
        &self,
        group: &[&PredictorInfo],
        rmse: Option<&BySeed>,
        reference: Option<&[Vec<f64>]>,
    ) -> ShiftScores {
        let values = |of: &dyn Fn(&ScenarioErrors) -> Option<f64>| -> Option<BySeed> {
            let of_predictor = |info: &&PredictorInfo| {
                self.values(&info.name, |errors, scenario| {
                    of(errors.scenarios.get(scenario)?.as_ref()?)
                })
            };
            group.iter().map(of_predictor).collect()
        };
        let joints = self.cells.first().map_or(0, |cell| cell.joints);
        let of_joint = |joint: usize| {
            let of_seeds =
                values(&|errors| Some(f64::from(*errors.get(Measure::RmseDeg)?.get(joint)?)))?;
            let means = replications::seed_means(&of_seeds);
            Some(means.iter().sum::<f64>() / means.len() as f64)
        };
        let of_means = values(&|errors| errors.mean(Measure::MeanRmseDeg));
        ShiftScores {
            predictors: group.iter().map(|info| info.name.clone()).collect(),
            rmse_deg: rmse.map(|values| replications::interval(values, self.bootstrap)),
            seed_rmse_deg: rmse.map(replications::seed_means).unwrap_or_default(),
            skill: rmse
                .zip(reference)
                .and_then(|(values, of)| replications::skill(values, of, self.bootstrap)),
            worst_deg: rmse.map(|values| {
                values.iter().flatten().flatten().copied().fold(f64::NEG_INFINITY, f64::max)
            }),
            joint_rmse_deg: (0..joints).map(of_joint).collect::<Option<_>>().unwrap_or_default(),
            mean_rmse_deg: of_means.map(|values| replications::interval(&values, self.bootstrap)),
            diverged: self.diverged(group),
        }
    }

    fn is_asked(&self, predictor: &str) -> bool {
        self.cells.iter().all(|cell| cell.errors(predictor).is_some())
    }

    /// A value of each scored scenario, with a stratum per cell. `None` unless all have one.
    fn values(
        &self,
        predictor: &str,
        of: impl Fn(&PredictorErrors, usize) -> Option<f64>,
    ) -> Option<Vec<Vec<f64>>> {
        let of_cell = |cell: &&CellResult| {
            let errors = cell.errors(predictor)?;
            let scored = (0..cell.scenarios()).filter(|&scenario| is_scored(cell, scenario));
            scored.map(|scenario| of(errors, scenario)).collect::<Option<Vec<f64>>>()
        };
        self.cells.iter().map(of_cell).collect()
    }

    /// The share of scored scenarios that diverged, over all seeds.
    fn diverged(&self, group: &[&PredictorInfo]) -> f64 {
        let count = |info: &&PredictorInfo| {
            let of_cell = |cell: &&CellResult| {
                let found = cell.errors(&info.name).map_or(&[][..], |errors| &errors.diverged);
                found.iter().filter(|&&scenario| is_scored(cell, scenario)).count()
            };
            self.cells.iter().map(of_cell).sum::<usize>()
        };
        group.iter().map(count).sum::<usize>() as f64 / (group.len() * self.scored) as f64
    }
}

/// Whether a scenario is scored. Without torque limits, all scenarios are.
fn is_scored(cell: &CellResult, scenario: usize) -> bool {
    cell.within_torque_limits.get(scenario).copied().unwrap_or(true)
}

#[cfg(test)]
mod tests {
    use spec::Digest;
    use wire::PredictorKind;

    use super::*;
    use crate::report::summarize;
    use crate::report::tests::{cell, named, setting};

    fn digest(number: u64) -> Digest {
        format!("{number:064x}").parse().unwrap()
    }

    /// Two seeds of a training and the integrator, on two scenarios. The torques of the second one
    /// exceed the motors'.
    fn replicated(number: usize, frequency_hz: f64) -> CellResult {
        let mut result = cell(number, frequency_hz, 1.0, 4.0);
        REFERENCE.clone_into(&mut result.predictors[0].predictor);
        let mut other = result.predictors[1].clone();
        other.predictor = "model 2".to_owned();
        other.rmse_deg = vec![Some(2.9), None];
        other.diverged = vec![0, 1];
        result.predictors.push(other);
        result.within_torque_limits = vec![true, false];
        result
    }

    #[test]
    fn replications_are_one_entry_over_what_the_motors_can_run() {
        let seed = |name: &str, number| PredictorInfo {
            digest: Some(digest(number)),
            replicates: Some(digest(9)),
            ..named(name, PredictorKind::Checkpoint)
        };
        let predictors =
            vec![named(REFERENCE, PredictorKind::Baseline), seed("model", 1), seed("model 2", 2)];
        let results = [replicated(0, 0.15), replicated(1, 0.3)];
        let report = summarize(crate::Setting { predictors, ..setting() }, &results).unwrap();

        assert_eq!(report.cells[0].within_torque_limits, Some(0.5));
        let kinds: Vec<_> =
            report.shifts.iter().map(|summary| (summary.shift, summary.family)).collect();
        let multisine = Some(Family::Multisine);
        let expected = [
            (Shift::Within, None),
            (Shift::Within, multisine),
            (Shift::Above, None),
            (Shift::Above, multisine),
        ];
        assert_eq!(kinds, expected);
        let within = &report.shifts[0];
        assert_eq!((within.scenarios, within.scored), (2, 1));
        let [reference, model] = &within.models[..] else { panic!("{within:?}") };
        assert_eq!(model.predictors, ["model", "model 2"]);
        // The errors are 0.9 and 2.9, and that of the integrator is 3.9.
        let rmse = model.rmse_deg.unwrap();
        assert!((rmse.mean - 1.9).abs() < 1e-9, "{rmse:?}");
        assert!((rmse.high - 1.9 - 12.706).abs() < 1e-2, "{rmse:?}");
        assert_eq!(model.seed_rmse_deg, [0.9, 2.9]);
        assert!((model.skill.unwrap().mean - 2.0 / 3.9).abs() < 1e-9);
        assert_eq!(reference.skill.unwrap().mean, 0.0);
        assert_eq!((model.worst_deg, model.diverged), (Some(2.9), 0.5));
        let difference = &within.differences[0];
        assert_eq!((&*difference.predictor, &*difference.against), ("model", REFERENCE));
        assert!((difference.difference_deg.mean + 2.0).abs() < 1e-9);
    }
}
