//! The report of the study of arms as they are used.

mod drawings;

use std::fmt::Write;

use spec::{StudyQuestion, StudyScale, real_study};
use wire::{
    GroupSummary, Interval, ORACLE, PredictorInfo, PredictorKind, PredictorScores, ReplicatedError,
    ReplicationSummary, Unit,
};

use super::results::{Evaluation, Study};
use super::tables::{interval, latency, source, table, text, trainings};
use super::text::{SOURCES, image, setting};
use crate::numbers::{degrees, step_at, value as significant};
use crate::{Cell, Table, TableOf};
pub use drawings::figures;

/// The evaluations of each section, by the names of their questions.
const USUAL: &str = "usual";
const SAMPLES: &str = "samples";
const CHANGED: [&str; 6] = [USUAL, "masses", "load", "fast", "noise", "smooth"];
const CONTEXTS: [&str; 5] = ["context-20", "context-40", "context-80", "context-160", USUAL];
const OTHER_ARM: [&str; 3] = ["other-arm", "recorded-ur10e", "recorded-ur10e-load"];
const REAL_PANDA: &str = "recorded-panda";

/// Predictors that others are compared with.
const REFERENCES: [&str; 5] =
    ["identification", "base-parameters", "arx", "robomorph", "cdt-regression"];

/// The baseline that has no skill.
const HELD: &str = "hold-last";

/// The first page for readers.
pub fn readme(study: &Study) -> String {
    let scale = study.scale.name();
    let mut page =
        format!("# Arms as they are used, scale `{scale}`\n\n{}\n\n", about(study.scale));
    let _ = writeln!(page, "    torqued study --edition real --scale {scale}\n");
    let _ = writeln!(page, "{}", setting(study));
    for Section { title, about, numbers, figures } in sections(study) {
        if numbers.is_empty() {
            continue;
        }
        let _ = writeln!(page, "## {title}\n\n{about}\n\n{numbers}");
        for figure in figures {
            let _ = writeln!(page, "{}", image(figure));
        }
    }
    page + SOURCES
}

const fn about(scale: StudyScale) -> &'static str {
    match scale {
        StudyScale::Tiny => {
            "Every kind of job of the study, each far too small: this shows that it runs, and nothing about \
             the models."
        }
        StudyScale::Small | StudyScale::Paper => {
            "Lightly damped arms with friction, rotors, a load that nobody tells and noisy sensors, under a \
             controller. Tiny networks, 1000 steps of 32 trajectories each; a `law`, which is told the arm's \
             lengths and axes, 600 of 48. No two trainings of a model share robots, nor does any share them \
             with a test."
        }
    }
}

/// A section of the report with a title. One without numbers is left out.
struct Section {
    title: &'static str,
    about: &'static str,
    numbers: String,
    figures: &'static [&'static str],
}

fn sections(study: &Study) -> Vec<Section> {
    vec![
        Section {
            title: "Arms as in training",
            about: "Mean RMSE in degrees over the first part of the horizon [95 % interval], one prediction per \
                    scenario. Intervals are over robots and, of trained models, over trainings, each with another \
                    seed and other robots. *Skill* is 0 for holding the last position over the whole horizon, and 1 \
                    for the robot itself from one noisy sample. Latency is that of one prediction at batch 1.",
            numbers: usual(study).to_markdown(),
            figures: &["over-horizon"],
        },
        Section {
            title: "Clear differences",
            about: "RMSE of the row minus that of the column on the same scenarios, in degrees [95 % interval]. \
                    Below 0 the row is better.",
            numbers: differences(study),
            figures: &[],
        },
        Section {
            title: "Joint by joint",
            about: "Mean RMSE in degrees of each joint over the whole horizon, mean over trainings.",
            numbers: joints(study).to_markdown(),
            figures: &[],
        },
        Section {
            title: "Other robots, references and noise",
            about: "Mean RMSE in degrees for arms that differ from those of the training in one respect. No model \
                    was trained on them; `identification` is told how they are drawn, as everywhere.",
            numbers: by_horizon(study, &CHANGED, false),
            figures: &[],
        },
        Section {
            title: "Contexts",
            about: "Mean RMSE in degrees after contexts of other lengths, for models that take any.",
            numbers: by_horizon(study, &CONTEXTS, true),
            figures: &["contexts"],
        },
        Section {
            title: "Intervals",
            about: "Each scenario has 32 samples. The first table has the RMSE of their mean and the CRPS in degrees, \
                    and the shares of measured positions inside the central intervals: of all positions, and of \
                    the last one of each part of the horizon. All are means over the trainings.",
            numbers: coverage(study),
            figures: &[],
        },
        Section {
            title: "A UR10e of six joints, simulated and recorded",
            about: "Mean RMSE in degrees. Models are trained on simulated UR10es and never saw a recording; the \
                    motors' gains are those that an identification of another day printed.",
            numbers: by_horizon(study, &OTHER_ARM, false),
            figures: &[],
        },
        Section {
            title: "A recorded Panda",
            about: "Mean RMSE in degrees on 14 s of a real Panda, in windows that overlap.",
            numbers: by_horizon(study, &[REAL_PANDA], false),
            figures: &[],
        },
    ]
}

