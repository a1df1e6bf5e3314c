//! Collects a study's results from the server.

use std::collections::BTreeMap;

use anyhow::{Context, ensure};
use reports::study::{Evaluation, File, JobRecord, Plan, Study, Training};
use spec::{StudyEvaluation, StudyTraining};
use wire::{Job, JobState, Member};

use crate::client::Client;

/// Collects the results of `plan`'s pipeline, which is the job `job`.
///
/// # Errors
/// When the server cannot be reached, or the pipeline has not succeeded.
pub async fn gather(client: &Client, plan: &Plan, job: &Job) -> anyhow::Result<Study> {
    ensure!(job.state == JobState::Succeeded, "job {} is {}", job.id, job.state);
    let members = Members {
        client,
        by_name: job.members.iter().map(|member| (member.name.as_str(), member)).collect(),
    };
    let mut trainings = Vec::new();
    for training in &plan.parts.trainings {
        trainings.push(members.training(training).await?);
    }
    let mut evaluations = Vec::new();
    for evaluation in &plan.parts.evaluations {
        evaluations.push(members.evaluation(evaluation).await?);
    }
    Ok(Study {
        edition: plan.edition,
        scale: plan.scale,
        spec: plan.pipeline.clone(),
        pipeline: JobRecord {
            name: job.name.clone(),
            job: job.id,
            digest: job.digest,
            seconds: job.duration_seconds,
            reused: false,
        },
        trainings,
        evaluations,
    })
}

struct Members<'a> {
    client: &'a Client,
    by_name: BTreeMap<&'a str, &'a Member>,
}

impl Members<'_> {
    async fn training(&self, plan: &StudyTraining) -> anyhow::Result<Training> {
        let (record, job) = self.record(&plan.job).await?;
        let last = job.checkpoints.iter().max();
        let last = *last.with_context(|| format!("{} left no checkpoint", record.name))?;
        let checkpoint = self.client.checkpoint(last).await?;
        let weights = checkpoint.files.iter().find(|file| file.name == "model.safetensors");
        Ok(Training {
            plan: plan.clone(),
            checkpoint: last,
            sha256: weights.map(|file| file.sha256.to_string()).unwrap_or_default(),
            steps: checkpoint.step,
            validation_rmse_deg: checkpoint.metrics.get("validation/rmse_deg").copied(),
            record,
        })
    }

    async fn evaluation(&self, plan: &StudyEvaluation) -> anyhow::Result<Evaluation> {
        let (record, _) = self.record(&plan.job).await?;
        let evaluation = self.client.evaluation(record.job).await?;
        let mut files = Vec::new();
        for artifact in evaluation.artifacts {
            // Tables shorten the names of evaluations that belong to a series.
            if plan.question.is_drawn() || artifact.name == "report.json" {
                let bytes = self.client.download(&artifact.url).await?;
                files.push(File { name: artifact.name, bytes });
            }
        }
        let report = evaluation.report.with_context(|| format!("{} has no report", plan.job))?;
        Ok(Evaluation { plan: plan.clone(), record, report, files })
    }

    async fn record(&self, name: &str) -> anyhow::Result<(JobRecord, Job)> {
        let member = self.by_name.get(name).with_context(|| format!("no member {name:?}"))?;
        let job = self.client.job(member.job).await?;
        let record = JobRecord {
            name: name.to_owned(),
            job: job.id,
            digest: job.digest,
            seconds: job.duration_seconds,
            reused: member.reused,
        };
        Ok((record, job))
    }
}
