use wire::{GroupSummary, Interval, Report};

use super::{degrees, label};
use crate::table::{Align, Table};

/// Tables, one per group, of how every predictor's predictions begin, how they jump, and how far
/// they go. Empty for a report from before this was measured.
pub fn by_rollout(report: &Report) -> String {
    let measured = |group: &&GroupSummary| {
        !group.rollouts.is_empty()
            || group.scores.iter().any(|scores| scores.first_sample_deg.is_some())
    };
    let tables = report.groups.iter().filter(measured).map(|group| of_group(report, group));
    tables.collect::<Vec<_>>().join("\n")
}

fn of_group(report: &Report, group: &GroupSummary) -> String {
    let columns = [
        (group.name.as_str(), Align::Left),
        ("first sample", Align::Right),
        ("jump", Align::Right),
        ("at seams", Align::Right),
        ("largest", Align::Right),
        ("left limits", Align::Right),
        ("diverged", Align::Right),
    ];
    let mut table = Table::new(columns);
    for predictor in &report.predictors {
        let scores = group.scores.iter().find(|scores| scores.predictor == predictor.name);
        let rollouts = group.rollouts.iter().find(|rollouts| rollouts.predictor == predictor.name);
        let number = |interval: Option<Interval>| interval.map(|interval| degrees(interval.mean));
        let cells = [
            number(scores.and_then(|scores| scores.first_sample_deg)),
            number(scores.and_then(|scores| scores.jump_deg)),
            number(scores.and_then(|scores| scores.seam_jump_deg)),
            number(scores.and_then(|scores| scores.largest_jump_deg)),
            rollouts.and_then(|rollouts| rollouts.left_limits).map(per_cent),
            rollouts.map(|rollouts| per_cent(rollouts.diverged)),
        ];
        let cells = cells.map(|cell| cell.unwrap_or_else(|| "-".to_owned()));
        table.push(std::iter::once(label(predictor)).chain(cells).collect());
    }
    table.render()
}

fn per_cent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::super::example;
    use super::*;

    #[test]
    fn each_group_says_how_predictions_begin_and_where_they_went() {
        let mut report = example();
        let interval = |mean: f64| Some(Interval { mean, low: mean, high: mean });
        report.groups[0].scores = vec![wire::PredictorScores {
            predictor: "robomorph".to_owned(),
            first_sample_deg: interval(0.35),
            jump_deg: interval(0.19),
            seam_jump_deg: interval(0.39),
            largest_jump_deg: interval(0.8),
            ..wire::PredictorScores::default()
        }];
        report.groups[0].rollouts = vec![wire::RolloutSummary {
            predictor: "robomorph".to_owned(),
            left_limits: Some(0.015),
            diverged: 0.0,
        }];
        let text = by_rollout(&report);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            [lines[0], lines[1], lines[3]],
            [
                "in distribution    first sample  jump  at seams  largest  left limits  diverged",
                "hold-last                     -     -         -        -            -         -",
                "robomorph                  0.35  0.19      0.39     0.80        1.5 %     0.0 %",
            ]
        );
        assert_eq!(lines.len(), 4, "nothing was measured out of distribution");
    }

    #[test]
    fn an_old_report_has_no_such_table() {
        assert_eq!(by_rollout(&example()), "");
    }
}
