use reports::{Align, Table};
use wire::{Job, Member};

use super::Facts;
use crate::progress::measure;

pub fn text(job: Job) -> String {
    let mut facts = Facts::new();
    facts.add("job", job.id);
    facts.add("kind", job.kind);
    facts.add("name", &job.name);
    facts.add_labels(&job.tags, &[], job.note.as_deref());
    facts.add("state", job.state);
    facts.add_some("error", job.error.as_ref());
    facts.add_some("waits", job.waits_for.as_ref());
    if job.progress.total > 0 {
        let [done, total] = [job.progress.done, job.progress.total].map(measure::count);
        facts.add("done", format!("{done} of {total} {}", job.progress.unit));
    }
    facts.add_some("now", job.progress.message.as_ref());
    facts.add_some("needs", list(&job.needs));
    facts.add_some("dataset", job.dataset);
    facts.add_some("verifies", job.verifies.map(|id| format!("dataset {id}")));
    facts.add_some("run", job.run);
    facts.add_some("checkpoints", list(&job.checkpoints));
    facts.add("priority", job.priority);
    facts.add("attempts", format!("{} at most", job.max_attempts));
    facts.add_some("time limit", job.time_limit_s.map(|seconds| format!("{seconds} s")));
    facts.add_time("not before", job.not_before.as_deref());
    facts.add_time("submitted", Some(&job.created_at));
    facts.add_time("started", job.started_at.as_deref());
    facts.add_time("ended", job.finished_at.as_deref());
    facts.add("digest", job.digest);
    for warning in &job.warnings {
        facts.add("warning", warning);
    }
    let members = if job.members.is_empty() { String::new() } else { members(job.members) };
    facts.render() + &members
}

fn members(members: Vec<Member>) -> String {
    let mut table = Table::new([
        ("job", Align::Right),
        ("kind", Align::Left),
        ("name", Align::Left),
        ("state", Align::Left),
        ("error", Align::Left),
    ]);
    for member in members {
        let state = if member.reused { ", done before" } else { "" };
        table.push(vec![
            member.job.to_string(),
            member.kind.to_string(),
            member.name,
            format!("{}{state}", member.state),
            member.error.unwrap_or_default(),
        ]);
    }
    format!("\n{}", table.render())
}

fn list(ids: &[i64]) -> Option<String> {
    let ids: Vec<String> = ids.iter().map(ToString::to_string).collect();
    (!ids.is_empty()).then(|| ids.join(", "))
}
