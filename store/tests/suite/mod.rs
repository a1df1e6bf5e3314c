//! The laws of the store, as functions that every supported database must pass.

pub mod artifacts;
pub mod cancellation;
pub mod checkpoints;
pub mod concurrency;
pub mod datasets;
pub mod ends;
pub mod events;
pub mod labels;
pub mod laws;
pub mod leases;
pub mod line;
pub mod listing;
pub mod lists;
pub mod logs;
pub mod metrics;
pub mod moments;
pub mod objects;
pub mod placements;
pub mod propagation;
pub mod purge;
pub mod resources;
pub mod retention;
pub mod robots;
pub mod servers;
pub mod submission;
pub mod takeover;
pub mod texts;
pub mod tokens;
pub mod tracked_runs;
pub mod trash;
pub mod uploads;
pub mod waiting;
pub mod workers;

use std::any::Any;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use object_store::local::LocalFileSystem;
use object_store::{ObjectStore, ObjectStoreExt};
use serde_json::{Value, json};
use spec::{Digest, Execution, Moment, Resources};
use store::{
    ClaimedTask, Fence, FileContent, JobId, JobReuse, JobState, Labels, Need, NewJob, NewMember,
    NewPipeline, NewTask, Output, PartReuse, Reaped, Reaper, Reuse, ShardContents, Store,
    StoreError, Submission, Submitted, Sweeper, Timestamp, object_path,
};
use tempfile::TempDir;

/// Longer than any test.
pub const LONG: Duration = Duration::from_secs(600);

/// An empty store that is deleted with its folder.
pub struct Fixture {
    pub store: Store,
    /// Its object store, so that tests can change objects directly.
    pub objects: Arc<dyn ObjectStore>,
    /// Its data folder.
    pub dir: TempDir,
    /// Servers and databases that must live as long as the store.
    #[expect(dead_code, reason = "held to be dropped")]
    pub keep: Box<dyn Any + Send + Sync>,
}

/// The objects of a data folder.
pub fn files_of(dir: &TempDir) -> Arc<dyn ObjectStore> {
    Arc::new(LocalFileSystem::new_with_prefix(dir.path().join("objects")).unwrap())
}

fn job(kind: &str, spec: Value, output: Output, tasks: Vec<NewTask>) -> NewJob {
    NewJob { unit: "pieces".to_owned(), output, tasks, ..NewJob::new(kind, spec) }
}

/// A simulation of 6 trajectories of 4 samples in 3 shards.
pub fn simulate(seed: u64) -> NewJob {
    let output = Output::Dataset { trajectories: 6, samples: 4 };
    let tasks = (0..3).map(|shard| task(0, shard, 2)).collect();
    let job = job("simulate", json!({"kind": "simulate", "seed": seed}), output, tasks);
    let reuse = JobReuse { whole: true, parts: PartReuse::Objects };
    NewJob { name: "train-set".into(), reuse, unit: "trajectories".into(), ..job }
}

pub fn train(data: &NewJob, needs: Vec<Need>) -> NewJob {
    let spec = json!({"kind": "train", "data": data.digest});
    let reuse = JobReuse { whole: true, parts: PartReuse::Objects };
    let tasks = vec![task(0, 0, 10)];
    let reads = vec![data.digest];
    NewJob { needs, reads, reuse, unit: "steps".into(), ..job("train", spec, Output::Run, tasks) }
}

/// Two cells and a report.
pub fn evaluate(data: &NewJob, trained: &NewJob, needs: Vec<Need>) -> NewJob {
    let spec = json!({"kind": "evaluate", "data": data.digest, "checkpoint": trained.digest});
    let tasks = vec![task(0, 0, 1), task(0, 1, 1), task(1, 0, 1)];
    let reuse = JobReuse { whole: true, parts: PartReuse::Tasks };
    let reads = vec![data.digest, trained.digest];
    NewJob { needs, reads, reuse, ..job("evaluate", spec, Output::Run, tasks) }
}

/// A job whose answer depends on the time of its run.
pub fn verify(data: JobId) -> NewJob {
    let spec = json!({"kind": "verify", "data": data});
    let reuse = JobReuse { whole: false, parts: PartReuse::Nothing };
    let needs = vec![Need::Existing(data)];
    NewJob { needs, reuse, ..job("verify", spec, Output::Nothing, vec![task(0, 0, 1)]) }
}

/// An import into one shard of trajectories of 4 samples. Their number is known at its end.
pub fn import(file: Digest) -> NewJob {
    let output = Output::Dataset { trajectories: 0, samples: 4 };
    let job = job("import", json!({"kind": "import", "file": file}), output, vec![task(0, 0, 0)]);
    NewJob { files: vec![file], ..job }
}

