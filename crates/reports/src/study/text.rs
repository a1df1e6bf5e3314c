//! Parts of every report's text.

use std::collections::{BTreeMap, BTreeSet};

use spec::{DataSource, JobSpec, PipelineSpec};

use super::machine;
use super::results::Study;
use crate::{Align, Table};

/// The last section of a report.
pub(super) const SOURCES: &str = "\
## Where the numbers come from

`tables/` holds every number with the id of its job and the digest of the job's spec, which covers everything upstream; \
`evaluations/` the reports as the jobs wrote them; `study.json` all jobs and checkpoints; `pipeline.json` every job with \
all its defaults, to be submitted as it is or changed.
";

/// One of the report's figures.
pub(super) fn image(name: &str) -> String {
    format!("![{name}](figures/{name}.svg)\n")
}

/// Machine, version, pipeline, time and seeds of a study.
pub(super) fn setting(study: &Study) -> String {
    let mut table = Table::new([("", Align::Left), ("", Align::Left)]);
    let mut add = |name: &str, value: String| table.push(vec![name.to_owned(), value]);
    add("machine", machine::describe());
    add("torqued", env!("CARGO_PKG_VERSION").to_owned());
    add("pipeline", format!("job {}, digest `{}`", study.pipeline.job, study.pipeline.digest));
    if let Some(seconds) = study.pipeline.seconds {
        add("time", format!("{:.0} min", seconds / 60.0));
    }
    add("seeds", seeds(&study.spec));
    table.to_markdown()
}

/// A list of the seeds of all jobs, each once.
fn seeds(pipeline: &PipelineSpec) -> String {
    let mut drawn: BTreeMap<&str, BTreeSet<u64>> = BTreeMap::new();
    for member in pipeline.jobs.values() {
        let mut add = |what, seed| {
            drawn.entry(what).or_default().insert(seed);
        };
        match &member.spec {
            JobSpec::Simulate(spec) => add("robots of trainings", spec.seed),
            JobSpec::Train(spec) => {
                add("trainings", spec.seed);
                for source in spec.data.each() {
                    if let DataSource::Stream(robots) = source {
                        add("robots of trainings", robots.seed);
                    }
                }
            }
            JobSpec::Evaluate(spec) => {
                add("noise of samplers", spec.seed);
                add("bootstrap", spec.bootstrap.seed);
                if let DataSource::Stream(robots) = &spec.data {
                    add("robots of evaluations", robots.seed);
                }
            }
            _ => {}
        }
    }
    let each = drawn.iter().map(|(what, seeds)| {
        let seeds: Vec<String> = seeds.iter().map(u64::to_string).collect();
        format!("{what} {}", seeds.join(", "))
    });
    each.collect::<Vec<_>>().join("; ")
}
