use wire::Checkpoint;

use super::{Facts, file_table};
use crate::commands::checkpoints::marks;
use crate::progress::measure;

pub fn text(checkpoint: &Checkpoint) -> String {
    let mut facts = Facts::new();
    facts.add("checkpoint", checkpoint.id);
    facts.add_some("name", checkpoint.name.as_ref());
    facts.add_labels(&checkpoint.tags, &checkpoint.job_tags, checkpoint.note.as_deref());
    facts.add("model", &checkpoint.architecture);
    facts.add("step", measure::count(checkpoint.step));
    facts.add_some("is", Some(marks(checkpoint)).filter(|marks| !marks.is_empty()));
    facts.add("job", checkpoint.job);
    facts.add("run", checkpoint.run);
    for (key, value) in &checkpoint.metrics {
        facts.add("metric", format!("{key} {value}"));
    }
    facts.add_time("created", Some(&checkpoint.created_at));
    facts.add("digest", checkpoint.digest);
    let files = checkpoint.files.iter().map(|file| (file.name.as_str(), file.size, &file.sha256));
    facts.render() + &file_table(files)
}
