use store::{ClaimedTask, LogChunk, LogFilter, LogPage, NewLogChunk, Page, Retry, Store};

use super::{Fixture, assert_lost, simulate, train};

fn chunk(position: u64, text: &str) -> NewLogChunk {
    NewLogChunk { position, text: text.to_owned() }
}

fn of(jobs: &[store::JobId]) -> LogFilter {
    LogFilter { jobs: jobs.to_vec(), ..LogFilter::default() }
}

fn texts(chunks: &[LogChunk]) -> Vec<&str> {
    chunks.iter().map(|chunk| chunk.text.as_str()).collect()
}

impl Fixture {
    async fn log(&self, task: &ClaimedTask, position: u64, text: &str) {
        self.store.append_log(task.fence, &[chunk(position, text)]).await.unwrap();
    }

    async fn log_after(&self, filter: &LogFilter, id: i64) -> Vec<LogChunk> {
        self.store.log_page(filter, LogPage::After { id, limit: 100 }).await.unwrap()
    }
}

pub async fn a_log_is_read_in_order_and_from_any_chunk_on(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let other = f.submit_one(train(&simulate(1), vec![])).await;
    let (first, second) = (f.must_claim().await, f.must_claim().await);
    f.log(&first, 0, "one\n").await;
    f.log(&second, 0, "two\n").await;
    f.store.append_log(first.fence, &[]).await.unwrap();
    f.store.append_log(first.fence, &[chunk(4, "three\n"), chunk(20, "four\n")]).await.unwrap();

    let all = f.log_after(&of(&[job]), 0).await;
    assert_eq!(texts(&all), ["one\n", "two\n", "three\n", "four\n"]);
    assert_eq!((all[1].task, all[1].label.as_str()), (second.fence.task, "piece 0.1"));
    assert_eq!((all[3].position, all[3].worker.as_str()), (20, "w1"));
    assert_eq!(texts(&f.log_after(&of(&[job]), all[1].id).await), ["three\n", "four\n"]);
    assert_eq!(f.log_after(&of(&[other]), 0).await, []);

    let newest = LogPage::Before { id: None, limit: 3 };
    let newest = f.store.log_page(&of(&[other, job]), newest).await.unwrap();
    assert_eq!(newest, all[1..]);
    let before = LogPage::Before { id: Some(newest[0].id), limit: 3 };
    assert_eq!(f.store.log_page(&of(&[job]), before).await.unwrap(), all[..1]);

    let whole = f.store.attempt_log(all[0].attempt).await.unwrap();
    assert_eq!(whole, [chunk(0, "one\n"), chunk(4, "three\n"), chunk(20, "four\n")]);
    assert_eq!(f.store.attempt(all[0].attempt).await.unwrap().log_bytes, Some(25));
    let missing = f.store.attempt(99).await.unwrap_err().to_string();
    assert!(missing.contains("attempt 99"), "{missing}");
}

pub async fn logs_are_told_apart_by_task_and_attempt(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let first = f.must_claim().await;
    f.log(&first, 0, "first try\n").await;
    f.store.release(first.fence).await.unwrap();
    let again = f.must_claim().await;
    f.log(&again, 0, "second try\n").await;
    let other = f.must_claim().await;
    f.log(&other, 0, "other\n").await;

    let tasks = f.store.tasks_labelled(&[job], "piece 0.0").await.unwrap();
    assert_eq!(tasks, [first.fence.task]);
    assert_eq!(f.store.tasks_labelled(&[job], "piece 9.9").await.unwrap(), []);
    let of_task = LogFilter { tasks: Some(tasks), ..of(&[job]) };
    let chunks = f.log_after(&of_task, 0).await;
    assert_eq!(texts(&chunks), ["first try\n", "second try\n"]);
    let of_attempt = LogFilter { attempt: Some(chunks[1].attempt), ..of(&[job]) };
    assert_eq!(texts(&f.log_after(&of_attempt, 0).await), ["second try\n"]);
}

