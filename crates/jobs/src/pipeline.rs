//! Pipelines: jobs that are resolved one after the other. Each may refer to those before it.

use spec::{Execution, JobSpec, PipelineMember, PipelineSpec, SpecError};
use store::{Need, NewJob, NewMember, NewPipeline};

use crate::SubmissionError;
use crate::kind::{Limits, TASKS_PER_SUBMISSION};
use crate::plan::plan;
use crate::references::{References, Resolved};

pub(crate) async fn plan_pipeline(
    mut references: References<'_>,
    pipeline: &PipelineSpec,
    limits: &Limits,
) -> Result<(Vec<NewJob>, NewPipeline), SubmissionError> {
    let order = pipeline.order().ok_or_else(|| {
        SpecError::one("jobs", "circular", "jobs that do not need each other in a circle")
    })?;
    let mut resolved_pipeline = pipeline.clone();
    let mut jobs: Vec<NewJob> = Vec::with_capacity(order.len());
    let mut members = Vec::with_capacity(order.len());
    let mut tasks = 0;
    for name in order {
        let member = &pipeline.jobs[name];
        let (spec, job) = plan_member(&references, name, member, limits)
            .await
            .map_err(|error| error.within(&format!("jobs.{name}")))?;
        tasks += job.tasks.len();
        if tasks > TASKS_PER_SUBMISSION {
            return Err(too_many_tasks(name, tasks).into());
        }
        references.add_sibling(name, jobs.len(), &spec);
        let resolved_member = PipelineMember { needs: member.needs.clone(), spec };
        resolved_pipeline.jobs.insert(name.to_owned(), resolved_member);
        members.push(NewMember { name: name.to_owned(), job: jobs.len() });
        jobs.push(job);
    }
    let spec = JobSpec::Pipeline(resolved_pipeline);
    // The rest of its execution is that of its members.
    let Execution { priority, max_attempts, .. } = spec.execution();
    let job = NewJob {
        name: pipeline.name.clone(),
        digest: spec.digest(),
        unit: "jobs".to_owned(),
        execution: Execution { priority, max_attempts, ..Execution::default() },
        ..NewJob::new(spec.kind().as_str(), spec.to_json())
    };
    Ok((jobs, NewPipeline { job, members }))
}

fn too_many_tasks(name: &str, tasks: usize) -> SpecError {
    let allowed = format!(
        "jobs with {TASKS_PER_SUBMISSION} tasks in all (a shard, a cell or a training is one); larger shards, or \
         several pipelines"
    );
    SpecError::one("jobs", format!("{tasks} tasks up to jobs.{name}"), allowed)
}

async fn plan_member(
    references: &References<'_>,
    name: &str,
    member: &PipelineMember,
    limits: &Limits,
) -> Result<(JobSpec, NewJob), SubmissionError> {
    let Resolved { spec, mut inputs } = references.resolve(&member.spec).await?;
    let explicit = member.needs.iter().filter_map(|need| references.sibling(need)).map(Need::New);
    inputs.needs.extend(explicit);
    let resolved = Resolved { spec, inputs };
    let job = plan(Some(name), &resolved, limits)?;
    Ok((resolved.spec, job))
}
