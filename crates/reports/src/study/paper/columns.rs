//! The columns of the headline table: how far the torques are from those of the training.

use spec::{Family, StudyQuestion};
use wire::{Interval, Shift, ShiftScores, ShiftSummary};

use super::super::results::{Evaluation, Study};

/// Cells of one evaluation that share a shift.
#[derive(Clone, Copy, Debug)]
pub struct ShiftColumn {
    pub title: &'static str,
    question: StudyQuestion,
    shift: Shift,
    family: Option<Family>,
}

/// Chirps have the same torques at every frequency. The torques of multisines grow with it. So
/// above the band, chirps shift only the frequency, and multisines shift frequency and torques.
pub const COLUMNS: [ShiftColumn; 6] = [
    ShiftColumn::new("within", StudyQuestion::Sweep, Shift::Within, None),
    ShiftColumn::new("below the band", StudyQuestion::Sweep, Shift::Below, None),
    ShiftColumn::new("above, chirps", StudyQuestion::Sweep, Shift::Above, Some(Family::Chirp)),
    ShiftColumn::new(
        "above, multisines",
        StudyQuestion::Sweep,
        Shift::Above,
        Some(Family::Multisine),
    ),
    ShiftColumn::new("twice the torques", StudyQuestion::Amplitude, Shift::Amplitude, None),
    ShiftColumn::new("steps", StudyQuestion::Sweep, Shift::Family, None),
];

impl ShiftColumn {
    const fn new(
        title: &'static str,
        question: StudyQuestion,
        shift: Shift,
        family: Option<Family>,
    ) -> Self {
        Self { title, question, shift, family }
    }

    pub fn of<'a>(
        &self,
        study: &'a Study,
        set: usize,
    ) -> Option<(&'a Evaluation, &'a ShiftSummary)> {
        let evaluation = study.evaluation(set, self.question)?;
        Some((evaluation, evaluation.shift(self.shift, self.family)?))
    }

    /// The column's shift in an evaluation.
    pub fn in_evaluation<'a>(&self, evaluation: &'a Evaluation) -> Option<&'a ShiftSummary> {
        evaluation.shift(self.shift, self.family)
    }

    pub fn scores<'a>(&self, study: &'a Study, set: usize, name: &str) -> Option<&'a ShiftScores> {
        let (evaluation, shift) = self.of(study, set)?;
        study.scores(evaluation, shift, name)
    }

    /// RMSE of `name` minus that of `against` on the same scenarios. Below 0 is better.
    pub fn difference(
        &self,
        study: &Study,
        set: usize,
        name: &str,
        against: &str,
    ) -> Option<Interval> {
        let (evaluation, shift) = self.of(study, set)?;
        let find = |name: &str, against: &str| {
            let is_it = |predictor: &str, name: &str| study.called(evaluation, predictor) == name;
            let mut differences = shift.differences.iter();
            differences.find(|difference| {
                is_it(&difference.predictor, name) && is_it(&difference.against, against)
            })
        };
        find(name, against).map(|found| found.difference_deg).or_else(|| {
            let Interval { mean, low, high } = find(against, name)?.difference_deg;
            Some(Interval { mean: -mean, low: -high, high: -low })
        })
    }
}
