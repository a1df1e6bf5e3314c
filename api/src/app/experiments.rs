//! What the front page lists: the jobs that somebody asked for, without those that a pipeline
//! made for itself.

use std::collections::BTreeSet;

use spec::JobKind;
use store::{JobFilter, Page};
use wire::{Job, JobState, Jobs};

use crate::app::App;
use crate::error::ApiError;

impl App {
    /// Pipelines, and jobs that no pipeline made, newest first.
    ///
    /// A pipeline is stored right after the jobs it makes, so walking from new to old meets it
    /// before them.
    pub async fn experiments(
        &self,
        state: Option<JobState>,
        before: Option<i64>,
        limit: usize,
    ) -> Result<Jobs, ApiError> {
        let mut made_by_pipelines = BTreeSet::new();
        let mut jobs: Vec<Job> = Vec::with_capacity(limit);
        let mut page = Page { before: None, limit: Page::MAX_LIMIT };
        loop {
            let rows = self.store.jobs(JobFilter::default(), page).await?;
            let Some(last) = rows.last() else { return Ok(Jobs { jobs, next: None }) };
            page.before = Some(last.id.0);
            for row in rows {
                if row.kind == JobKind::Pipeline.as_str() {
                    let members = self.store.members(row.id).await?;
                    let made = members.iter().filter(|member| !member.reused);
                    made_by_pipelines.extend(made.map(|member| member.job));
                } else if made_by_pipelines.remove(&row.id) {
                    continue;
                }
                let is_older = before.is_none_or(|before| row.id.0 < before);
                if !is_older || state.is_some_and(|state| row.state != state) {
                    continue;
                }
                if jobs.len() == limit {
                    let next = jobs.last().map(|job| job.id);
                    return Ok(Jobs { jobs, next });
                }
                jobs.push(self.complete(row).await?);
            }
        }
    }
}
