//! Random actions, the same in every run.

use wire::TaskState;

use super::{Action, HOUR, How, NewJob, Queue};
use crate::Retry;
use crate::queue::rules::job::is_unsuccessful;
use crate::queue::rules::task::Ending;

impl Queue {
    /// A random action that is possible now.
    pub(super) fn action(&self, dice: &mut Dice) -> Action {
        let running: Vec<usize> = (0..self.tasks.len())
            .filter(|task| self.tasks[*task].standing.state == TaskState::Running)
            .collect();
        match dice.below(10) {
            0 => Action::Submit(self.new_jobs(dice)),
            1 if !self.jobs.is_empty() && dice.below(3) == 0 => {
                Action::Cancel(dice.below(self.jobs.len()))
            }
            2..=6 if !running.is_empty() => {
                let endings = [
                    Ending::Completed,
                    Ending::Completed,
                    Ending::Completed,
                    Ending::Failed(Retry::Allowed),
                    Ending::Failed(Retry::Never),
                    Ending::Released,
                    Ending::Stopped,
                ];
                let task = running[dice.below(running.len())];
                let can_be_stopped = self.tasks[task].standing.cancel_requested;
                match endings[dice.below(endings.len())] {
                    Ending::Stopped if !can_be_stopped => Action::End(task, Ending::Released),
                    ending => Action::End(task, ending),
                }
            }
            7 if dice.below(2) == 0 => {
                let hours = [1, 5, 24, 24, 150, -2];
                Action::Wait(hours[dice.below(hours.len())] * HOUR)
            }
            _ => Action::Claim([0, 1, 1, 2][dice.below(4)]),
        }
    }

    fn how(&self, dice: &mut Dice) -> How {
        let begins = [None, None, None, None, Some(-HOUR), Some(24 * HOUR)];
        How {
            priority: [-100, -1, 0, 0, 0, 3, 100][dice.below(7)],
            gpus: [0, 0, 0, 1, 2][dice.below(5)],
            not_before: begins[dice.below(begins.len())].map(|ahead| self.now + ahead),
        }
    }

    fn new_jobs(&self, dice: &mut Dice) -> Vec<NewJob> {
        let usable: Vec<usize> = (0..self.jobs.len())
            .filter(|job| !is_unsuccessful(self.jobs[*job].state))
            // No job needs a pipeline, only its members.
            .filter(|job| self.jobs[*job].members.is_empty())
            .collect();
        let count = [1, 1, 2, 3][dice.below(4)];
        let new_job = |position: usize| {
            let mut stages: Vec<u32> = (0..=dice.below(3)).map(|_| dice.stage()).collect();
            stages.sort_unstable();
            let mut needs: Vec<usize> = (self.jobs.len()..self.jobs.len() + position)
                .filter(|_| dice.below(2) == 0)
                .collect();
            if !usable.is_empty() && dice.below(3) == 0 {
                needs.push(usable[dice.below(usable.len())]);
            }
            let max_attempts = u32::try_from(1 + dice.below(3)).unwrap();
            NewJob { how: self.how(dice), stages, max_attempts, needs }
        };
        (0..count).map(new_job).collect()
    }
}

/// Xorshift: a few random bits per step, the same in every run.
pub(super) struct Dice(pub u64);

impl Dice {
    pub(super) fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        usize::try_from(self.0 >> 33).unwrap() % bound
    }

    fn stage(&mut self) -> u32 {
        u32::try_from(self.below(3)).unwrap()
    }
}
