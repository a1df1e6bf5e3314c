//! Pipelines: jobs whose members are jobs. A pipeline's state follows from its members' states.

use wire::JobState;

use crate::boxed;
use crate::database::{Transaction, sql};
use crate::queue::rules::job::is_unsuccessful;
use crate::queue::rules::pipeline::{MemberStanding, culprit, settled};
use crate::{JobId, JobProgress, Store, StoreError};

/// A member of a pipeline.
#[derive(Clone, Debug)]
pub struct Member {
    pub pipeline: JobId,
    pub name: String,
    pub job: JobId,
    /// The store does not interpret it.
    pub kind: String,
    pub state: JobState,
    /// Why it failed or was cancelled.
    pub error: Option<String>,
    pub progress: JobProgress,
    /// Whether the job existed before the pipeline was submitted.
    pub reused: bool,
}

/// A member, with what its pipeline needs to know.
#[derive(Clone, Debug)]
pub(crate) struct MemberRow {
    pub name: String,
    pub job: JobId,
    pub state: JobState,
    pub cancel_requested: bool,
    pub error: Option<String>,
}

impl Store {
    /// Members grouped by pipeline, in the order of submission. Each comes after the members that
    /// it needs. A job that is not a pipeline has none.
    ///
    /// # Errors
    /// When the database fails.
    #[boxed]
    pub async fn members(&self, pipelines: &[JobId]) -> Result<Vec<Member>, StoreError> {
        sql!(self.database(), "reading the members of pipelines", members(pipelines))
    }
}

/// Updates all pipelines that `job` belongs to.
pub(crate) async fn settle_pipelines_of(
    tx: &mut Transaction,
    job: JobId,
) -> Result<(), StoreError> {
    for pipeline in sql!(tx, pipelines_of(job))? {
        settle(tx, pipeline).await?;
    }
    Ok(())
}

/// Derives a pipeline's state from the states of its members.
pub(crate) async fn settle(tx: &mut Transaction, pipeline: JobId) -> Result<(), StoreError> {
    let (state, cancel_requested) = sql!(tx, pipeline(pipeline))?;
    let members = sql!(tx, member_rows(pipeline))?;
    let standings: Vec<MemberStanding> = members.iter().map(MemberRow::standing).collect();
    let next = settled(state, cancel_requested, &standings);
    if next == state {
        return Ok(());
    }
    let blames_member = is_unsuccessful(next) && !cancel_requested;
    let error = culprit(&standings).filter(|_| blames_member).map(|i| members[i].reason());
    sql!(tx, set_pipeline(pipeline, next, error.as_deref()))
}

impl MemberRow {
    fn standing(&self) -> MemberStanding {
        MemberStanding { state: self.state, cancel_requested: self.cancel_requested }
    }

    /// Why its pipeline did not succeed.
    fn reason(&self) -> String {
        let end = if self.state == JobState::Failed { "failed" } else { "was cancelled" };
        let error = self.error.as_ref().map(|error| format!(": {error}")).unwrap_or_default();
        format!("{} (job {}) {end}{error}", self.name, self.job)
    }
}
