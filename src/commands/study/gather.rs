//! A study's results, asked of the server.

use std::collections::BTreeMap;

use anyhow::{Context, ensure};
use reports::study::{Evaluation, File, JobRecord, MODELS, Plan, Set, Study, Training};
use wire::{Job, JobState, Member};

use crate::client::Client;

/// Collects what the pipeline `job` of `plan` computed.
///
/// # Errors
/// An unreachable server, and a pipeline that has not succeeded.
pub async fn gather(client: &Client, plan: &Plan, job: &Job) -> anyhow::Result<Study> {
    ensure!(job.state == JobState::Succeeded, "job {} is {}", job.id, job.state);
    let members = Members {
        client,
        by_name: job.members.iter().map(|member| (member.name.as_str(), member)).collect(),
    };
    let mut sets = Vec::new();
    for number in 1.. {
        let prefix = format!("d{number}");
        if !plan.pipeline.jobs.contains_key(&format!("{prefix}-data")) {
            break;
        }
        sets.push(members.set(&prefix).await?);
    }
    Ok(Study {
        scale: plan.scale,
        spec: plan.pipeline.clone(),
        pipeline: JobRecord {
            name: job.name.clone(),
            job: job.id,
            digest: job.digest,
            seconds: job.duration_seconds,
            reused: false,
        },
        sets,
        warm_start: members.evaluation("warm-start").await?,
    })
}

struct Members<'a> {
    client: &'a Client,
    by_name: BTreeMap<&'a str, &'a Member>,
}

impl Members<'_> {
    async fn set(&self, prefix: &str) -> anyhow::Result<Set> {
        let (data, job) = self.record(&format!("{prefix}-data")).await?;
        let dataset = job.dataset.with_context(|| format!("{} has no dataset", data.name))?;
        let mut trainings = Vec::new();
        for model in MODELS {
            trainings.push(self.training(prefix, model).await?);
        }
        Ok(Set {
            name: prefix.to_uppercase(),
            data,
            trajectories: self.client.dataset(dataset).await?.trajectories,
            trainings,
            sweep: self.evaluation(&format!("{prefix}-sweep")).await?,
            samples: self.evaluation(&format!("{prefix}-samples")).await?,
        })
    }

    async fn training(&self, prefix: &str, model: &str) -> anyhow::Result<Training> {
        let (record, job) = self.record(&format!("{prefix}-{model}")).await?;
        let last = job.checkpoints.iter().max();
        let last = *last.with_context(|| format!("{} left no checkpoint", record.name))?;
        let checkpoint = self.client.checkpoint(last).await?;
        let weights = checkpoint.files.iter().find(|file| file.name == "model.safetensors");
        Ok(Training {
            model: model.to_owned(),
            checkpoint: last,
            sha256: weights.map(|file| file.sha256.to_string()).unwrap_or_default(),
            steps: checkpoint.step,
            validation_rmse_deg: checkpoint.metrics.get("validation/rmse_deg").copied(),
            record,
        })
    }

    async fn evaluation(&self, name: &str) -> anyhow::Result<Evaluation> {
        let (record, _) = self.record(name).await?;
        let evaluation = self.client.evaluation(record.job).await?;
        let mut files = Vec::new();
        for artifact in evaluation.artifacts {
            let bytes = self.client.download(&artifact.url).await?;
            files.push(File { name: artifact.name, bytes });
        }
        let report = evaluation.report.with_context(|| format!("{name} has no report"))?;
        Ok(Evaluation { record, report, files })
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
