//! The README of a study's folder, the first page for readers.

use std::fmt::Write;

use spec::StudyScale;

use super::super::results::Study;
use super::super::text::{SOURCES, image, setting};
use super::{claims, headline, samples};

/// The first page for readers.
pub fn readme(study: &Study) -> String {
    let mut text = String::new();
    let scale = study.scale.name();
    let _ = writeln!(text, "# The paper's study, scale `{scale}`\n");
    let _ = writeln!(text, "{}\n", about(study.scale));
    let _ = writeln!(text, "    torqued study --scale {scale}\n");
    let _ = writeln!(text, "{}", setting(study));
    for section in sections(study) {
        let Section { title, about, numbers, figures } = section;
        let _ = writeln!(text, "## {title}\n\n{about}\n\n{numbers}");
        for figure in figures {
            let _ = writeln!(text, "{}", image(figure));
        }
    }
    for evaluation in &study.evaluations {
        let names = evaluation.files.iter().map(|file| file.name.as_str());
        let figures: Vec<&str> = names.filter_map(|name| name.strip_suffix(".svg")).collect();
        if !figures.is_empty() {
            let name = &evaluation.record.name;
            let _ = writeln!(text, "## {name}\n");
            for figure in figures {
                let _ = writeln!(text, "{}", image(&format!("{name}-{figure}")));
            }
        }
    }
    text + SOURCES
}

/// A section of the report with a title.
struct Section {
    title: &'static str,
    about: &'static str,
    numbers: String,
    figures: &'static [&'static str],
}

fn sections(study: &Study) -> Vec<Section> {
    let plain = |title, about, numbers| Section { title, about, numbers, figures: &[] };
    vec![
        Section {
            title: "Errors, by how far torques are from those of the training",
            about: "Mean RMSE in degrees over the horizon [95 % interval], one prediction per scenario, over the \
                    scenarios whose torques stay within the rated 87 and 12 N·m; *rejected* is the share of the \
                    others, which no column counts. Torques of chirps have the same size at every frequency, those \
                    of multisines grow with it. Nothing is trained on steps. Intervals are over robots and, of \
                    trained models, over trainings, each with another seed and other robots: half-widths of both, \
                    added as squares, of robots by the bootstrap, of trainings by Student's t.",
            numbers: headline::errors(study),
            figures: &["within", "above-chirps", "above-multisines", "steps"],
        },
        plain(
            "Skill relative to the integrator",
            "1 - RMSE / RMSE of `damped-integrator` on the same scenarios: 1 is perfect, 0 as good as a line of \
             code, below 0 worse. Cells that are hard for everyone do not lower it, which a ratio of errors out of \
             and in distribution does.",
            headline::skill(study),
        ),
        plain(
            "Worst cases and time",
            "The largest RMSE of a scenario in any column above, the largest share of diverged predictions of a \
             column, and one prediction of one robot at batch 1.",
            headline::worst(study),
        ),
        plain(
            "Joint by joint",
            "Mean RMSE in degrees of each joint, trained on D1, within what was trained.",
            headline::joints(study),
        ),
        plain(
            "Beside what needs no training",
            "On how many training sets a model's RMSE is clearly better or worse on the same scenarios: the 95 % \
             interval of the difference leaves zero out.",
            claims::against_baselines(study),
        ),
        plain(
            "Claim 1: diffusion models hold up out of distribution",
            "The same of every model that gives samples, against RoboMorph, the deterministic Transformer.",
            claims::robustness(study),
        ),
        plain(
            "Claim 2: inpainting is best",
            "The same of the Diffuser, which inpaints, against the denoisers that are conditioned.",
            claims::inpainting(study),
        ),
        plain(
            "Claim 3: warm-started diffusion is accurate within 40 ms",
            "`cold` begins with noise, `shifted` with the model's own prediction of one control period ago, noised \
             to the level where its steps begin, `oracle` with the true future noised likewise. Latency is that of \
             one prediction at batch 1. One training of each; intervals are over robots alone.",
            claims::warm_start(study),
        ),
        plain(
            "Samples and their means",
            "RMSE in degrees of one sample, and of the mean of all; CRPS in degrees; shares of measured positions \
             inside the central intervals. Means over the trainings, and the least and the most of them.",
            samples::table(study),
        ),
        plain(
            "Contexts and horizons",
            "Trained on D1. `robomorph` is trained for each length, `lagrangian` once; the other models have one \
             length only.",
            headline::lengths(study),
        ),
    ]
}

const fn about(scale: StudyScale) -> &'static str {
    match scale {
        StudyScale::Tiny => {
            "Every kind of job of the study, each far too small: this shows that it runs, and nothing about \
             the models."
        }
        StudyScale::Small => {
            "Tiny models, 2500 steps of 32 trajectories each, the same for all networks: a hundredth of the \
             paper's samples and less; a `lagrangian` takes 5000 of 48. No two trainings of a model share robots, \
             nor does any share them with a test. Denoisers predict the clean series instead of the noise, which \
             trains faster, are trained on D1 alone, and are sampled by DDIM in 10 steps but for the warm start."
        }
        StudyScale::Paper => {
            "The paper's sizes: 3.5e6 samples per training, networks of 17 to 63 M parameters."
        }
    }
}
