//! The report of the paper's study: text, tables and figures.

mod claims;
mod columns;
mod errors;
mod figures;
mod headline;
mod samples;
mod tables;
mod text;

pub(super) use figures::all as figures;
pub(super) use tables::all as tables;
pub(super) use text::readme;

#[cfg(test)]
mod fixture;

#[cfg(test)]
mod tests {
    use spec::JobSpec;

    use super::columns::COLUMNS;
    use super::*;
    use crate::study::write;

    fn csv(name: &str) -> String {
        let table = tables(&fixture::study()).into_iter().find(|table| table.title == name);
        table.unwrap().to_csv().unwrap()
    }

    #[test]
    fn replications_are_one_row_and_every_training_is_another() {
        let shifts = csv("shifts");
        let expected = "D2,d2-sweep,above the band,chirp,40,30,lagrangian,3,6,5.9,6.1,";
        assert!(shifts.lines().any(|line| line.starts_with(expected)), "{shifts}");
        let seeds = csv("seeds");
        let expected = "D2,d2-sweep,above the band,chirp,lagrangian,d2-lagrangian-2,6.5,";
        assert!(seeds.lines().any(|line| line.starts_with(expected)), "{seeds}");
    }

    #[test]
    fn a_difference_is_found_whichever_of_the_two_came_first() {
        let study = fixture::study();
        let found =
            |name: &str, against: &str| COLUMNS[0].difference(&study, 1, name, against).unwrap();
        // The Lagrangian is the first in the list, and RoboMorph the second.
        let forwards = found("robomorph", "lagrangian");
        assert_eq!((forwards.mean, forwards.low), (1.0, 0.9));
        let backwards = found("lagrangian", "robomorph");
        assert_eq!((backwards.mean, backwards.low, backwards.high), (-1.0, -1.1, -0.9));
    }

    #[test]
    fn claims_are_counted_over_the_training_sets() {
        let study = fixture::study();
        let robustness = claims::robustness(&study);
        let line = "| lagrangian | robomorph | 2 better, 0 worse of 2 | - | 2 better, 0 worse of 2 | - | - | - |";
        assert!(robustness.contains(line), "{robustness}");
        let inpainting = claims::inpainting(&study);
        let line =
            "| diffuser | cdt | 1 better, 0 worse of 1 | - | 1 better, 0 worse of 1 | - | - | - |";
        assert!(inpainting.contains(line), "{inpainting}");
        let baselines = claims::against_baselines(&study);
        let line = "| lagrangian | arx | 1 better, 0 worse of 2 | - |";
        assert!(baselines.contains(line), "{baselines}");
    }

    #[test]
    fn the_headline_says_what_was_rejected_and_how_many_trainings_there_were() {
        let text = headline::errors(&fixture::study());
        let line = "| *rejected* |  | *25 % of 40* | - | *25 % of 40* | - | - | - |";
        assert!(text.contains(line), "{text}");
        let line = "| lagrangian | 3 | 2.00 [1.90, 2.10] | - | 4.00 [3.90, 4.10] | - | - | - |";
        assert!(text.contains(line), "{text}");
        assert!(text.contains("| arx | - | 3.00 [2.90, 3.10] |"), "{text}");
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
        assert!(readme.contains("robots of trainings 101, 102, 103, 201"), "{readme}");
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
            "figures/within.svg",
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
