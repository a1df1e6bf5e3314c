//! The scenarios that the figures of an evaluation show, and the predictors in them.

use std::collections::BTreeSet;

use spec::{Baseline, Given};
use wire::{PredictorInfo, PredictorKind, ScenarioRank};

use crate::CellResult;

/// Checkpoints in a figure besides the best one.
const OTHER_CHECKPOINTS: usize = 2;

/// Scenarios by the RMSE of the best model.
#[derive(Clone, Debug, PartialEq)]
pub struct Examples {
    /// Names: the best model, then the best checkpoints of other trainings, then baselines.
    pub predictors: Vec<String>,
    /// The worst scenario, then the median one, then the best one. Fewer if there are fewer than three.
    pub scenarios: Vec<Example>,
}

/// One scenario of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Example {
    /// Its place among the scenarios.
    pub rank: ScenarioRank,
    /// The index of the cell.
    pub cell: usize,
    /// The index of the scenario in its cell.
    pub scenario: usize,
    /// RMSE of the best model, mean over joints.
    pub rmse_deg: f64,
}

/// The scenarios and predictors to draw; `None` if no predictor has an answer. A predictor that
/// sees the future is never drawn. Without a checkpoint, the best baseline takes the place of the
/// best model.
pub fn examples(cells: &[CellResult], predictors: &[PredictorInfo]) -> Option<Examples> {
    let is_baseline = |info: &&PredictorInfo| info.kind == PredictorKind::Baseline;
    let fair = predictors.iter().filter(|info| info.competes());
    let (baselines, models): (Vec<_>, Vec<_>) = fair.partition(is_baseline);
    let models = best_first(cells, models);
    let baselines = best_first(cells, baselines);

    let mut trainings = BTreeSet::new();
    let others = models.into_iter().filter(|info| trainings.insert(info.digest));
    let drawn = others.take(1 + OTHER_CHECKPOINTS).chain(ladder(baselines));
    let predictors: Vec<String> = drawn.map(|info| info.name.clone()).collect();
    let model = predictors.first()?;

    let mut answered = answers(cells, model);
    answered.sort_by(|a, b| a.rmse_deg.total_cmp(&b.rmse_deg));
    let last = answered.len().checked_sub(1)?;
    let places =
        [(ScenarioRank::Worst, last), (ScenarioRank::Median, last / 2), (ScenarioRank::Best, 0)];
    let scenarios = places.into_iter().filter(|(rank, place)| match rank {
        ScenarioRank::Worst => true,
        ScenarioRank::Median => *place > 0,
        ScenarioRank::Best => last > 0,
    });
    let scenarios = scenarios.map(|(rank, place)| answered[place].ranked(rank)).collect();
    Some(Examples { predictors, scenarios })
}

/// The two best baselines with different knowledge about the arms, and the best one without any.
/// `baselines` begins with the best.
fn ladder(baselines: Vec<&PredictorInfo>) -> Vec<&PredictorInfo> {
    let mut seen = BTreeSet::new();
    let distinct: Vec<_> =
        baselines.into_iter().filter(|info| seen.insert(info.told.clone())).collect();
    let none = Baseline::HoldLast.prior_knowledge(Given::Torques);
    let rungs = distinct.into_iter().enumerate();
    let drawn = rungs.filter(|(rank, info)| *rank < 2 || info.told.as_deref() == Some(none));
    drawn.map(|(_, info)| info).collect()
}

/// Sorts predictors: those with more answers first, then by their mean RMSE. Predictors without any
/// answer are left out.
fn best_first<'a>(
    cells: &[CellResult],
    predictors: Vec<&'a PredictorInfo>,
) -> Vec<&'a PredictorInfo> {
    let mut ranked: Vec<(usize, f64, &PredictorInfo)> = Vec::new();
    for info in predictors {
        let answered = answers(cells, &info.name);
        if !answered.is_empty() {
            let sum: f64 = answered.iter().map(|answer| answer.rmse_deg).sum();
            ranked.push((answered.len(), sum / answered.len() as f64, info));
        }
    }
    ranked.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)));
    ranked.into_iter().map(|(.., info)| info).collect()
}

