//! The laws of the queue.

use wire::{JobState, TaskState};

use super::{HOUR, Job, Queue, has_ended};

impl Queue {
    /// Checks the laws of the queue's order, given the tasks that a worker could have claimed.
    pub(super) fn check_turn(&self, claimed: usize, passed: &[usize]) {
        let job = |task: usize| &self.jobs[self.tasks[task].job];
        let since = |job: &Job| job.waits_since.max(job.how.not_before.unwrap_or(i64::MIN));
        let first = job(claimed);
        for other in passed.iter().map(|task| job(*task)) {
            let points = i64::from(first.how.priority - other.how.priority);
            let longer = since(first) - since(other);
            assert!(longer <= points * HOUR, "a point of priority is worth an hour, and no more");
            assert!(longer <= 200 * HOUR, "nobody is passed for ever by all that come");
        }
        let same = |other: &Job| {
            (first.how.priority, first.how.not_before) == (other.how.priority, other.how.not_before)
        };
        let older = |task: &&usize| self.tasks[**task].job < self.tasks[claimed].job;
        let mut older = passed.iter().filter(older).map(|task| job(*task));
        assert!(
            !older.any(same),
            "of one priority the older job goes first, whatever the clock did"
        );
    }

    /// Checks the laws that hold at every moment.
    pub(super) fn check(&self) {
        for task in &self.tasks {
            let (job, standing) = (&self.jobs[task.job], &task.standing);
            assert!(standing.attempt <= standing.max_attempts, "attempts are bounded: {task:?}");
            let is_startable = matches!(standing.state, TaskState::Waiting | TaskState::Queued);
            assert!(!(is_startable && job.cancel_requested), "a cancelled job starts nothing");
            assert!(!(is_startable && job.state.is_final()), "an ended job starts nothing");
            if matches!(standing.state, TaskState::Queued | TaskState::Running) {
                let needs = job.needs.iter().map(|need| self.jobs[*need].state);
                assert!(needs.clone().all(|state| state == JobState::Succeeded), "needs are met");
                let siblings = &self.tasks[job.tasks.clone()];
                let mut before = siblings.iter().filter(|sibling| sibling.stage < task.stage);
                assert!(
                    before.all(|sibling| sibling.standing.state == TaskState::Succeeded),
                    "in stages"
                );
            }
        }
        for job in self.jobs.iter().filter(|job| job.members.is_empty()) {
            let tasks = &self.tasks[job.tasks.clone()];
            let count = |state| tasks.iter().filter(|task| task.standing.state == state).count();
            match job.state {
                JobState::Succeeded => assert_eq!(count(TaskState::Succeeded), tasks.len()),
                JobState::Failed => assert_ne!(count(TaskState::Failed), 0),
                JobState::Cancelled => assert_ne!(count(TaskState::Cancelled), 0),
                JobState::Waiting => assert_eq!(count(TaskState::Waiting), tasks.len()),
                JobState::Queued | JobState::Running => {
                    let open = tasks.iter().any(|task| !has_ended(task.standing.state));
                    assert!(open && count(TaskState::Failed) == 0, "it can still succeed");
                    let unattended = count(TaskState::Running) == 0;
                    assert!(!(job.cancel_requested && unattended), "it ends when nobody is at it");
                }
            }
        }
        for pipeline in self.jobs.iter().filter(|job| !job.members.is_empty()) {
            let states = pipeline.members.iter().map(|member| self.jobs[*member].state);
            let all = states.clone().all(|state| state == JobState::Succeeded);
            assert_eq!(pipeline.state == JobState::Succeeded, all && !pipeline.was_ended_early());
            if pipeline.state == JobState::Failed {
                assert!(states.clone().any(|state| state == JobState::Failed));
            }
            if !pipeline.state.is_final() && !pipeline.cancel_requested {
                assert!(states.clone().any(|state| !state.is_final()), "it ends with its members");
            }
        }
    }

    /// Checks the laws between two moments, one step apart.
    pub(super) fn check_since(&self, before: &Self) {
        for (now, before) in self.tasks.iter().zip(&before.tasks) {
            let (now, before) = (now.standing, before.standing);
            if has_ended(before.state) {
                assert_eq!(now, before, "final states never change");
            }
            let is_claimed = before.state == TaskState::Queued && now.state == TaskState::Running;
            let raised = now.epoch.0 - before.epoch.0;
            assert_eq!(raised, i64::from(is_claimed), "a claim and nothing else raises the epoch");
            if before.state == TaskState::Running && now.state != TaskState::Running {
                assert!(!now.is_held_at(before.epoch), "who gave a task back has lost it");
            }
        }
        for (now, before) in self.jobs.iter().zip(&before.jobs) {
            assert!(!before.state.is_final() || now.state == before.state, "as with tasks");
        }
    }
}

impl Job {
    /// Whether it ended before its members: a cancelled pipeline may leave members that succeed
    /// later.
    fn was_ended_early(&self) -> bool {
        self.state == JobState::Cancelled
    }
}