/// An evaluation with the scenarios that all its predictors were asked about.
#[derive(Clone, Copy)]
struct Asked<'a> {
    study: &'a Study,
    evaluation: &'a Evaluation,
    group: &'a GroupSummary,
    title: &'a str,
}

/// A model or a baseline in an evaluation.
#[derive(Clone, Copy)]
struct Row<'a> {
    name: &'a str,
    info: &'a PredictorInfo,
    scores: &'a ReplicationSummary,
}

impl<'a> Asked<'a> {
    fn all(study: &'a Study) -> impl Iterator<Item = Self> {
        study.evaluations.iter().filter_map(move |evaluation| {
            let StudyQuestion::Arms(name) = evaluation.plan.question else { return None };
            let title = real_study().title(name);
            Some(Self { study, evaluation, group: evaluation.report.groups.first()?, title })
        })
    }

    fn of(study: &'a Study, question: &str) -> Option<Self> {
        Self::all(study).find(|asked| asked.evaluation.plan.question.is_arms(question))
    }

    /// Models, then baselines.
    fn rows(self) -> Vec<Row<'a>> {
        let row = |scores: &'a ReplicationSummary| {
            let first = scores.predictors.first()?;
            let predictors = &self.evaluation.report.predictors;
            let info = predictors.iter().find(|info| info.name == *first)?;
            Some(Row { name: self.study.name_of(info), info, scores })
        };
        let mut rows: Vec<Row<'a>> = self.group.replications.iter().filter_map(row).collect();
        rows.sort_by_key(|row| row.info.kind == PredictorKind::Baseline);
        rows
    }

    fn row(self, name: &str) -> Option<Row<'a>> {
        self.rows().into_iter().find(|row| row.name == name)
    }

    /// The lengths of the parts of the horizon, s.
    fn seconds(self) -> Vec<f64> {
        let longest = self.group.replications.iter().max_by_key(|row| row.errors.len());
        longest.into_iter().flat_map(|row| &row.errors).map(|error| error.seconds).collect()
    }

    fn context_s(self) -> f64 {
        f64::from(self.evaluation.report.context) / self.evaluation.report.rate_hz
    }

    /// The difference of two rows over a part of the horizon, whichever of them came first.
    fn difference(self, row: &Row<'_>, against: &Row<'_>, seconds: f64) -> Option<Interval> {
        let [ours, theirs] = [row, against].map(|row| row.scores.predictors.first());
        let (ours, theirs) = (ours?, theirs?);
        let mut all = self.group.replication_differences.iter();
        all.find_map(|found| {
            let pair = [&found.predictor, &found.against];
            let Interval { mean, low, high } = found.difference_deg;
            match found.seconds == seconds {
                true if pair == [ours, theirs] => Some(found.difference_deg),
                true if pair == [theirs, ours] => {
                    Some(Interval { mean: -mean, low: -high, high: -low })
                }
                _ => None,
            }
        })
    }

    /// The scores of each training of a row, which `groups` of reports have one by one.
    fn scores(self, row: &Row<'_>) -> Vec<&'a PredictorScores> {
        let is_of_row =
            |scores: &&PredictorScores| row.scores.predictors.contains(&scores.predictor);
        self.group.scores.iter().filter(is_of_row).collect()
    }
}