pub fn task(stage: u32, ordinal: u32, total: u64) -> NewTask {
    let label = format!("piece {stage}.{ordinal}");
    NewTask { stage, ordinal, label, payload: json!({"piece": ordinal}), total }
}

pub fn with_execution(job: NewJob, priority: i32, max_attempts: u32) -> NewJob {
    NewJob { execution: Execution { priority, max_attempts, ..job.execution }, ..job }
}

pub fn asking(job: NewJob, resources: Resources) -> NewJob {
    NewJob { execution: Execution { resources, ..job.execution }, ..job }
}

/// A job that may not begin before `hours` hours from now. Negative hours lie in the past.
pub fn beginning(job: NewJob, now: Timestamp, hours: i64) -> NewJob {
    let moment = Moment::from_milliseconds(now.milliseconds() + hours * 3_600_000);
    NewJob { execution: Execution { not_before: Some(moment), ..job.execution }, ..job }
}

/// Resources of processors, GPUs and tags.
pub fn resources(cpus: u32, gpus: u32, tags: &[&str]) -> Resources {
    let tags = tags.iter().map(|tag| (*tag).to_owned()).collect();
    Resources { cpus: (cpus > 0).then_some(cpus), gpus, memory_gb: None, tags }
}

/// A simulation, a training on it, and an evaluation of that.
pub fn pipeline(seed: u64) -> Submission {
    let simulation = simulate(seed);
    let training = train(&simulation, vec![Need::New(0)]);
    let evaluation = evaluate(&simulation, &training, vec![Need::New(0), Need::New(1)]);
    pipeline_of(vec![simulation, training, evaluation])
}

pub fn pipeline_of(jobs: Vec<NewJob>) -> Submission {
    let digests: Vec<Digest> = jobs.iter().map(|job| job.digest).collect();
    let spec = json!({"kind": "pipeline", "jobs": digests});
    let members =
        jobs.iter().enumerate().map(|(i, job)| NewMember { name: job.name.clone(), job: i });
    let job = NewJob { unit: "jobs".into(), ..NewJob::new("pipeline", spec) };
    let pipeline = NewPipeline { job, members: members.collect() };
    Submission {
        pipeline: Some(pipeline),
        jobs,
        reuse: Reuse::SameDigest,
        idempotency: None,
        labels: Labels::default(),
    }
}

pub fn alone(job: NewJob) -> Submission {
    Submission::of(job)
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
        self.store.members(&[pipeline]).await.unwrap().iter().map(|member| member.job).collect()
    }

    pub async fn claim(&self) -> Option<ClaimedTask> {
        self.claim_with(&Resources::default()).await
    }

    /// Claims a task as a worker with these resources.
    pub async fn claim_with(&self, offers: &Resources) -> Option<ClaimedTask> {
        self.store.claim("w1", offers, LONG).await.unwrap()
    }

    pub async fn must_claim(&self) -> ClaimedTask {
        self.claim().await.expect("a task to claim")
    }

    /// Claims a task, and lets its lease run out as if the worker were killed.
    pub async fn claim_and_die(&self) -> ClaimedTask {
        let claimed = self.store.claim("w0", &Resources::default(), Duration::ZERO).await.unwrap();
        let task = claimed.expect("a task to claim");
        tokio::time::sleep(Duration::from_millis(3)).await;
        task
    }

    /// Takes back the tasks whose leases have run out.
    pub async fn reap(&self) -> Reaped {
        let mut reaper = Reaper::new(self.store.clone(), Duration::from_secs(1));
        reaper.look(Duration::ZERO).await.unwrap()
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

    /// Sweeps twice, because a sweep deletes only what an earlier one announced. Returns how many
    /// files were deleted.
    pub async fn sweep(&self, older_than: Duration) -> u64 {
        let mut sweeper = Sweeper::new(self.store.clone());
        sweeper.sweep(older_than).await.unwrap();
        sweeper.sweep(older_than).await.unwrap().deleted
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

    /// Replaces the bytes of an object.
    pub async fn damage(&self, path: &str, bytes: Bytes) {
        self.objects.put(&path.into(), bytes.into()).await.unwrap();
    }

    /// Publishes both files of the shard of a claimed task.
    pub async fn publish_shard(&self, task: &ClaimedTask) -> ShardContents {
        let mut files = Vec::new();
        for content in FileContent::ALL {
            let path = object_path::shard(task.job, task.ordinal, task.fence.epoch, content);
            let bytes = Bytes::from(format!("{content} {}", task.ordinal));
            files.push(self.store.put_object(&path, bytes).await.unwrap());
        }
        let robots = files.pop().unwrap();
        let trajectories = files.pop().unwrap();
        ShardContents {
            first: u64::from(task.ordinal) * 2,
            count: 2,
            rejected: 1,
            trajectories,
            robots,
        }
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
    job.digest
}
