//! From a spec as it is sent to jobs in the store.

use serde::de::IgnoredAny;
use serde_json::json;
use spec::{DataSpec, Digest, JobSpec, PipelineMember, PipelineSpec, SpecError};
use store::{
    Idempotency, JobId, JobReuse, JobState, Need, NewJob, NewMember, NewPipeline, Output,
    Submission,
};

use crate::app::references::{References, Resolved};
use crate::app::tasks::Plan;
use crate::app::{App, Job};
use crate::error::ApiError;

pub use store::Reuse;

/// What became of a submission.
#[derive(Clone, Debug)]
pub struct Submitted {
    pub job: Job,
    /// Whether it is new.
    pub created: bool,
}

impl App {
    /// Submits the spec in `text`: a job, or a pipeline with all its jobs, in one transaction.
    ///
    /// # Errors
    /// [`ApiError::Json`] or [`ApiError::Spec`] when it cannot be accepted; nothing is queued then.
    pub async fn submit(
        &self,
        text: &[u8],
        reuse: Reuse,
        idempotency_key: Option<String>,
    ) -> Result<Submitted, ApiError> {
        serde_json::from_slice::<IgnoredAny>(text).map_err(ApiError::Json)?;
        let spec = spec::parse(text)?;
        let idempotency = idempotency_key.map(|key| Idempotency {
            key,
            request: Digest::of_json(&json!([Digest::of(text), reuse == Reuse::Never])),
        });
        self.submit_spec(&spec, reuse, idempotency).await
    }

    /// Submits the spec of a job that failed or was cancelled again. What succeeded is not done again:
    /// the jobs of a pipeline, and the cells of an evaluation.
    ///
    /// # Errors
    /// [`ApiError::NotFailed`] for any other job; [`ApiError::Spec`] when what it refers to is gone.
    pub async fn retry(&self, id: i64) -> Result<Submitted, ApiError> {
        let job = self.store.job(JobId(id)).await?;
        if !matches!(job.state, JobState::Failed | JobState::Cancelled) {
            return Err(ApiError::NotFailed { id, state: job.state });
        }
        let text = job.spec.to_string();
        let mut spec = spec::parse(text.as_bytes())?;
        if let JobSpec::Pipeline(pipeline) = &mut spec {
            pipeline.name_siblings();
        }
        self.submit_spec(&spec, Reuse::SameDigest, None).await
    }

    pub(super) async fn submit_spec(
        &self,
        spec: &JobSpec,
        reuse: Reuse,
        idempotency: Option<Idempotency>,
    ) -> Result<Submitted, ApiError> {
        self.check_size(spec)?;
        let references = References::new(&self.store);
        let (jobs, pipeline) = match spec {
            JobSpec::Pipeline(pipeline) => {
                let (jobs, pipeline) = plan_pipeline(references, pipeline).await?;
                (jobs, Some(pipeline))
            }
            single => {
                let resolved = references.resolve(single).await?;
                (vec![plan_job(name(&resolved), &resolved)?], None)
            }
        };
        let submission = Submission { jobs, pipeline, reuse, idempotency };
        let submitted = self.store.submit(submission).await?;
        Ok(Submitted { job: self.job(submitted.job.0).await?, created: !submitted.reused })
    }

    /// Refuses simulations that are larger than this server takes. A stream is not stored and may
    /// have any size.
    fn check_size(&self, spec: &JobSpec) -> Result<(), SpecError> {
        match spec {
            JobSpec::Simulate(spec) if spec.trajectories > self.max_trajectories => {
                let allowed = format!(
                    "at most {}, the limit that this server was started with (--max-trajectories)",
                    self.max_trajectories
                );
                Err(SpecError::one("trajectories", spec.trajectories.to_string(), allowed))
            }
            JobSpec::Pipeline(pipeline) => {
                let mut violations = Vec::new();
                for (name, member) in &pipeline.jobs {
                    if let Err(error) = self.check_size(&member.spec) {
                        violations.extend(error.within(&format!("jobs.{name}")).violations);
                    }
                }
                if violations.is_empty() { Ok(()) } else { Err(SpecError { violations }) }
            }
            _ => Ok(()),
        }
    }
}

