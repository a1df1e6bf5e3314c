//! A queue in memory that follows the rules. Random walks through it check their laws, and walks
//! through it and a store at once check that the store follows the same rules.

use std::ops::Range;
use std::time::Duration;

use spec::Moment;
use wire::{JobState, TaskState};

use super::cancellation::{Candidate, members_to_cancel};
use super::job::{Step, TaskTally, after_task, before_start};
use super::pipeline::{MemberStanding, settled};
use super::task::{Ending, TaskStanding};
use super::turn::turn;
use crate::{Epoch, JobId, Timestamp};

mod agreement;
mod laws;
mod walk;

use walk::Dice;

/// Number of steps of all walks together.
const STEPS: u32 = 1_200_000;

/// Number of steps after which a walk begins anew, so that queues stay small and every state is
/// reached.
const STEPS_OF_A_WALK: u32 = 40;

const HOUR: i64 = 3_600_000;

#[derive(Clone, Debug)]
struct Job {
    how: How,
    /// In milliseconds, like all times in this file.
    waits_since: i64,
    state: JobState,
    cancel_requested: bool,
    asked_alone: bool,
    needs: Vec<usize>,
    tasks: Range<usize>,
    /// Members of a pipeline.
    members: Vec<usize>,
}

#[derive(Clone, Debug)]
struct Task {
    job: usize,
    stage: u32,
    standing: TaskStanding,
    delay: Duration,
}

/// How a job is to be executed.
#[derive(Clone, Copy, Debug)]
struct How {
    priority: i32,
    /// Stands for everything that a job can ask of a worker.
    gpus: u32,
    not_before: Option<i64>,
}

/// A job to be submitted.
#[derive(Clone, Debug)]
struct NewJob {
    how: How,
    /// The stage of each task, in order.
    stages: Vec<u32>,
    max_attempts: u32,
    needs: Vec<usize>,
}

#[derive(Clone, Debug, Default)]
struct Queue {
    /// The time, by a clock that may be set back.
    now: i64,
    jobs: Vec<Job>,
    tasks: Vec<Task>,
}

#[derive(Clone, Debug)]
enum Action {
    /// Each job may need those before it. They form a pipeline, or there is only one.
    Submit(Vec<NewJob>),
    /// By a worker with this many GPUs.
    Claim(u32),
    /// The clock advances by this time, or is set back.
    Wait(i64),
    /// Ends a running task, as the worker that claimed it.
    End(usize, Ending),
    Cancel(usize),
}

impl Queue {
    fn submit(&mut self, new: &[NewJob]) {
        let first = self.jobs.len();
        let asked_alone = new.len() == 1;
        for job in new {
            let state = before_start(job.needs.iter().map(|need| self.jobs[*need].state));
            let index = self.jobs.len();
            let tasks = self.tasks.len()..self.tasks.len() + job.stages.len();
            let (needs, members) = (job.needs.clone(), Vec::new());
            let waits_since = self.waits_since();
            self.jobs.push(Job {
                how: job.how,
                waits_since,
                state,
                cancel_requested: false,
                asked_alone,
                needs,
                tasks,
                members,
            });
            for stage in &job.stages {
                let standing = TaskStanding {
                    state: TaskState::Waiting,
                    attempt: 0,
                    max_attempts: job.max_attempts,
                    epoch: Epoch(0),
                    cancel_requested: false,
                };
                let task = Task { job: index, stage: *stage, standing, delay: Duration::ZERO };
                self.tasks.push(task);
            }
            if state == JobState::Queued {
                self.advance(index);
            }
        }
        if !asked_alone {
            let members: Vec<usize> = (first..self.jobs.len()).collect();
            let end = self.tasks.len();
            self.jobs.push(Job {
                how: How { priority: 0, gpus: 0, not_before: None },
                waits_since: self.waits_since(),
                state: JobState::Queued,
                cancel_requested: false,
                asked_alone: true,
                needs: Vec::new(),
                tasks: end..end,
                members,
            });
            self.settle_all();
        }
    }

    /// The moment since when a job waits that is submitted now.
    fn waits_since(&self) -> i64 {
        let open = self.jobs.iter().filter(|job| !job.state.is_final());
        open.map(|job| job.waits_since).fold(self.now, i64::max)
    }

    /// The place in line: the smaller goes first.
    fn place(&self, task: usize) -> (i64, usize) {
        let Job { how, waits_since, .. } = &self.jobs[self.tasks[task].job];
        let not_before = how.not_before.map(Moment::from_milliseconds);
        (turn(Timestamp::from_milliseconds(*waits_since), not_before, how.priority), task)
    }

    fn claim(&mut self, task: usize) {
        let job = self.tasks[task].job;
        self.tasks[task].standing = self.tasks[task].standing.claimed();
        if self.jobs[job].state == JobState::Queued {
            self.jobs[job].state = JobState::Running;
            self.settle_all();
        }
    }

    fn end(&mut self, task: usize, ending: Ending) {
        let (standing, delay) = self.tasks[task].standing.after(ending);
        (self.tasks[task].standing, self.tasks[task].delay) = (standing, delay);
        if standing.state != TaskState::Queued {
            self.advance(self.tasks[task].job);
        }
    }

    fn cancel(&mut self, job: usize) {
        if self.jobs[job].state.is_final() {
            return;
        }
        self.jobs[job].cancel_requested = true;
        if self.jobs[job].members.is_empty() {
            self.stop(job);
            return;
        }
        let candidates: Vec<Candidate> =
            self.jobs[job].members.iter().map(|member| self.candidate(*member)).collect();
        let members = members_to_cancel(&candidates);
        for member in &members {
            self.jobs[index(*member)].cancel_requested = true;
        }
        for member in members {
            self.stop(index(member));
        }
        self.settle_all();
    }

