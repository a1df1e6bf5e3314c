//! The queues of live predictions. Each computes one prediction at a time, with all its threads.

use std::num::NonZero;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

use api::live::{LiveError, LiveQueue};
use models::Interrupt;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use tokio::sync::{Semaphore, oneshot};

/// Number of predictions of a queue that may wait. Further ones are refused.
const WAITING: usize = 64;

/// A queue and a pool of threads for each [`LiveQueue`].
pub struct LiveQueues {
    requests: Turns,
    streams: Turns,
    pub threads: usize,
}

pub struct Turns {
    threads: ThreadPool,
    /// Permits are given in the order of requests.
    turn: Arc<Semaphore>,
    /// Permits for predictions that compute or wait.
    places: Semaphore,
}

/// The result of some work, with its times.
#[derive(Debug)]
pub struct Done<T> {
    pub result: Result<T, Panic>,
    /// Time until its turn came.
    pub queued: Duration,
    pub computed: Duration,
}

/// The message of a panic.
#[derive(Debug)]
pub struct Panic(pub String);

impl LiveQueues {
    pub fn new(threads: NonZero<usize>) -> Result<Self, ThreadPoolBuildError> {
        let threads = threads.get();
        let turns = |name: &'static str| Turns::new(name, threads);
        Ok(Self { requests: turns("requests")?, streams: turns("streams")?, threads })
    }

    pub fn of(&self, queue: LiveQueue) -> &Turns {
        match queue {
            LiveQueue::Requests => &self.requests,
            LiveQueue::Streams => &self.streams,
        }
    }
}

impl Turns {
    fn new(name: &'static str, threads: usize) -> Result<Self, ThreadPoolBuildError> {
        let threads = ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(move |index| format!("{name}-{index}"))
            .build()?;
        let turn = Arc::new(Semaphore::new(1));
        Ok(Self { threads, turn, places: Semaphore::new(WAITING + 1) })
    }

    /// Runs `work` on the queue's threads when its turn comes. `work` gets an interrupt that is
    /// raised when nobody waits for it any more.
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Interrupt) -> T + Send + 'static,
    ) -> Result<Done<T>, LiveError> {
        let full = |_| LiveError::Queue { waiting: WAITING };
        let _place = self.places.try_acquire().map_err(full)?;
        let asked = Instant::now();
        let turn = Arc::clone(&self.turn).acquire_owned().await;
        let queued = asked.elapsed();
        let abandoned = RaisedOnDrop(Interrupt::default());
        let interrupt = abandoned.0.clone();
        let (sender, receiver) = oneshot::channel();
        self.threads.spawn(move || {
            let started = Instant::now();
            let result = catch_unwind(AssertUnwindSafe(|| work(&interrupt)));
            let result =
                result.map_err(|panic| Panic(spec::panic_message(panic.as_ref()).to_owned()));
            // The turn ends before the answer is sent, so the queue is free for the receiver of
            // the answer.
            drop(turn);
            // Sending fails if nobody waits any more.
            let _ = sender.send((result, started.elapsed()));
        });
        let lost =
            |_| LiveError::Failed { reason: "its thread ended without an answer".to_owned() };
        let (result, computed) = receiver.await.map_err(lost)?;
        Ok(Done { result, queued, computed })
    }
}

/// Interrupts the work when its future is dropped.
struct RaisedOnDrop(Interrupt);

impl Drop for RaisedOnDrop {
    fn drop(&mut self) {
        self.0.raise();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use futures::future::join_all;

    use super::*;

    fn queues() -> LiveQueues {
        LiveQueues::new(NonZero::<usize>::MIN).unwrap()
    }

    #[tokio::test]
    async fn turns_are_taken_in_the_order_of_asking_and_one_at_a_time() {
        let queues = queues();
        let (sender, receiver) = mpsc::channel();
        let all = join_all((0..20).map(|index| {
            let sender = sender.clone();
            queues.streams.run(move |_| {
                sender.send((index, "begins")).unwrap();
                std::thread::sleep(Duration::from_millis(1));
                sender.send((index, "ends")).unwrap();
            })
        }));
        let all = all.await;
        assert!(all.iter().all(|done| done.as_ref().is_ok_and(|done| done.result.is_ok())));
        drop(sender);
        let expected: Vec<_> =
            (0..20).flat_map(|index| [(index, "begins"), (index, "ends")]).collect();
        assert_eq!(receiver.iter().collect::<Vec<_>>(), expected);
        let last = all.last().unwrap().as_ref().unwrap();
        assert!(last.queued >= Duration::from_millis(19), "{:?}", last.queued);
    }

    #[tokio::test]
    async fn a_full_queue_refuses_predictions_and_the_other_queue_goes_on() {
        let queues = queues();
        let (go, gate) = mpsc::channel::<()>();
        let first = queues.requests.run(move |_| gate.recv().is_ok());
        let waiting = join_all((0..WAITING).map(|_| queues.requests.run(|_| ())));
        let rest = async {
            tokio::task::yield_now().await;
            let refused = queues.requests.run(|_| ()).await;
            assert!(matches!(refused, Err(LiveError::Queue { waiting: WAITING })), "{refused:?}");
            assert_eq!(queues.streams.run(|_| 7).await.unwrap().result.unwrap(), 7);
            go.send(()).unwrap();
        };
        let (first, waiting, ()) = tokio::join!(first, waiting, rest);
        assert!(first.unwrap().result.unwrap());
        assert!(waiting.iter().all(Result::is_ok));
    }

    #[tokio::test]
    async fn a_panic_is_an_answer_and_the_lane_goes_on() {
        let queues = queues();
        let done = queues.requests.run(|_| -> u32 { panic!("a shape of {}", 7) }).await.unwrap();
        assert_eq!(done.result.unwrap_err().0, "a shape of 7");
        assert_eq!(queues.requests.run(|_| 1).await.unwrap().result.unwrap(), 1);
    }

    #[tokio::test]
    async fn work_that_nobody_waits_for_is_interrupted() {
        let queues = queues();
        let (ended, end) = oneshot::channel();
        let work = queues.requests.run(move |interrupt| {
            while !interrupt.is_raised() {
                std::thread::sleep(Duration::from_millis(1));
            }
            ended.send(()).unwrap();
        });
        assert!(tokio::time::timeout(Duration::from_millis(20), work).await.is_err());
        end.await.unwrap();
        assert_eq!(queues.requests.run(|_| 2).await.unwrap().result.unwrap(), 2);
    }
}
