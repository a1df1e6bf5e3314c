use evaluation::{
    calibration_figure, crps_figure, horizon_figure, latency_figure, rmse_figure,
    sampler_steps_figure,
};
use figures::Figure;
use spec::Family;
use wire::{GroupSummary, PredictorInfo, Report, at_noise};

/// The figures that a report has data for, with the names of their files.
pub(super) fn all(report: &Report) -> Vec<(String, Figure)> {
    let mut figures = Vec::new();
    let has_samples = scores(report).any(|scores| scores.crps_deg.is_some());
    for (family, level) in families(report) {
        let place = format!("{family}{}", at_noise(level)).replace(' ', "-");
        figures.push((format!("rmse-{place}"), rmse_figure(report, family, level)));
        if has_samples {
            figures.push((format!("crps-{place}"), crps_figure(report, family, level)));
        }
    }
    for group in &report.groups {
        let group_name = group.name.replace(' ', "-");
        figures.push((format!("horizon-{group_name}"), horizon_figure(report, group)));
        if varies_steps(report) {
            figures.push((format!("steps-{group_name}"), sampler_steps_figure(report, group)));
        }
        if group.scores.iter().any(|scores| !scores.calibration.is_empty()) {
            let figure = calibration_figure(report, group);
            figures.push((format!("calibration-{group_name}"), figure));
        }
    }
    if report.predictors.iter().any(|info| info.latency.is_some()) {
        figures.push(("latency".to_owned(), latency_figure(report)));
    }
    figures
}

/// The families that cells have, each with its levels of noise.
fn families(report: &Report) -> Vec<(Family, f64)> {
    let mut found = Vec::new();
    for family in Family::ALL {
        for cell in report.cells.iter().filter(|cell| cell.family == Some(family)) {
            if !found.contains(&(family, cell.position_noise_rad)) {
                found.push((family, cell.position_noise_rad));
            }
        }
    }
    found
}

fn scores(report: &Report) -> impl Iterator<Item = &wire::PredictorScores> {
    report.groups.iter().flat_map(|group: &GroupSummary| &group.scores)
}

/// Whether some predictors differ only in the steps of their sampler.
fn varies_steps(report: &Report) -> bool {
    let curve =
        |info: &PredictorInfo| info.sampling.as_ref().map(|sampling| sampling.curve.clone());
    let curves: Vec<String> = report.predictors.iter().filter_map(curve).collect();
    curves.iter().enumerate().any(|(k, curve)| curves[..k].contains(curve))
}
