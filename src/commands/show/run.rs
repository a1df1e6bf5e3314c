use std::collections::BTreeMap;

use reports::{Align, Table};
use wire::{LatestMetric, Run};

use super::{Facts, file_table};
use crate::progress::measure;

pub fn text(run: &Run) -> String {
    let mut facts = Facts::new();
    facts.add("run", run.id);
    facts.add("kind", run.kind);
    facts.add("name", &run.name);
    facts.add_labels(&run.tags, &run.job_tags, run.note.as_deref());
    facts.add("state", run.state);
    facts.add_some("error", run.error.as_ref());
    facts.add("job", run.job);
    facts.add_time("created", Some(&run.created_at));
    facts.add("digest", run.digest);
    let files = run.artifacts.iter().map(|file| (file.name.as_str(), file.size, &file.sha256));
    let files = if run.artifacts.is_empty() { String::new() } else { file_table(files) };
    let metrics = if run.metrics.is_empty() { String::new() } else { metrics(&run.metrics) };
    facts.render() + &metrics + &files
}

fn metrics(latest: &BTreeMap<String, LatestMetric>) -> String {
    let mut table =
        Table::new([("metric", Align::Left), ("step", Align::Right), ("latest", Align::Right)]);
    for (key, metric) in latest {
        let value = metric.value.map_or_else(|| "not finite".to_owned(), |value| value.to_string());
        table.push(vec![key.clone(), measure::count(metric.step), value]);
    }
    format!("\n{}", table.render())
}