/// What a job is called that has no name of its own.
fn name(resolved: &Resolved) -> String {
    match resolved.dataset {
        Some(dataset) => format!("{}-dataset-{dataset}", resolved.spec.kind()),
        None => format!("{}-{}", resolved.spec.kind(), resolved.spec.digest().short()),
    }
}

fn plan_job(name: String, resolved: &Resolved) -> Result<NewJob, ApiError> {
    let Resolved { spec, needs, data, dataset } = resolved;
    let Plan { unit, tasks } = Plan::new(spec, data.as_ref(), *dataset)?;
    let execution = spec.execution();
    Ok(NewJob {
        name,
        kind: spec.kind().to_string(),
        spec: spec.to_json(),
        digest: spec.digest(),
        unit: unit.to_owned(),
        priority: execution.priority,
        max_attempts: execution.max_attempts,
        output: output(spec),
        reuse: reuse(spec),
        tasks,
        needs: needs.clone(),
    })
}

fn output(spec: &JobSpec) -> Output {
    match spec {
        JobSpec::Simulate(_) | JobSpec::Import(_) => {
            DataSpec::of(spec).map_or(Output::Nothing, |data| Output::Dataset {
                // An import learns how many there are when it ends.
                trajectories: data.trajectories().unwrap_or(0),
                samples: data.samples(),
            })
        }
        JobSpec::Train(_) | JobSpec::Evaluate(_) | JobSpec::Control(_) => Output::Run,
        JobSpec::Verify(_) | JobSpec::Pipeline(_) => Output::Nothing,
    }
}

/// No job stands in for a verification, which says what was the case when it ran.
fn reuse(spec: &JobSpec) -> JobReuse {
    JobReuse {
        whole: !matches!(spec, JobSpec::Verify(_)),
        tasks: matches!(spec, JobSpec::Evaluate(_)),
    }
}

async fn plan_pipeline(
    mut references: References<'_>,
    pipeline: &PipelineSpec,
) -> Result<(Vec<NewJob>, NewPipeline), ApiError> {
    let order = pipeline.order().ok_or_else(|| {
        SpecError::one("jobs", "circular", "jobs that do not need each other in a circle")
    })?;
    let mut resolved_pipeline = pipeline.clone();
    let mut jobs: Vec<NewJob> = Vec::with_capacity(order.len());
    let mut members = Vec::with_capacity(order.len());
    for name in order {
        let member = &pipeline.jobs[name];
        let (spec, job) = plan_member(&references, name, member)
            .await
            .map_err(|error| error.within(&format!("jobs.{name}")))?;
        references.add_sibling(name, jobs.len(), &spec);
        let resolved_member = PipelineMember { needs: member.needs.clone(), spec };
        resolved_pipeline.jobs.insert(name.to_owned(), resolved_member);
        members.push(NewMember { name: name.to_owned(), job: jobs.len() });
        jobs.push(job);
    }
    let name = pipeline.name.clone();
    let spec = JobSpec::Pipeline(resolved_pipeline);
    let execution = spec.execution();
    let pipeline = NewPipeline {
        name,
        kind: spec.kind().to_string(),
        digest: spec.digest(),
        spec: spec.to_json(),
        priority: execution.priority,
        max_attempts: execution.max_attempts,
        members,
    };
    Ok((jobs, pipeline))
}

async fn plan_member(
    references: &References<'_>,
    name: &str,
    member: &PipelineMember,
) -> Result<(JobSpec, NewJob), ApiError> {
    let mut resolved = references.resolve(&member.spec).await?;
    let explicit = member.needs.iter().filter_map(|need| references.sibling(need)).map(Need::New);
    resolved.needs.extend(explicit);
    let job = plan_job(name.to_owned(), &resolved)?;
    Ok((resolved.spec, job))
}