impl Row<'_> {
    fn error(&self, seconds: f64) -> Option<&ReplicatedError> {
        self.scores.errors.iter().find(|error| error.seconds == seconds)
    }

    fn rmse(&self, seconds: f64) -> Option<Cell> {
        Some(Cell::Interval(self.error(seconds)?.rmse_deg, Unit::Degrees))
    }

    /// How many trainings it stands for; missing for baselines.
    fn trainings(&self) -> Option<String> {
        let is_trained = self.info.kind == PredictorKind::Checkpoint;
        is_trained.then(|| self.scores.predictors.len().to_string())
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

fn after(seconds: f64) -> String {
    format!("{} s", significant(seconds))
}

/// A table without columns if the study has no such evaluation.
fn nothing() -> TableOf<()> {
    TableOf::new([])
}

/// Errors, skill and latency on arms as in training.
fn usual(study: &Study) -> Table {
    let Some(asked) = Asked::of(study, USUAL) else { return nothing().titled("", "") };
    let last = asked.seconds().last().copied().unwrap_or_default();
    let whole = |name: &str| Some(asked.row(name)?.error(last)?.rmse_deg.mean);
    let bounds = whole(HELD).zip(whole(ORACLE));
    let skill = |row: &Row<'_>| {
        let ((held, known), own) = (bounds?, row.error(last)?.rmse_deg.mean);
        (held > known).then(|| Cell::Number((held - own) / (held - known), Unit::Ratio))
    };
    let told = |row: &Row<'_>| row.info.told.clone().unwrap_or_default();
    let names = TableOf::new(asked.rows())
        .text("", |row| row.name)
        .text("trainings", Row::trainings)
        .text("prior knowledge", told);
    let with_errors = asked
        .seconds()
        .into_iter()
        .fold(names, |table, seconds| table.text(&after(seconds), |row| row.rmse(seconds)));
    let ms = |row: &Row<'_>| Some(format!("{:.1} ms", row.info.latency.as_ref()?.median_ms));
    with_errors
        .text("skill", skill)
        .text("diverged", |row| Cell::Number(row.scores.diverged, Unit::Share))
        .text("latency", ms)
        .titled("", "")
}

/// A table for each part of the horizon: models, and the predictors that they are compared with.
fn differences(study: &Study) -> String {
    let Some(asked) = Asked::of(study, USUAL) else { return String::new() };
    let models =
        || asked.rows().into_iter().filter(|row| row.info.kind == PredictorKind::Checkpoint);
    let mut page = String::new();
    for seconds in asked.seconds() {
        let names = TableOf::new(models()).text("", |row| row.name);
        let table = REFERENCES.into_iter().fold(names, |table, name| {
            let reference = asked.row(name);
            table.text(name, |row| {
                let against = reference.filter(|against| against.name != row.name)?;
                Some(Cell::Difference(asked.difference(row, &against, seconds)?))
            })
        });
        let _ = writeln!(page, "Over {}:\n\n{}", after(seconds), table.to_markdown());
    }
    page
}

fn joints(study: &Study) -> Table {
    let Some(asked) = Asked::of(study, USUAL) else { return nothing().titled("", "") };
    let joints = asked.group.scores.iter().map(|scores| scores.joint_rmse_deg.len()).max();
    let names = TableOf::new(asked.rows()).text("", |row| row.name);
    let table = (0..joints.unwrap_or(0)).fold(names, |table, joint| {
        table.text(&format!("joint {}", joint + 1), |row| {
            let each = asked.scores(row).into_iter();
            let rmse = mean(each.filter_map(|scores| scores.joint_rmse_deg.get(joint).copied()))?;
            Some(Cell::Number(rmse, Unit::Degrees))
        })
    });
    table.titled("", "")
}

/// A table for each part of the horizon, with a column for each question. `contexts` names columns by
/// the length of the context.
fn by_horizon(study: &Study, questions: &[&str], contexts: bool) -> String {
    let asked: Vec<Asked<'_>> =
        questions.iter().filter_map(|name| Asked::of(study, name)).collect();
    let Some(first) = asked.first() else { return String::new() };
    let mut page = String::new();
    for (k, seconds) in first.seconds().into_iter().enumerate() {
        let names = TableOf::new(first.rows()).text("", |row| row.name);
        let table = asked.iter().fold(names, |table, asked| {
            let heading = if contexts { after(asked.context_s()) } else { asked.title.to_owned() };
            let part = asked.seconds().get(k).copied();
            table.text(&heading, |row| asked.row(row.name)?.rmse(part?))
        });
        let _ = writeln!(page, "Over {}:\n\n{}", after(seconds), table.to_markdown());
    }
    page
}