pub async fn the_log_of_a_long_attempt_keeps_its_beginning_and_its_end(f: Fixture) {
    f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    let line = format!("{}\n", "x".repeat(Store::LOG_CHUNK_BYTES - 1));
    let size = Store::LOG_CHUNK_BYTES as u64;
    for k in 0..100 {
        f.log(&task, k * size, &line).await;
    }
    let kept = f.store.attempt_log(1).await.unwrap();
    let bytes: u64 = kept.iter().map(|chunk| chunk.text.len() as u64).sum();
    assert_eq!(bytes, Store::LOG_HEAD_BYTES + Store::LOG_TAIL_BYTES);
    let gap = kept.windows(2).filter(|pair| pair[0].end() != pair[1].position).count();
    assert_eq!((gap, kept.last().unwrap().end()), (1, 100 * size));
    assert_eq!(kept[15].end(), Store::LOG_HEAD_BYTES);
    assert_eq!(f.store.attempt(1).await.unwrap().log_bytes, Some(100 * size));

    let too_long = format!("{line}{line}");
    f.store.append_log(task.fence, &[chunk(100 * size, &too_long)]).await.unwrap_err();
}

pub async fn a_chunk_that_is_sent_again_is_there_once(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let task = f.must_claim().await;
    f.log(&task, 0, "one\n").await;
    f.store.append_log(task.fence, &[chunk(0, "one\ntwo\n"), chunk(8, "three\n")]).await.unwrap();
    assert_eq!(texts(&f.log_after(&of(&[job]), 0).await), ["one\ntwo\n", "three\n"]);
}

pub async fn a_worker_that_lost_its_task_adds_nothing_to_its_log(f: Fixture) {
    let job = f.submit_one(train(&simulate(1), vec![])).await;
    let lost = f.claim_and_die().await;
    f.log(&lost, 0, "while it had it\n").await;
    f.reap().await;
    let late = [chunk(16, "late\n")];
    assert_lost(f.store.append_log(lost.fence, &late).await, lost.fence);
    let next = f.must_claim().await;
    assert_lost(f.store.append_log(lost.fence, &late).await, lost.fence);
    f.log(&next, 0, "the next\n").await;
    f.store.complete(next.fence, None).await.unwrap();
    assert_lost(f.store.append_log(next.fence, &late).await, next.fence);
    assert_eq!(texts(&f.log_after(&of(&[job]), 0).await), ["while it had it\n", "the next\n"]);
}

pub async fn old_attempts_of_a_job_lose_their_logs(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let running = f.must_claim().await;
    f.log(&running, 0, "runs all the time\n").await;
    let kept = i64::from(Store::LOGS_PER_JOB);
    // The last one prunes the logs of all that ended before it.
    for _ in 0..kept + 3 {
        let task = f.must_claim().await;
        f.log(&task, 0, "short\n").await;
        f.store.release(task.fence).await.unwrap();
    }
    let page = Page { limit: 500, ..Page::default() };
    let attempts = f.store.attempts(job, page).await.unwrap();
    let with_log: Vec<i64> = attempts
        .iter()
        .filter(|attempt| attempt.log_bytes.is_some())
        .map(|attempt| attempt.id)
        .collect();
    let expected: Vec<i64> = (4..=kept + 4).rev().chain([1]).collect();
    assert_eq!(with_log, expected);
    assert_eq!(f.store.attempt_log(3).await.unwrap(), []);
    assert_eq!(f.store.attempt_log(4).await.unwrap().len(), 1);
    assert_eq!(f.store.attempt_log(1).await.unwrap().len(), 1);
}

pub async fn a_log_may_grow_until_its_tasks_have_ended(f: Fixture) {
    let job = f.submit_one(simulate(1)).await;
    let (failing, running) = (f.must_claim().await, f.must_claim().await);
    let of_failing = LogFilter { tasks: Some(vec![failing.fence.task]), ..of(&[job]) };
    let of_attempt = LogFilter { attempt: Some(1), ..of(&[job]) };
    for filter in [&of(&[job]), &of_failing, &of_attempt] {
        assert!(f.store.may_log(filter).await.unwrap(), "{filter:?}");
    }
    f.store.fail(failing.fence, "out of luck", Retry::Never).await.unwrap();
    // The job has failed, and a worker still has one of its tasks.
    assert!(f.store.may_log(&of(&[job])).await.unwrap());
    assert!(!f.store.may_log(&of_failing).await.unwrap());
    assert!(!f.store.may_log(&of_attempt).await.unwrap());
    f.store.stopped(running.fence).await.unwrap();
    assert!(!f.store.may_log(&of(&[job])).await.unwrap());
}