    fn candidate(&self, member: usize) -> Candidate {
        let job = &self.jobs[member];
        let is_live = |job: &Job| !job.cancel_requested && !job.state.is_final();
        let waits = |entry: &(usize, &Job)| {
            entry.1.state == JobState::Waiting && entry.1.needs.contains(&member)
        };
        Candidate {
            job: id(member),
            state: job.state,
            asked_alone: job.asked_alone,
            is_shared: self.jobs.iter().any(|job| job.members.contains(&member) && is_live(job)),
            needed_by: self
                .jobs
                .iter()
                .enumerate()
                .filter(waits)
                .map(|entry| id(entry.0))
                .collect(),
        }
    }

    fn stop(&mut self, job: usize) {
        self.stop_tasks(job);
        self.advance(job);
    }

    /// Cancels queued tasks, and asks workers to stop running tasks.
    fn stop_tasks(&mut self, job: usize) {
        for task in &mut self.tasks[self.jobs[job].tasks.clone()] {
            match task.standing.state {
                TaskState::Waiting | TaskState::Queued => {
                    task.standing.state = TaskState::Cancelled;
                }
                TaskState::Running => task.standing.cancel_requested = true,
                _ => {}
            }
        }
    }

    fn advance(&mut self, job: usize) {
        let tasks = &self.tasks[self.jobs[job].tasks.clone()];
        let any = |state| tasks.iter().any(|task| task.standing.state == state);
        let open = tasks.iter().filter(|task| !has_ended(task.standing.state));
        let waiting = tasks.iter().filter(|task| task.standing.state == TaskState::Waiting);
        let tally = TaskTally {
            failed: any(TaskState::Failed),
            cancelled: any(TaskState::Cancelled),
            open_stage: open.map(|task| task.stage).min(),
            waiting_stage: waiting.map(|task| task.stage).min(),
        };
        match after_task(self.jobs[job].state, tally) {
            Step::Nothing => {}
            Step::QueueStage(stage) => self.queue_stage(job, stage),
            Step::End(state) => self.finish(job, state),
        }
    }

    fn queue_stage(&mut self, job: usize, stage: u32) {
        for task in &mut self.tasks[self.jobs[job].tasks.clone()] {
            if task.stage == stage && task.standing.state == TaskState::Waiting {
                task.standing.state = TaskState::Queued;
            }
        }
    }

    fn finish(&mut self, job: usize, state: JobState) {
        self.stop_tasks(job);
        self.jobs[job].state = state;
        for dependent in 0..self.jobs.len() {
            let Job { state, needs, .. } = &self.jobs[dependent];
            if *state != JobState::Waiting || !needs.contains(&job) {
                continue;
            }
            match before_start(needs.iter().map(|need| self.jobs[*need].state)) {
                JobState::Queued => {
                    self.jobs[dependent].state = JobState::Queued;
                    self.advance(dependent);
                }
                JobState::Cancelled => self.finish(dependent, JobState::Cancelled),
                _ => {}
            }
        }
        self.settle_all();
    }

    fn settle_all(&mut self) {
        for pipeline in 0..self.jobs.len() {
            let Job { state, cancel_requested, members, .. } = &self.jobs[pipeline];
            if members.is_empty() {
                continue;
            }
            let standing = |member: &usize| {
                let Job { state, cancel_requested, .. } = self.jobs[*member];
                MemberStanding { state, cancel_requested }
            };
            let members: Vec<MemberStanding> = members.iter().map(standing).collect();
            self.jobs[pipeline].state = settled(*state, *cancel_requested, &members);
        }
    }

    /// Tasks that a worker with this many GPUs may claim once their delays have passed.
    fn claimable(&self, gpus: u32) -> Vec<usize> {
        let may_be_claimed = |task: &usize| {
            let Task { job, standing, .. } = &self.tasks[*task];
            let how = self.jobs[*job].how;
            let may_begin = how.not_before.is_none_or(|moment| moment <= self.now);
            standing.state == TaskState::Queued && how.gpus <= gpus && may_begin
        };
        (0..self.tasks.len()).filter(may_be_claimed).collect()
    }
}

const fn has_ended(task: TaskState) -> bool {
    matches!(task, TaskState::Succeeded | TaskState::Failed | TaskState::Cancelled)
}

fn id(job: usize) -> JobId {
    JobId(i64::try_from(job).unwrap())
}

fn index(job: JobId) -> usize {
    usize::try_from(job.0).unwrap()
}

#[test]
fn the_laws_of_the_queue_hold_whatever_happens() {
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let mut queue = Queue::default();
    for step in 0..STEPS {
        if step % STEPS_OF_A_WALK == 0 {
            queue = Queue { now: 1000 * HOUR, ..Queue::default() };
        }
        let before = queue.clone();
        match queue.action(&mut dice) {
            Action::Submit(jobs) => queue.submit(&jobs),
            Action::Claim(gpus) => {
                let mut claimable = queue.claimable(gpus);
                // A delay may have passed already.
                claimable.retain(|task| queue.tasks[*task].delay.is_zero() || dice.below(2) == 0);
                if let Some(task) = claimable.iter().copied().min_by_key(|task| queue.place(*task))
                {
                    queue.check_turn(task, &claimable);
                    queue.claim(task);
                }
            }
            Action::Wait(time) => queue.now += time,
            Action::End(task, ending) => {
                let held = queue.tasks[task].standing;
                queue.end(task, ending);
                let standing = queue.tasks[task].standing;
                if ending == Ending::Released && standing.state == TaskState::Queued {
                    assert_eq!(standing.attempt + 1, held.attempt, "a release is no attempt");
                }
            }
            Action::Cancel(job) => queue.cancel(job),
        }
        queue.check();
        queue.check_since(&before);
    }
}
