//! The folder with a study's report: text, tables, figures, and the source of each number.

use std::path::Path;

use anyhow::Context;
use spec::{JobSpec, StudyEdition};

use super::folder::Folder;
use super::results::Study;
use super::{paper, real};

/// Writes the report of a study into `out`. An older report there is replaced.
///
/// # Errors
/// When the folder has other contents, or on an error of the disk.
pub fn write(out: &Path, study: &Study) -> anyhow::Result<()> {
    let mut folder = Folder::new();
    let (tables, figures, readme) = match study.edition {
        StudyEdition::Paper => (paper::tables(study), paper::figures(study)?, paper::readme(study)),
        StudyEdition::Real => (real::tables(study), real::figures(study)?, real::readme(study)),
    };
    for table in tables {
        folder.add(format!("tables/{}.csv", table.title), table.to_csv()?);
    }
    for figure in figures {
        folder.add(format!("figures/{}", figure.name), figure.bytes);
    }
    for evaluation in &study.evaluations {
        let json = serde_json::to_vec(&evaluation.report)?;
        folder.add(format!("evaluations/{}.json", evaluation.record.name), json);
    }
    folder.add("study.json".to_owned(), provenance(study)?);
    let pipeline = JobSpec::Pipeline(study.spec.clone()).to_json();
    folder.add("pipeline.json".to_owned(), serde_json::to_vec_pretty(&pipeline)?);
    folder.add("README.md".to_owned(), readme);
    folder.write(out).with_context(|| format!("cannot write {}", out.display()))
}

/// Every job with its digest, as the source of the numbers.
fn provenance(study: &Study) -> anyhow::Result<Vec<u8>> {
    let mut jobs = vec![&study.pipeline];
    jobs.extend(study.trainings.iter().map(|training| &training.record));
    jobs.extend(study.evaluations.iter().map(|evaluation| &evaluation.record));
    let checkpoints = study.trainings.iter().map(|training| {
        serde_json::json!({
            "name": training.record.name,
            "checkpoint": training.checkpoint,
            "steps": training.steps,
            "sha256": training.sha256,
        })
    });
    let all = serde_json::json!({
        "edition": study.edition.name(),
        "study": study.scale.name(),
        "torqued": env!("CARGO_PKG_VERSION"),
        "machine": super::machine::describe(),
        "jobs": jobs,
        "checkpoints": checkpoints.collect::<Vec<_>>(),
    });
    Ok(serde_json::to_vec_pretty(&all)?)
}
