use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use spec::{DataSource, JobSpec, PipelineSpec};
use wire::Interval;

use crate::degrees;

use super::super::machine;
use super::super::plan::Scale;
use super::super::results::Study;
use super::{claims, tables};

/// What a reader opens first.
pub fn readme(study: &Study) -> String {
    let mut text = String::new();
    let scale = study.scale.name();
    let _ = writeln!(text, "# The paper's study, scale `{scale}`\n");
    let _ = writeln!(text, "{}\n", about(study.scale));
    let _ = writeln!(text, "    torqued study --scale {scale}\n");
    let _ = writeln!(text, "{}", setting(study));
    let sections = [
        (
            "Claim 1: diffusion models hold up out of distribution",
            "Mean RMSE in degrees over the horizon [95 % confidence interval], one prediction per \
             scenario. A cell is in distribution when the training set drew its excitation and \
             frequency. Differences are paired: the same robots under the same torques.",
            claims::robustness(study),
            &["in-distribution", "out-of-distribution"][..],
        ),
        (
            "Beside what needs no training",
            "On how many training sets each model's RMSE is better or worse than that of a line of code \
             (`damped-integrator`), of a fit on the context (`arx`), and of an identification of the \
             arm's own parameters through the simulator (`identification`), on the same scenarios.",
            claims::against_baselines(study),
            &[],
        ),
        (
            "Claim 2: inpainting is best",
            "Differences of RMSE in degrees; below 0 the Diffuser is better.",
            claims::inpainting(study),
            &[],
        ),
        (
            "Claim 3: warm-started diffusion is accurate within 40 ms",
            "`cold` begins with noise, `shifted` with the model's own prediction of one control \
             period ago, noised to the level where its steps begin, `oracle` with the true future \
             noised likewise. Latency is that of one prediction at batch 1.",
            claims::warm_start(study),
            &[],
        ),
    ];
    for (title, about, numbers, figures) in sections {
        let _ = writeln!(text, "## {title}\n\n{about}\n\n{numbers}");
        for figure in figures {
            let _ = writeln!(text, "{}", image(figure));
        }
    }
    for evaluation in study.evaluations() {
        let name = &evaluation.record.name;
        let names = evaluation.files.iter().map(|file| file.name.as_str());
        let _ = writeln!(text, "## {name}\n");
        for figure in names.filter_map(|name| name.strip_suffix(".svg")) {
            let _ = writeln!(text, "{}", image(&format!("{name}-{figure}")));
        }
    }
    for (title, name) in [("Samples as distributions", "samples"), ("Trainings", "trainings")] {
        if let Some(table) = tables::all(study).into_iter().find(|table| table.name == name) {
            let _ = writeln!(text, "## {title}\n\n{}", shown(&table));
        }
    }
    let _ = writeln!(
        text,
        "## Where the numbers come from\n\n`tables/` holds every number with the id of its job and \
         the digest of the job's spec, which covers everything upstream; `evaluations/` the reports \
         as the jobs wrote them; `study.json` all jobs and checkpoints; `pipeline.json` every job with \
         all its defaults, to be submitted as it is or changed."
    );
    text
}

/// One of the report's figures.
fn image(name: &str) -> String {
    format!("![{name}](figures/{name}.svg)\n")
}

const fn about(scale: Scale) -> &'static str {
    match scale {
        Scale::Tiny => {
            "Every job of the study, each far too small: this shows that it runs, and nothing about \
             the models."
        }
        Scale::Small => {
            "Tiny models on 65 536 robots per training set, 2500 steps of 32 trajectories each, the \
             same for all models: a hundredth of the paper's samples and less. Denoisers predict the \
             clean series instead of the noise, which trains faster, and are sampled by DDPM through \
             all 100 levels."
        }
        Scale::Paper => {
            "The paper's sizes: 3.5e6 samples per training, networks of 17 to 63 M parameters."
        }
    }
}

fn setting(study: &Study) -> String {
    let mut rows = vec![
        vec!["machine".to_owned(), machine::describe()],
        vec!["torqued".to_owned(), env!("CARGO_PKG_VERSION").to_owned()],
        vec![
            "pipeline".to_owned(),
            format!("job {}, digest `{}`", study.pipeline.job, study.pipeline.digest),
        ],
    ];
    if let Some(seconds) = study.pipeline.seconds {
        rows.push(vec!["time".to_owned(), format!("{:.0} min", seconds / 60.0)]);
    }
    rows.push(vec!["seeds".to_owned(), seeds(&study.spec)]);
    for set in &study.sets {
        let what = format!("{} trajectories, digest `{}`", set.trajectories, set.data.digest);
        rows.push(vec![set.name.clone(), what]);
    }
    markdown(&["", ""], &rows)
}

/// Of what all jobs draw, each once.
fn seeds(pipeline: &PipelineSpec) -> String {
    let mut drawn: BTreeMap<&str, BTreeSet<u64>> = BTreeMap::new();
    for member in pipeline.jobs.values() {
        let mut add = |what, seed| drawn.entry(what).or_default().insert(seed);
        match &member.spec {
            JobSpec::Simulate(spec) => drop(add("robots of training sets", spec.seed)),
            JobSpec::Train(spec) => drop(add("trainings", spec.seed)),
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

/// A table without what is there for tracing alone.
fn shown(table: &tables::Table) -> String {
    const LEFT_OUT: [&str; 5] = ["job", "digest", "sha256", "checkpoint", "reused"];
    let kept: Vec<usize> = (0..table.columns.len())
        .filter(|&column| !LEFT_OUT.contains(&table.columns[column]))
        .collect();
    let columns: Vec<&str> = kept.iter().map(|&column| table.columns[column]).collect();
    let rows: Vec<Vec<String>> = table
        .rows
        .iter()
        .map(|row| kept.iter().map(|&column| short(&row[column])).collect())
        .collect();
    markdown(&columns, &rows)
}

/// Numbers as people read them.
fn short(field: &str) -> String {
    match field.parse::<f64>() {
        Ok(value) if value.fract() != 0.0 => significant(value),
        _ => field.to_owned(),
    }
}

/// A table in Markdown.
pub fn markdown(columns: &[&str], rows: &[Vec<String>]) -> String {
    let mut text = format!("| {} |\n|{}\n", columns.join(" | "), "---|".repeat(columns.len()));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text
}

pub fn with_interval(Interval { mean, low, high }: Interval) -> String {
    format!("{} [{}, {}]", degrees(mean), degrees(low), degrees(high))
}

/// Three significant digits.
fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    #[expect(clippy::cast_possible_truncation, reason = "between -308 and 308")]
    let exponent = value.abs().log10().floor() as i32;
    let decimals = usize::try_from(2 - exponent).unwrap_or(0);
    format!("{value:.decimals$}")
}
