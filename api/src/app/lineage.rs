//! The jobs from which results come, and the jobs that use them.

use std::collections::{BTreeMap, BTreeSet};

use store::JobId;
use wire::Job;

use crate::app::App;
use crate::error::ApiError;

/// Jobs of a lineage. One that begins with more has no others.
const MOST: usize = 40;

/// Some jobs, the jobs whose results they use, and the jobs that use theirs, whatever the distance.
pub(crate) struct Lineage {
    pub jobs: BTreeMap<i64, Job>,
    /// Pairs of a job and a job whose results it uses, both among `jobs`.
    pub uses: Vec<(i64, i64)>,
    /// Whether there are more jobs than a lineage may have. Those furthest away are left out, and
    /// of several users the oldest.
    pub is_cut: bool,
}

/// Which way to go from a job.
#[derive(Clone, Copy)]
enum Towards {
    Sources,
    Users,
}

impl App {
    /// The lineage of `roots`.
    pub(crate) async fn lineage(&self, roots: &[i64]) -> Result<Lineage, ApiError> {
        let mut known: BTreeSet<JobId> = roots.iter().copied().map(JobId).collect();
        let mut is_cut = false;
        for towards in [Towards::Sources, Towards::Users] {
            let mut frontier: Vec<JobId> = roots.iter().copied().map(JobId).collect();
            while !frontier.is_empty() {
                let pairs = match towards {
                    Towards::Sources => self.store.sources(&frontier).await?,
                    Towards::Users => self.store.users(&frontier).await?,
                };
                let mut next = Vec::new();
                for (user, source) in pairs {
                    let found = match towards {
                        Towards::Sources => source,
                        Towards::Users => user,
                    };
                    if known.contains(&found) {
                        continue;
                    }
                    if known.len() >= MOST {
                        is_cut = true;
                        continue;
                    }
                    known.insert(found);
                    next.push(found);
                }
                frontier = next;
            }
        }
        let known: Vec<JobId> = known.into_iter().collect();
        // A job in the trash is not among them.
        let jobs = self.jobs_by_id(&known.iter().map(|job| job.0).collect::<Vec<_>>()).await?;
        let among = |(user, source): (JobId, JobId)| {
            (jobs.contains_key(&user.0) && jobs.contains_key(&source.0))
                .then_some((user.0, source.0))
        };
        let uses = self.store.sources(&known).await?.into_iter().filter_map(among).collect();
        Ok(Lineage { uses, jobs, is_cut })
    }
}