/// How often intervals hold: of all positions, by part of the horizon, and by joint.
fn coverage(study: &Study) -> String {
    let Some(asked) = Asked::of(study, SAMPLES) else { return String::new() };
    let is_sampled =
        |row: &Row<'_>| asked.scores(row).iter().any(|scores| scores.crps_deg.is_some());
    let rows: Vec<Row<'_>> = asked.rows().into_iter().filter(is_sampled).collect();
    let of = |row: &Row<'_>, of: &dyn Fn(&PredictorScores) -> Option<f64>| {
        mean(asked.scores(row).into_iter().filter_map(of))
    };
    let inside =
        |row: &Row<'_>, nominal: f64, pick: &dyn Fn(&wire::IntervalSummary) -> Option<f64>| {
            let share = of(row, &|scores| {
                let mut all = scores.intervals.iter();
                pick(all.find(|interval| (interval.nominal - nominal).abs() < 1e-9)?)
            });
            Some(Cell::Number(share?, Unit::Share))
        };
    let first = TableOf::new(rows.iter().copied())
        .text("", |row| row.name)
        .text("RMSE of the mean", |row| of(row, &|it| Some(it.mean_rmse_deg?.mean)).map(degrees))
        .text("CRPS", |row| of(row, &|it| Some(it.crps_deg?.mean)).map(degrees));
    let by_time = [0.5, 0.9].into_iter().fold(first, |table, nominal| {
        let percent = 100.0 * nominal;
        let all = table.text(&format!("in {percent:.0} %"), |row| {
            inside(row, nominal, &|interval| Some(interval.coverage.mean))
        });
        asked.seconds().into_iter().fold(all, |table, seconds| {
            let step = step_at(seconds, asked.evaluation.report.rate_hz);
            table.text(&format!("after {}", after(seconds)), |row| {
                inside(row, nominal, &|interval| interval.step_coverage.get(step).copied())
            })
        })
    });
    let joints = asked.group.scores.iter().map(|scores| scores.joint_rmse_deg.len()).max();
    let names = TableOf::new(rows).text("in 90 %", |row| row.name);
    let by_joint = (0..joints.unwrap_or(0)).fold(names, |table, joint| {
        table.text(&format!("joint {}", joint + 1), |row| {
            inside(row, 0.9, &|interval| interval.joint_coverage.get(joint).copied())
        })
    });
    format!("{}\n{}", by_time.to_markdown(), by_joint.to_markdown())
}

pub fn tables(study: &Study) -> Vec<Table> {
    vec![errors(study), compared(study), latency(study), trainings(study)]
}

/// The first columns of the row of an evaluation.
fn question(asked: &Asked<'_>) -> Vec<String> {
    let Asked { study, evaluation, group, title } = asked;
    let context = asked.context_s().to_string();
    let set = study.set_name(evaluation.plan.set);
    vec![
        set,
        evaluation.record.name.clone(),
        (*title).to_owned(),
        group.scenarios.to_string(),
        context,
    ]
}

fn errors(study: &Study) -> Table {
    let mut table = table(
        "errors",
        "arm evaluation question scenarios context_s predictor trainings horizon_s rmse_deg low high \
         seed_rmse_deg diverged job digest",
    );
    for asked in Asked::all(study) {
        for row in asked.rows() {
            for error in &row.scores.errors {
                let mut cells = question(&asked);
                let seeds: Vec<String> = error.seed_rmse_deg.iter().map(f64::to_string).collect();
                cells.extend([
                    row.name.to_owned(),
                    text(row.trainings()),
                    error.seconds.to_string(),
                ]);
                cells.extend(interval(error.rmse_deg));
                cells.extend([seeds.join(" "), row.scores.diverged.to_string()]);
                cells.extend(source(asked.evaluation));
                table.push(cells);
            }
        }
    }
    table
}

fn compared(study: &Study) -> Table {
    let mut table = table(
        "differences",
        "arm evaluation question scenarios context_s predictor against horizon_s difference_deg low high \
         job digest",
    );
    for asked in Asked::all(study) {
        for found in &asked.group.replication_differences {
            let mut cells = question(&asked);
            let names = [&found.predictor, &found.against];
            cells.extend(names.map(|name| study.called(asked.evaluation, name).to_owned()));
            cells.push(found.seconds.to_string());
            cells.extend(interval(found.difference_deg));
            cells.extend(source(asked.evaluation));
            table.push(cells);
        }
    }
    table
}

#[cfg(test)]
mod tests;
