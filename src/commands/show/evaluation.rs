use wire::{Evaluation, TaskState};

use super::{Facts, file_table};

pub fn text(evaluation: Evaluation) -> String {
    let mut facts = Facts::new();
    facts.add("evaluation", evaluation.id);
    facts.add("name", &evaluation.name);
    facts.add_labels(&evaluation.tags, &[], evaluation.note.as_deref());
    facts.add("state", evaluation.state);
    facts.add_some("error", evaluation.error.as_ref());
    facts.add("run", evaluation.run);
    let done = evaluation.cells.iter().filter(|cell| cell.state == TaskState::Succeeded).count();
    facts.add("cells", format!("{done} of {}", evaluation.cells.len()));
    facts.add_time("created", Some(&evaluation.created_at));
    facts.add("digest", evaluation.digest);
    let report = evaluation.report.map(|report| format!("\n{}", reports::text(&report)));
    let files =
        evaluation.artifacts.iter().map(|file| (file.name.as_str(), file.size, &file.sha256));
    let files = if evaluation.artifacts.is_empty() { String::new() } else { file_table(files) };
    facts.render() + &report.unwrap_or_default() + &files
}
