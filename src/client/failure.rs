use wire::{Job, JobState};

/// Why a job did not succeed: the reasons of its members, else its own.
pub fn failure(job: &Job) -> String {
    let failed = job.members.iter().filter(|member| member.state == JobState::Failed);
    let reasons: Vec<String> = failed
        .filter_map(|member| Some(format!("{}: {}", member.name, member.error.as_ref()?)))
        .collect();
    match (reasons.is_empty(), &job.error) {
        (true, Some(error)) => error.clone(),
        (true, None) => "no reason given".to_owned(),
        (false, _) => reasons.join("; "),
    }
}
