//! Checks that the store does the same as the queue in memory.

use std::time::Duration;

use serde_json::json;
use spec::{Execution, Moment, Resources};
use wire::JobState;

use super::{Action, Dice, HOUR, Queue};
use crate::queue::rules::task::Ending;
use crate::{
    Access, ClaimedTask, JobId, Labels, NewJob, NewMember, NewPipeline, NewTask, Page, Reaper,
    Retry, Reuse, Store, Submission,
};

const WALKS: u64 = 8;
const STEPS_OF_A_WALK: u32 = 60;

/// A store, with the ids of the jobs and tasks of a [`Queue`] in it.
struct Twin {
    store: Store,
    jobs: Vec<JobId>,
    /// The result of the last claim of each task, by the task's index.
    claims: Vec<Option<ClaimedTask>>,
    /// The times of the store's clock and of the queue's clock. Both clocks stand still.
    clocks: (i64, i64),
    /// Makes digests differ, so that no job stands in for another.
    submissions: u64,
}

impl Twin {
    /// The moment that is as far from the store's present as `moment` is from the queue's.
    fn moment(&self, moment: i64) -> Moment {
        let (store, queue) = self.clocks;
        Moment::from_milliseconds(store + (moment - queue))
    }

    async fn submit(&mut self, jobs: &[super::NewJob]) {
        self.submissions += 1;
        let first = self.jobs.len();
        let new_job = |(position, job): (usize, &super::NewJob)| {
            let spec = json!({"submission": self.submissions, "position": position});
            let need = |index: &usize| match index.checked_sub(first) {
                Some(sibling) => crate::Need::New(sibling),
                None => crate::Need::Existing(self.jobs[*index]),
            };
            let task = |(ordinal, stage): (u32, &u32)| NewTask {
                stage: *stage,
                ordinal,
                label: format!("task {ordinal}"),
                payload: json!({}),
                total: 1,
            };
            let execution = Execution {
                priority: job.how.priority,
                max_attempts: job.max_attempts,
                time_limit_s: None,
                resources: offer(job.how.gpus),
                not_before: job.how.not_before.map(|moment| self.moment(moment)),
            };
            NewJob {
                name: format!("job {position}"),
                execution,
                tasks: (0u32..).zip(&job.stages).map(task).collect(),
                needs: job.needs.iter().map(need).collect(),
                ..NewJob::new("any", spec)
            }
        };
        let new: Vec<NewJob> = jobs.iter().enumerate().map(new_job).collect();
        let spec = json!({"pipeline": self.submissions});
        let member = |job: usize| NewMember { name: format!("member {job}"), job };
        let pipeline = (jobs.len() > 1).then(|| NewPipeline {
            job: NewJob::new("pipeline", spec),
            members: (0..jobs.len()).map(member).collect(),
        });
        let submission = Submission {
            jobs: new,
            pipeline,
            reuse: Reuse::Never,
            idempotency: None,
            labels: Labels::default(),
        };
        let submitted = self.store.submit(submission).await.unwrap().job;
        let members = self.store.members(&[submitted]).await.unwrap();
        self.jobs.extend(members.iter().map(|member| member.job));
        self.jobs.push(submitted);
        let count: usize = jobs.iter().map(|job| job.stages.len()).sum();
        self.claims.extend((0..count).map(|_| None));
    }

    async fn end(&self, task: usize, ending: Ending) {
        let fence = self.claims[task].as_ref().unwrap().fence;
        let ended = match ending {
            Ending::Completed => self.store.complete(fence, None).await,
            Ending::Failed(retry) => self.store.fail(fence, "no", retry).await,
            Ending::Released => self.store.release(fence).await,
            Ending::Deferred => self.store.defer(fence, "no room").await,
            Ending::Stopped => self.store.stopped(fence).await,
        };
        ended.unwrap();
    }

