//! The folder that says what a study found: text, tables, figures, and where each number comes from.

mod claims;
mod errors;
mod figures;
mod folder;
mod tables;
mod text;

use std::path::Path;

use anyhow::Context;
use spec::JobSpec;

use super::results::{Evaluation, Set, Study};
use folder::Folder;
pub use folder::check_replaceable;

/// Writes the report of a study into `out`, which it replaces when it is such a report.
///
/// # Errors
/// A folder that holds anything else, and what the disk refuses.
pub fn write(out: &Path, study: &Study) -> anyhow::Result<()> {
    let mut folder = Folder::new();
    for table in tables::all(study) {
        folder.add(format!("tables/{}.csv", table.name), table.to_csv()?);
    }
    for figure in figures::all(study)? {
        folder.add(format!("figures/{}", figure.name), figure.bytes);
    }
    for evaluation in study.evaluations() {
        let json = serde_json::to_vec(&evaluation.report)?;
        folder.add(format!("evaluations/{}.json", evaluation.record.name), json);
    }
    folder.add("study.json".to_owned(), provenance(study)?);
    let pipeline = JobSpec::Pipeline(study.spec.clone()).to_json();
    folder.add("pipeline.json".to_owned(), serde_json::to_vec_pretty(&pipeline)?);
    folder.add("README.md".to_owned(), text::readme(study));
    folder.write(out).with_context(|| format!("cannot write {}", out.display()))
}

/// Every job with its digest, for whoever wants to know where a number comes from.
fn provenance(study: &Study) -> anyhow::Result<Vec<u8>> {
    let mut jobs = vec![&study.pipeline];
    for set in &study.sets {
        jobs.push(&set.data);
        jobs.extend(set.trainings.iter().map(|training| &training.record));
        jobs.extend([&set.sweep.record, &set.samples.record]);
    }
    jobs.push(&study.warm_start.record);
    let checkpoints = study.sets.iter().flat_map(|set| &set.trainings).map(|training| {
        serde_json::json!({
            "name": training.record.name,
            "checkpoint": training.checkpoint,
            "steps": training.steps,
            "sha256": training.sha256,
        })
    });
    let all = serde_json::json!({
        "study": study.scale.name(),
        "torqued": env!("CARGO_PKG_VERSION"),
        "machine": super::machine::describe(),
        "jobs": jobs,
        "checkpoints": checkpoints.collect::<Vec<_>>(),
    });
    Ok(serde_json::to_vec_pretty(&all)?)
}

impl Study {
    fn evaluations(&self) -> impl Iterator<Item = &Evaluation> {
        let of_sets = self.sets.iter().flat_map(|set| [&set.sweep, &set.samples]);
        of_sets.chain([&self.warm_start])
    }

    /// The set that the warm starts were trained on.
    fn warm_start_set(&self) -> Option<&Set> {
        self.sets.iter().find(|set| {
            let report = &self.warm_start.report;
            report.predictors.iter().any(|predictor| set.is_trained_here(predictor))
        })
    }
}

impl Set {
    fn is_trained_here(&self, predictor: &wire::PredictorInfo) -> bool {
        self.trainings.iter().any(|training| Some(training.record.digest) == predictor.digest)
    }
}

#[cfg(test)]
mod fixture;

#[cfg(test)]
mod tests {
    use super::errors::{IN_DISTRIBUTION, difference};
    use super::*;

    #[test]
    fn predictors_are_called_as_the_study_calls_its_models() {
        let table = tables::all(&fixture::study()).into_iter().find(|table| table.name == "rmse");
        let csv = String::from_utf8(table.unwrap().to_csv().unwrap()).unwrap();
        let line = csv.lines().find(|line| line.starts_with("D2,out of distribution,40,cdt,"));
        assert!(
            line.unwrap().starts_with("D2,out of distribution,40,cdt,14,13.9,14.1,20,"),
            "{csv}"
        );
    }

    #[test]
    fn a_difference_is_found_whichever_of_the_two_came_first() {
        let study = fixture::study();
        let report = &study.sets[0].sweep.report;
        let forwards = difference(report, IN_DISTRIBUTION, "checkpoint 3", "checkpoint 1").unwrap();
        let backwards =
            difference(report, IN_DISTRIBUTION, "checkpoint 1", "checkpoint 3").unwrap();
        assert_eq!((forwards.mean, forwards.low), (2.0, 1.9));
        assert_eq!((backwards.mean, backwards.low, backwards.high), (-2.0, -2.1, -1.9));
    }

    #[test]
    fn claims_are_counted_over_the_training_sets() {
        let study = fixture::study();
        let robustness = claims::robustness(&study);
        let line = "- `cdt` against `robomorph` out of distribution: better on 0 of 2, worse on 2, \
                    not clearly different on 0 training sets.";
        assert!(robustness.contains(line), "{robustness}");
        let inpainting = claims::inpainting(&study);
        let line = "- `diffuser` against `cdt` in distribution: better on 2 of 2, worse on 0, not \
                    clearly different on 0 training sets.";
        assert!(inpainting.contains(line), "{inpainting}");
    }

    #[test]
    fn models_are_counted_against_what_needs_no_training() {
        let text = claims::against_baselines(&fixture::study());
        let line = "| cdt | in distribution | - | better on 0 of 2, worse on 2, not clearly different \
                    on 0 | - |";
        assert!(text.contains(line), "{text}");
    }

    #[test]
    fn the_report_has_the_pipeline_to_submit_and_its_seeds() {
        let place = tempfile::tempdir().unwrap();
        let out = place.path().join("report");
        let study = fixture::study();
        write(&out, &study).unwrap();
        let pipeline = std::fs::read(out.join("pipeline.json")).unwrap();
        assert_eq!(spec::parse(&pipeline).unwrap(), JobSpec::Pipeline(study.spec));
        let readme = std::fs::read_to_string(out.join("README.md")).unwrap();
        assert!(readme.contains("robots of evaluations 1000003"), "{readme}");
    }

    #[test]
    fn a_warm_start_is_judged_by_its_time_and_by_what_it_costs() {
        let text = claims::warm_start(&fixture::study());
        let line = "- `cdt`, 5 warm-started steps: p99 30.0 ms on 2 threads, within 40 ms; worse than \
                    all steps from noise in distribution (0.50 [0.40, 0.60]).";
        assert!(text.contains(line), "{text}");
    }

    #[test]
    fn the_report_is_a_folder_of_text_tables_figures_and_sources() {
        let place = tempfile::tempdir().unwrap();
        let out = place.path().join("report");
        write(&out, &fixture::study()).unwrap();
        for file in [
            "README.md",
            "study.json",
            "tables/warm-start.csv",
            "figures/d1-sweep-rmse.svg",
            "figures/out-of-distribution.svg",
            "evaluations/warm-start.json",
        ] {
            assert!(out.join(file).is_file(), "{file}");
        }
        let readme = std::fs::read_to_string(out.join("README.md")).unwrap();
        for (_, rest) in readme.match_indices("](figures/").map(|(at, _)| readme.split_at(at)) {
            let file = rest[2..].split(')').next().unwrap();
            assert!(out.join(file).is_file(), "{file}");
        }
    }
}
