use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Report};
use crate::{CheckpointRef, DataSource, Digest, JobKind, JobSpec, TrainingRef};

/// The most jobs one pipeline may have.
pub const MAX_MEMBERS: usize = 200;

/// Named jobs, some of which need others. Order follows from references and `needs`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PipelineSpec {
    pub name: String,
    /// 1 to 200 jobs; names are lower-case letters, digits and dashes.
    #[schema(no_recursion)]
    pub jobs: BTreeMap<String, PipelineMember>,
}

/// A job of a pipeline: any job spec but a pipeline, with `needs` beside its fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PipelineMember {
    /// Jobs that must succeed first, besides those this one refers to.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub needs: Vec<String>,
    #[serde(flatten)]
    #[schema(no_recursion)]
    pub spec: JobSpec,
}

impl PipelineMember {
    /// Every job of the pipeline that must succeed before this one.
    pub fn all_needs(&self) -> BTreeSet<String> {
        let mut needs: BTreeSet<String> = self.needs.iter().cloned().collect();
        match &self.spec {
            JobSpec::Train(spec) => needs.extend(dataset_job(&spec.data)),
            JobSpec::Evaluate(spec) => {
                needs.extend(dataset_job(&spec.data));
                needs.extend(trainings(&spec.checkpoints));
            }
            JobSpec::Control(spec) => {
                needs.extend(dataset_job(&spec.data));
                needs.extend(trainings(&spec.checkpoints));
            }
            JobSpec::Verify(spec) => needs.extend(dataset_job(&spec.data)),
            JobSpec::Simulate(_) | JobSpec::Import(_) | JobSpec::Pipeline(_) => {}
        }
        needs
    }
}

fn trainings(checkpoints: &[CheckpointRef]) -> impl Iterator<Item = String> {
    checkpoints.iter().filter_map(CheckpointRef::job).map(str::to_owned)
}

fn dataset_job(reference: &DataSource) -> Option<String> {
    match reference {
        DataSource::Job(name) => Some(name.clone()),
        DataSource::Dataset(_) | DataSource::Digest(_) | DataSource::Stream(_) => None,
    }
}

impl PipelineSpec {
    /// Names of the jobs, each after all it needs; `None` when they need each other in a circle.
    pub fn order(&self) -> Option<Vec<&str>> {
        let mut done: BTreeSet<&str> = BTreeSet::new();
        let mut order = Vec::with_capacity(self.jobs.len());
        while order.len() < self.jobs.len() {
            let ready: Vec<&str> = self
                .jobs
                .iter()
                .filter(|(name, _)| !done.contains(name.as_str()))
                .filter(|(_, job)| job.all_needs().iter().all(|need| done.contains(need.as_str())))
                .map(|(name, _)| name.as_str())
                .collect();
            if ready.is_empty() {
                return None;
            }
            done.extend(&ready);
            order.extend(ready);
        }
        Some(order)
    }
}

impl PipelineSpec {
    /// Turns digests of the pipeline's own jobs back into their names, from which their order follows:
    /// what resolving them did, undone.
    pub fn name_siblings(&mut self) {
        let names: BTreeMap<Digest, String> =
            self.jobs.iter().map(|(name, job)| (job.spec.digest(), name.clone())).collect();
        for member in self.jobs.values_mut() {
            if let Some(data) = member.spec.dataset_ref()
                && let DataSource::Digest(digest) = data
                && let Some(name) = names.get(digest)
            {
                *data = DataSource::Job(name.clone());
            }
            for checkpoint in member.spec.checkpoint_refs() {
                match checkpoint {
                    CheckpointRef::Digest(digest) => {
                        if let Some(name) = names.get(digest) {
                            *checkpoint = CheckpointRef::Job(name.clone());
                        }
                    }
                    CheckpointRef::Best(of) => {
                        if let TrainingRef::Digest(digest) = of
                            && let Some(name) = names.get(digest)
                        {
                            *of = TrainingRef::Job(name.clone());
                        }
                    }
                    CheckpointRef::Job(_)
                    | CheckpointRef::Checkpoint(_)
                    | CheckpointRef::Step(_) => {}
                }
            }
        }
    }
}

impl Check for PipelineSpec {
    fn check(&self, report: &mut Report) {
        report.within("name", self.name.len(), 1..=100);
        if self.jobs.is_empty() || self.jobs.len() > MAX_MEMBERS {
            report.violation("jobs", format!("{} jobs", self.jobs.len()), "1 to 200 jobs");
        }
        let known_violations = report.count();
        for (name, member) in &self.jobs {
            let path = format!("jobs.{name}");
            if !is_job_name(name) {
                report.violation(
                    &path,
                    format!("{name:?}"),
                    "a name of 1 to 60 lower-case letters, digits and dashes",
                );
            }
            if member.spec.kind() == JobKind::Pipeline {
                report.violation(&format!("{path}.kind"), "pipeline", "any other kind of job");
                continue;
            }
            report.part(&path, &member.spec);
            self.check_references(&path, member, report);
        }
        if report.count() == known_violations && self.order().is_none() {
            report.violation("jobs", "circular", "jobs that do not need each other in a circle");
        }
    }
}

impl PipelineSpec {
    fn check_references(&self, path: &str, member: &PipelineMember, report: &mut Report) {
        let mut check = |field: &str, name: &str, kind: Option<JobKind>| {
            let found = self.jobs.get(name).map(|job| job.spec.kind());
            let fits = found.is_some() && (kind.is_none() || found == kind);
            if !fits {
                let kind = kind.map_or(String::new(), |kind| format!("{kind} "));
                let names: Vec<&str> = self
                    .jobs
                    .iter()
                    .filter(|(_, job)| {
                        kind.is_empty() || kind.trim_end() == job.spec.kind().as_str()
                    })
                    .map(|(name, _)| name.as_str())
                    .collect();
                let allowed = format!("a {kind}job of this pipeline: {}", names.join(", "));
                report.violation(&format!("{path}.{field}"), format!("{name:?}"), allowed);
            }
        };
        for need in &member.needs {
            check("needs", need, None);
        }
        let (data, checkpoints) = match &member.spec {
            JobSpec::Train(spec) => (Some(&spec.data), &[][..]),
            JobSpec::Evaluate(spec) => (Some(&spec.data), &spec.checkpoints[..]),
            JobSpec::Control(spec) => (Some(&spec.data), &spec.checkpoints[..]),
            JobSpec::Verify(spec) => (Some(&spec.data), &[][..]),
            JobSpec::Simulate(_) | JobSpec::Import(_) | JobSpec::Pipeline(_) => (None, &[][..]),
        };
        if let Some(name) = data.and_then(dataset_job) {
            check("data.job", &name, Some(JobKind::Simulate));
        }
        for name in checkpoints.iter().filter_map(CheckpointRef::job) {
            check("checkpoints.job", name, Some(JobKind::Train));
        }
    }
}

fn is_job_name(name: &str) -> bool {
    (1..=60).contains(&name.len())
        && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-')
}
