//! The laws of the store, as functions that every database it supports must pass.

pub mod artifacts;
pub mod cancellation;
pub mod checkpoints;
pub mod datasets;
pub mod leases;
pub mod metrics;
pub mod objects;
pub mod propagation;
pub mod submission;
pub mod uploads;

use std::time::Duration;

use bytes::Bytes;
use serde_json::{Value, json};
use spec::{Digest, JobSpec, PipelineMember, PipelineSpec};
use store::{
    ClaimedTask, Fence, FileContent, JobId, JobState, Need, NewJob, NewMember, NewPipeline,
    NewShard, NewTask, Reuse, Store, StoreError, Submission, Submitted, object_path,
};
use tempfile::TempDir;

/// Longer than any test.
pub const LONG: Duration = Duration::from_secs(600);

/// An empty store that is deleted with its folder.
pub struct Fixture {
    pub store: Store,
    pub _dir: TempDir,
}

/// A simulation of 6 trajectories of 4 samples in 3 shards.
pub fn simulate(seed: u64) -> NewJob {
    let spec = parse(&json!({
        "preset": "D1-multisine", "seed": seed, "trajectories": 6, "samples": 4,
        "shard_trajectories": 2,
    }));
    let tasks = (0..3).map(|shard| task(0, shard, 2)).collect();
    NewJob { name: "train-set".into(), spec, unit: "trajectories".into(), tasks, needs: vec![] }
}

pub fn train(data: &NewJob, needs: Vec<Need>) -> NewJob {
    let spec = parse(&json!({
        "kind": "train", "data": {"digest": data.spec.digest()}, "steps": 10,
        "model": {"preset": "robomorph-tiny"},
    }));
    NewJob { name: "train".into(), spec, unit: "steps".into(), tasks: vec![task(0, 0, 10)], needs }
}

/// Two cells and a report.
pub fn evaluate(data: &NewJob, trained: &NewJob, needs: Vec<Need>) -> NewJob {
    let spec = parse(&json!({
        "kind": "evaluate", "data": {"digest": data.spec.digest()},
        "checkpoints": [{"digest": trained.spec.digest()}],
    }));
    let tasks = vec![task(0, 0, 1), task(0, 1, 1), task(1, 0, 1)];
    NewJob { name: "evaluate".into(), spec, unit: "cells".into(), tasks, needs }
}

pub fn task(stage: u32, ordinal: u32, total: u64) -> NewTask {
    let label = format!("piece {stage}.{ordinal}");
    NewTask { stage, ordinal, label, payload: json!({"piece": ordinal}), total }
}

fn parse(json: &Value) -> JobSpec {
    spec::parse(json.to_string().as_bytes()).unwrap()
}

pub fn with_execution(mut job: NewJob, priority: i32, max_attempts: u32) -> NewJob {
    let mut json = job.spec.to_json();
    json["execution"] = json!({"priority": priority, "max_attempts": max_attempts});
    job.spec = parse(&json);
    job
}

/// A simulation, a training on it, and an evaluation of that.
pub fn pipeline(seed: u64) -> Submission {
    let simulation = simulate(seed);
    let training = train(&simulation, vec![Need::New(0)]);
    let evaluation = evaluate(&simulation, &training, vec![Need::New(0), Need::New(1)]);
    pipeline_of(vec![simulation, training, evaluation])
}

pub fn pipeline_of(jobs: Vec<NewJob>) -> Submission {
    let member = |job: &NewJob| PipelineMember { needs: vec![], spec: job.spec.clone() };
    let spec = PipelineSpec {
        name: "pipeline".into(),
        jobs: jobs.iter().map(|job| (job.name.clone(), member(job))).collect(),
    };
    let members =
        jobs.iter().enumerate().map(|(i, job)| NewMember { name: job.name.clone(), job: i });
    let pipeline = Some(NewPipeline { spec, members: members.collect() });
    Submission { pipeline, jobs, reuse: Reuse::SameDigest, idempotency: None }
}

pub fn alone(job: NewJob) -> Submission {
    Submission { jobs: vec![job], pipeline: None, reuse: Reuse::SameDigest, idempotency: None }
}

impl Fixture {
    pub async fn submit(&self, submission: Submission) -> Submitted {
        self.store.submit(submission).await.unwrap()
    }

    pub async fn submit_one(&self, job: NewJob) -> JobId {
        self.submit(alone(job)).await.job
    }

    /// The jobs of a pipeline, in order.
    pub async fn members(&self, pipeline: JobId) -> Vec<JobId> {
        self.store.members(pipeline).await.unwrap().iter().map(|member| member.job).collect()
    }

    pub async fn claim(&self) -> Option<ClaimedTask> {
        self.store.claim("w1", LONG).await.unwrap()
    }

    pub async fn must_claim(&self) -> ClaimedTask {
        self.claim().await.expect("a task to claim")
    }

    /// Claims a task, and lets its lease run out as if the worker were killed.
    pub async fn claim_and_die(&self) -> ClaimedTask {
        let task = self.store.claim("w0", Duration::ZERO).await.unwrap().expect("a task to claim");
        tokio::time::sleep(Duration::from_millis(3)).await;
        task
    }

    /// Claims and completes tasks until there are none.
    pub async fn work_off(&self) -> Vec<ClaimedTask> {
        let mut done = Vec::new();
        while let Some(task) = self.claim().await {
            self.store.complete(task.fence, None).await.unwrap();
            done.push(task);
        }
        done
    }

    pub async fn state(&self, job: JobId) -> JobState {
        self.store.job(job).await.unwrap().state
    }

    pub async fn states(&self, jobs: &[JobId]) -> Vec<JobState> {
        let mut states = Vec::new();
        for job in jobs {
            states.push(self.state(*job).await);
        }
        states
    }

    pub async fn error(&self, job: JobId) -> String {
        self.store.job(job).await.unwrap().error.unwrap_or_default()
    }

    /// Publishes both files of the shard of a claimed task.
    pub async fn publish_shard(&self, task: &ClaimedTask) -> NewShard {
        let mut files = Vec::new();
        for content in FileContent::ALL {
            let path = object_path::shard(task.job, task.ordinal, task.fence.epoch, content);
            let bytes = Bytes::from(format!("{content} {}", task.ordinal));
            files.push(self.store.put_object(&path, bytes).await.unwrap());
        }
        let robots = files.pop().unwrap();
        let trajectories = files.pop().unwrap();
        NewShard { first: u64::from(task.ordinal) * 2, count: 2, rejected: 1, trajectories, robots }
    }
}

pub fn assert_lost<T>(result: Result<T, StoreError>, fence: Fence) {
    match result {
        Err(StoreError::LeaseLost { task, epoch }) => {
            assert_eq!((task, epoch), (fence.task, fence.epoch));
        }
        Err(error) => panic!("not a lost lease: {error}"),
        Ok(_) => panic!("a lost lease wrote"),
    }
}

pub fn digest_of(job: &NewJob) -> Digest {
    job.spec.digest()
}
