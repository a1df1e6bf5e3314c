use wire::Dataset;

use super::{Facts, file_table};
use crate::progress::measure;

pub fn text(dataset: &Dataset) -> String {
    let mut facts = Facts::new();
    facts.add("dataset", dataset.id);
    facts.add("name", &dataset.name);
    facts.add_labels(&dataset.tags, &dataset.job_tags, dataset.note.as_deref());
    facts.add("state", dataset.state);
    facts.add("job", dataset.job);
    facts.add("trajectories", measure::count(dataset.trajectories));
    facts.add("samples", format!("{} each", dataset.samples));
    facts.add("refused", format!("{} draws", measure::count(dataset.rejected)));
    facts.add("size", measure::size(dataset.bytes));
    facts.add_time("created", Some(&dataset.created_at));
    facts.add_time("complete", dataset.completed_at.as_deref());
    facts.add("digest", dataset.digest);
    let files = dataset.files.iter().map(|file| (file.name.as_str(), file.size, &file.sha256));
    facts.render() + &file_table(files)
}