/// A scenario that a predictor has an answer to, and the error of the answer.
struct Answered {
    cell: usize,
    scenario: usize,
    rmse_deg: f64,
}

impl Answered {
    fn ranked(&self, rank: ScenarioRank) -> Example {
        let Self { cell, scenario, rmse_deg } = *self;
        Example { rank, cell, scenario, rmse_deg }
    }
}

/// The scenarios that a predictor has an answer to, in their order.
fn answers(cells: &[CellResult], predictor: &str) -> Vec<Answered> {
    let mut found = Vec::new();
    for (cell, result) in cells.iter().enumerate() {
        let errors = result.predictors.iter().filter(|errors| errors.predictor == predictor);
        for (scenario, rmse) in errors.flat_map(|errors| errors.rmse_deg.iter().enumerate()) {
            if let Some(rmse_deg) = *rmse {
                found.push(Answered { cell, scenario, rmse_deg });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::{cell, named};

    #[test]
    fn the_best_model_decides_and_one_that_sees_the_future_does_not() {
        let mut cells = vec![cell(0, 0.1, 2.0, 1.0), cell(1, 0.2, 5.0, 1.0)];
        for (result, rmse) in cells.iter_mut().zip([0.5, 0.6]) {
            let mut cheat = result.predictors[1].clone();
            cheat.predictor = "cheat".to_owned();
            cheat.rmse_deg = vec![Some(rmse); 2];
            result.predictors.push(cheat);
        }
        let mut infos = vec![
            named("baseline", PredictorKind::Baseline),
            named("model", PredictorKind::Checkpoint),
            named("cheat", PredictorKind::Checkpoint),
        ];
        infos[2].normalization = Some(spec::Normalization::PaperLeaky);
        let found = examples(&cells, &infos).unwrap();
        assert_eq!(found.predictors, ["model", "baseline"]);
        let places: Vec<_> = found
            .scenarios
            .iter()
            .map(|example| (example.rank, example.cell, example.scenario))
            .collect();
        assert_eq!(
            places,
            [(ScenarioRank::Worst, 1, 1), (ScenarioRank::Median, 0, 1), (ScenarioRank::Best, 0, 0)]
        );
    }

    #[test]
    fn baselines_are_those_that_know_different_things_and_one_that_knows_nothing() {
        let mut result = cell(0, 0.1, 2.0, 1.0);
        let template = result.predictors[0].clone();
        result.predictors.clear();
        let mut infos = Vec::new();
        let known = [("a", "all"), ("b", "all"), ("c", "much"), ("d", "little"), ("e", "nothing")];
        for (k, (name, knowledge)) in known.into_iter().enumerate() {
            let rmse_deg = vec![Some(k as f64)];
            let errors = crate::PredictorErrors { rmse_deg, ..template.clone() };
            result.predictors.push(crate::PredictorErrors { predictor: name.to_owned(), ..errors });
            infos.push(named(name, PredictorKind::Baseline));
            infos[k].told = Some(knowledge.to_owned());
        }
        assert_eq!(examples(&[result], &infos).unwrap().predictors, ["a", "c", "e"]);
    }

    #[test]
    fn without_a_checkpoint_the_best_baseline_is_drawn_and_few_scenarios_are_drawn_once() {
        let mut one = cell(0, 0.1, 2.0, 1.0);
        let infos = [named("baseline", PredictorKind::Baseline)];
        one.predictors[0].rmse_deg = vec![None, Some(3.0)];
        let found = examples(&[one.clone()], &infos).unwrap();
        assert_eq!(found.predictors, ["baseline"]);
        assert_eq!(found.scenarios.len(), 1);
        assert_eq!((found.scenarios[0].scenario, found.scenarios[0].rmse_deg), (1, 3.0));
        one.predictors[0].rmse_deg = vec![None, None];
        assert_eq!(examples(&[one], &infos), None);
        assert_eq!(examples(&[], &infos), None);
    }
}
