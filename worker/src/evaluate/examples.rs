//! Asks the best predictors again for a few scenarios, and draws their answers.

use evaluation::{
    CellResult, DrawnAnswer, Example, Examples, Predictor, colour_of, examples, prediction_figure,
};
use figures::Size;
use series::SeriesView;
use spec::{EvaluateSpec, ScenarioCell};
use wire::{DrawnPredictions, DrawnPredictor, DrawnScenario, PredictorInfo};

use super::cell::{asked_about, scenarios, simulated};
use super::checkpoints::LoadedCheckpoint;
use super::predictions::PredictionFile;
use super::predictors::Predictors;
use crate::attempt::Attempt;
use crate::error::TaskError;
use crate::trajectories::TrajectorySource;

/// The parts of an evaluation that its examples need.
pub(super) struct ExampleInputs<'a> {
    pub spec: &'a EvaluateSpec,
    pub data: &'a TrajectorySource,
    pub files: &'a [PredictionFile],
    pub checkpoints: &'a [LoadedCheckpoint],
    /// In the order of every table.
    pub predictors: &'a [PredictorInfo],
}

/// Writes a figure with its table of the worst, the median and the best scenario of the best model, and
/// `predictions.json`. Writes nothing if no predictor has an answer.
pub(super) fn put(
    attempt: &Attempt,
    asked: &ExampleInputs,
    cells: &[CellResult],
) -> Result<(), TaskError> {
    let Some(chosen) = examples(cells, asked.predictors) else { return Ok(()) };
    let mut drawn = Vec::new();
    for example in &chosen.scenarios {
        let result = &cells[example.cell];
        drawn.extend(draw(attempt, asked, &chosen, *example, result)?);
    }
    let list = DrawnPredictions {
        model: chosen.predictors.first().cloned().unwrap_or_default(),
        predictors: asked.drawn_predictors(&chosen)?,
        scenarios: drawn,
    };
    attempt.put("predictions.json", "application/json", serde_json::to_vec_pretty(&list)?)
}

impl ExampleInputs<'_> {
    fn predictors(&self) -> Result<Predictors<'_>, TaskError> {
        Ok(Predictors::new(self.spec, self.data.spec(), self.files, self.checkpoints)?)
    }

    fn drawn_predictors(&self, chosen: &Examples) -> Result<Vec<DrawnPredictor>, TaskError> {
        let all = self.predictors()?;
        let drawn = |name: &String| {
            let info = self.predictors.iter().find(|info| info.name == *name)?;
            let learned = all.learned.iter().find(|learned| learned.info.name == *name);
            Some(DrawnPredictor {
                name: name.clone(),
                kind: info.kind,
                digest: info.digest,
                step: learned.map(|learned| learned.checkpoint.step),
                weights: learned.and_then(|learned| learned.checkpoint.weights),
            })
        };
        Ok(chosen.predictors.iter().filter_map(drawn).collect())
    }
}

/// `None` if the model has no answer this time.
fn draw(
    attempt: &Attempt,
    asked: &ExampleInputs,
    chosen: &Examples,
    example: Example,
    result: &CellResult,
) -> Result<Option<DrawnScenario>, TaskError> {
    let (spec, data) = (asked.spec, asked.data);
    let trajectory = result.first + example.scenario as u64;
    let cell = ScenarioCell {
        excitation: result.family.zip(result.frequency_hz),
        first: trajectory,
        count: 1,
        position_noise_rad: result.position_noise_rad,
    };
    let recorded = scenarios(attempt, data, spec, &cell)?;
    let scenario = asked_about(spec, &recorded);
    let given = |file: &PredictionFile| file.answer(spec, data, &scenario, trajectory);
    let given = asked.files.iter().map(given).collect::<Result<Vec<_>, TaskError>>()?;
    // New predictors for each scenario, because they keep its first predictions.
    let predictors = asked.predictors()?;
    let simulated = simulated(attempt, data, spec, &cell, 1)?;
    let predictors = predictors.of_cell(&scenario, trajectory, given, simulated.as_ref());
    let (pre_roll, context) = (spec.rounds() as usize, spec.context as usize);
    let mut answers = Vec::new();
    for name in &chosen.predictors {
        let info = asked.predictors.iter().find(|info| info.name == *name);
        let predictor = predictors.iter().find(|predictor| predictor.name() == name);
        let (Some(info), Some(predictor)) = (info, predictor) else { continue };
        if let Some(positions) = ask(attempt, &**predictor, &scenario, (pre_roll, context))? {
            let colour = colour_of(asked.predictors, name);
            answers.push(DrawnAnswer { name: name.clone(), kind: info.kind, colour, positions });
        }
    }
    let Some(model) =
        answers.first().filter(|answer| chosen.predictors.first() == Some(&answer.name))
    else {
        return Ok(None);
    };
    let scenario = scenario.window(pre_roll..scenario.samples());
    let errors = model.joint_rmse_deg(&scenario, context);
    let worst = errors.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    let name = format!("prediction-{}", example.rank.as_str());
    let drawn = DrawnScenario {
        rank: example.rank,
        figure: format!("{name}.svg"),
        family: result.family,
        frequency_hz: result.frequency_hz,
        position_noise_rad: result.position_noise_rad,
        trajectory,
        joint: worst.map_or(1, |(joint, _)| joint + 1),
        rmse_deg: example.rmse_deg,
    };
    let figure = prediction_figure(&drawn, &scenario, context, &answers);
    attempt.put(&drawn.figure, "image/svg+xml", figure.to_svg(Size::PAGE)?.into_bytes())?;
    attempt.put(&format!("{name}.csv"), "text/csv", figure.to_csv().into_bytes())?;
    Ok(Some(drawn))
}

/// `None` of a predictor that fails; its failure is in the report if it failed before.
fn ask(
    attempt: &Attempt,
    predictor: &dyn Predictor,
    scenario: &SeriesView<'_>,
    (pre_roll, context): (usize, usize),
) -> Result<Option<Vec<f32>>, TaskError> {
    let observed = scenario.observed(pre_roll, context);
    match attempt.interruptible(|| predictor.predict(&observed))? {
        Ok(positions) => Ok(Some(positions)),
        Err(error) => {
            tracing::warn!(predictor = predictor.name(), error = %spec::causes(&error), "no answer");
            Ok(None)
        }
    }
}