    /// The index in `queue` of a claimed task.
    async fn index_of(&self, queue: &Queue, claimed: &ClaimedTask) -> usize {
        let job = self.jobs.iter().position(|job| *job == claimed.job).unwrap();
        let tasks = self.store.tasks(claimed.job).await.unwrap();
        let position = tasks.iter().position(|task| task.id == claimed.fence.task).unwrap();
        queue.jobs[job].tasks.start + position
    }

    async fn assert_agrees_with(&self, queue: &Queue) {
        let stored =
            self.store.jobs(crate::JobFilter::default(), Page { before: None, limit: 500 });
        let mut stored: Vec<(JobId, JobState)> =
            stored.await.unwrap().iter().map(|job| (job.id, job.state)).collect();
        stored.reverse();
        let states = queue.jobs.iter().map(|job| job.state);
        let expected: Vec<(JobId, JobState)> = self.jobs.iter().copied().zip(states).collect();
        assert_eq!(stored, expected);
        for (id, job) in self.jobs.iter().zip(&queue.jobs) {
            let tasks = self.store.tasks(*id).await.unwrap();
            for (task, expected) in tasks.iter().zip(&queue.tasks[job.tasks.clone()]) {
                let standing = expected.standing;
                assert_eq!((task.state, task.attempt), (standing.state, standing.attempt));
                assert_eq!(task.epoch, standing.epoch);
                assert_eq!(task.cancel_requested, standing.cancel_requested);
            }
        }
    }
}

#[tokio::test]
async fn a_store_follows_the_rules_through_any_walk() {
    for walk in 1..=WALKS {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path(), Access::Server).await.unwrap();
        let mut queue = Queue { now: 1000 * HOUR, ..Queue::default() };
        let clocks = (store.now().await.unwrap().milliseconds(), queue.now);
        let mut twin = Twin { store, jobs: Vec::new(), claims: Vec::new(), clocks, submissions: 0 };
        let mut dice = Dice(walk.wrapping_mul(0x9e37_79b9));
        for _ in 0..STEPS_OF_A_WALK {
            match queue.action(&mut dice) {
                Action::Submit(jobs) => {
                    queue.submit(&jobs);
                    twin.submit(&jobs).await;
                }
                Action::Claim(gpus) => claim(&mut queue, &mut twin, &mut dice, gpus).await,
                // The store uses the system's clock.
                Action::Wait(_) => {}
                Action::End(task, ending) => {
                    queue.end(task, ending);
                    twin.end(task, ending).await;
                }
                Action::Cancel(job) => {
                    queue.cancel(job);
                    twin.store.cancel(twin.jobs[job]).await.unwrap();
                }
            }
            twin.assert_agrees_with(&queue).await;
        }
    }
}

fn offer(gpus: u32) -> Resources {
    Resources { gpus, ..Resources::default() }
}

/// Claims a task. A delay may have passed by the store's clock. Some workers die at once.
async fn claim(queue: &mut Queue, twin: &mut Twin, dice: &mut Dice, gpus: u32) {
    let dies = dice.below(5) == 0;
    let ttl = if dies { Duration::ZERO } else { Duration::from_secs(600) };
    let claimable = queue.claimable(gpus);
    let is_ready = |task: &usize| queue.tasks[*task].delay.is_zero();
    let ready: Vec<usize> = claimable.iter().copied().filter(is_ready).collect();
    let Some(claimed) = twin.store.claim("worker", &offer(gpus), ttl).await.unwrap() else {
        assert_eq!(ready, [0; 0], "a task that is ready is claimed");
        return;
    };
    let task = twin.index_of(queue, &claimed).await;
    assert!(claimable.contains(&task), "it may be claimed by this worker");
    let is_passed = |other: &usize| queue.place(*other) < queue.place(task);
    assert!(!ready.iter().any(is_passed), "the first in line is claimed");
    queue.claim(task);
    twin.claims[task] = Some(claimed);
    if dies {
        tokio::time::sleep(Duration::from_millis(3)).await;
        let mut reaper = Reaper::new(twin.store.clone(), Duration::from_secs(1));
        reaper.look(Duration::ZERO).await.unwrap();
        queue.end(task, Ending::Failed(Retry::Allowed));
    }
}
