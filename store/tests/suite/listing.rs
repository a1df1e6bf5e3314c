use std::time::Duration;

use serde_json::json;
use store::{
    Direction, ItemKind, JobId, LabelChange, Labels, Listing, Metric, NewJob, Position, Retry,
    RunId, RunSummary, Sort, Submission, TextChange, Timestamp,
};
use wire::Listed as _;

use super::checkpoints::{commit, commit_measured};
use super::labels::{labels, naming, one_of_each, tagging};
use super::trash::{FORCED, work};
use super::{Fixture, alone, evaluate, pipeline, pipeline_of, simulate, train, with_execution};

/// The ids of a page, and the position of its end.
async fn page(f: &Fixture, item: ItemKind, listing: &Listing) -> (Vec<i64>, Option<Position>) {
    match item {
        ItemKind::Job => {
            let page = f.store.list_jobs(listing).await.unwrap();
            (page.items.iter().map(|item| item.id.0).collect(), page.end)
        }
        ItemKind::Run => {
            let page = f.store.list_runs(listing).await.unwrap();
            (page.items.iter().map(|item| item.id.0).collect(), page.end)
        }
        ItemKind::Dataset => {
            let page = f.store.list_datasets(listing).await.unwrap();
            (page.items.iter().map(|item| item.id.0).collect(), page.end)
        }
        ItemKind::Checkpoint => {
            let page = f.store.list_checkpoints(listing).await.unwrap();
            (page.items.iter().map(|item| item.id.0).collect(), page.end)
        }
    }
}

async fn jobs(f: &Fixture, listing: Listing) -> Vec<i64> {
    page(f, ItemKind::Job, &Listing { direction: Direction::Ascending, ..listing }).await.0
}

/// All ids, page by page.
async fn read_through(f: &Fixture, item: ItemKind, listing: &Listing) -> Vec<i64> {
    let (mut all, mut listing) = (Vec::new(), listing.clone());
    loop {
        let (ids, end) = page(f, item, &listing).await;
        assert!(end.is_none() || ids.len() == listing.limit as usize, "a page within is full");
        all.extend(ids);
        match end {
            Some(end) => listing.after = Some(end),
            None => return all,
        }
    }
}

async fn submitted(f: &Fixture, job: NewJob, labels: Labels) -> i64 {
    f.submit(Submission { labels, ..alone(job) }).await.job.0
}

pub async fn all_filters_hold_together(f: Fixture) {
    let [a, b] = [1, 2].map(|seed| train(&simulate(seed), vec![]));
    let first = submitted(&f, a, labels(Some("Fast one"), &["x", "y"])).await;
    let second = submitted(&f, b, labels(Some("Slow one"), &["x"])).await;
    let third = submitted(&f, simulate(3), labels(Some("fast data"), &["x", "y"])).await;
    let task = f.must_claim().await;
    f.store.fail(task.fence, "for a test", Retry::Never).await.unwrap();

    let tags = |tags: &[&str]| tags.iter().map(|tag| (*tag).to_owned()).collect::<Vec<_>>();
    let all = Listing::default;
    assert_eq!(jobs(&f, Listing { tags: tags(&["x"]), ..all() }).await, [first, second, third]);
    assert_eq!(jobs(&f, Listing { tags: tags(&["x", "y"]), ..all() }).await, [first, third]);
    assert!(jobs(&f, Listing { tags: tags(&["X"]), ..all() }).await.is_empty());
    let text = Some("FAST".to_owned());
    assert_eq!(jobs(&f, Listing { text: text.clone(), ..all() }).await, [first, third]);
    let kind = Some("train".to_owned());
    let failed = Some("failed".to_owned());
    assert_eq!(jobs(&f, Listing { state: failed.clone(), ..all() }).await, [first]);
    let fast = Listing { text, kind, tags: tags(&["y"]), ..all() };
    assert_eq!(jobs(&f, fast.clone()).await, [first]);
    assert_eq!(jobs(&f, Listing { state: failed, ..fast.clone() }).await, [first]);
    assert!(jobs(&f, Listing { state: Some("queued".to_owned()), ..fast }).await.is_empty());
    assert_eq!(jobs(&f, Listing { before: Some(second), ..all() }).await, [first]);

    let change = LabelChange { remove_tags: tags(&["x"]), ..LabelChange::default() };
    f.store.change_labels(ItemKind::Job, third, &change).await.unwrap();
    assert_eq!(jobs(&f, Listing { tags: tags(&["x"]), ..all() }).await, [first, second]);
}

pub async fn a_list_is_limited_to_a_span_of_time(f: Fixture) {
    let first = f.submit_one(simulate(1)).await;
    tokio::time::sleep(Duration::from_millis(5)).await;
    let second = f.submit_one(simulate(2)).await;
    let created = f.store.job(first).await.unwrap().created_at;
    let later = f.store.job(second).await.unwrap().created_at;
    let after = |moment: Timestamp| Some(Timestamp::from_milliseconds(moment.milliseconds() + 1));
    let all = Listing::default;
    assert_eq!(jobs(&f, Listing { since: Some(later), ..all() }).await, [second.0]);
    assert_eq!(jobs(&f, Listing { until: Some(later), ..all() }).await, [first.0]);
    assert_eq!(
        jobs(&f, Listing { since: Some(created), until: after(later), ..all() }).await,
        [first.0, second.0]
    );
    assert!(jobs(&f, Listing { since: after(later), ..all() }).await.is_empty());
    assert_eq!(
        page(&f, ItemKind::Dataset, &Listing { until: Some(later), ..all() }).await.0.len(),
        1
    );
}

pub async fn words_are_found_in_any_case_and_no_character_stands_for_others(f: Fixture) {
    let mut ids = Vec::new();
    for (seed, name) in (1..).zip(["ÄRGER 100%", "ärger_1", "ΟΔΟΣ", "a\\b'c\"", "İstanbul $1"])
    {
        ids.push(submitted(&f, simulate(seed), labels(Some(name), &[])).await);
    }
    let note = TextChange::Set("Line one\nLine TWO über alles".to_owned());
    let change = LabelChange { note, ..LabelChange::default() };
    f.store.change_labels(ItemKind::Job, ids[2], &change).await.unwrap();
    for (text, expected) in [
        ("ärger", &ids[..2]),
        ("ÄRGER", &ids[..2]),
        ("%", &ids[..1]),
        ("_", &ids[1..2]),
        ("ärger%", &ids[..0]),
        ("οδος", &ids[2..3]),
        ("Οσ", &ids[2..3]),
        ("Two ÜBER", &ids[2..3]),
        ("\\b'C\"", &ids[3..4]),
        ("$1", &ids[4..]),
        ("nowhere", &ids[..0]),
    ] {
        let found = jobs(&f, Listing { text: Some(text.to_owned()), ..Listing::default() }).await;
        assert_eq!(found, expected, "{text:?}");
    }
    // The name of its submission now belongs to another one.
    let of_spec = Listing { text: Some("train-set".to_owned()), ..Listing::default() };
    assert!(jobs(&f, of_spec.clone()).await.is_empty());
    let change = LabelChange { name: TextChange::Remove, ..LabelChange::default() };
    f.store.change_labels(ItemKind::Job, ids[0], &change).await.unwrap();
    assert_eq!(jobs(&f, of_spec).await, ids[..1]);
}

pub async fn a_run_a_dataset_and_a_checkpoint_are_found_by_what_their_job_is_called(f: Fixture) {
    let things = one_of_each(&f).await;
    let of_training = [things[1], things[3]];
    f.store.change_labels(ItemKind::Job, things[0].1, &naming("Big sweep")).await.unwrap();
    f.store.change_labels(ItemKind::Job, things[0].1, &tagging(&["sweep"])).await.unwrap();
    let tagged = Listing { tags: vec!["sweep".to_owned()], ..Listing::default() };
    let worded = Listing { text: Some("big SWEEP".to_owned()), ..Listing::default() };
    for (item, id) in of_training {
        assert_eq!(page(&f, item, &tagged).await.0, [id], "{item:?}");
        assert_eq!(page(&f, item, &worded).await.0, [id], "{item:?}");
    }
    assert!(page(&f, ItemKind::Dataset, &tagged).await.0.is_empty());
    for (item, id) in things {
        f.store.change_labels(item, id, &tagging(&["own"])).await.unwrap();
        let own = Listing { tags: vec!["own".to_owned()], ..Listing::default() };
        assert_eq!(page(&f, item, &own).await.0, [id], "{item:?}");
    }
    let training = f.store.job(JobId(things[0].1)).await.unwrap();
    let digest = training.digest.to_string();
    for (words, expected) in [(&digest[..8], 1), (&digest[1..9], 0), (&digest[..5], 0)] {
        let listing = Listing { text: Some(words.to_owned()), ..Listing::default() };
        for (item, id) in of_training {
            let found = page(&f, item, &listing).await.0;
            assert_eq!(found, vec![id; expected], "{item:?} {words}");
        }
    }
    let both = Listing { tags: vec!["own".to_owned(), "sweep".to_owned()], ..Listing::default() };
    assert_eq!(page(&f, ItemKind::Run, &both).await.0.len(), 1);
    assert!(page(&f, ItemKind::Dataset, &both).await.0.is_empty());
}

pub async fn a_pipeline_is_found_by_its_members_and_a_training_by_its_model(f: Fixture) {
    let mut training = train(&simulate(1), vec![]);
    training.spec = json!({"kind": "train", "model": {"architecture": "Robomorph-like"}});
    training.name = "Big-One".to_owned();
    let pipeline = f.submit(pipeline_of(vec![simulate(1), training])).await.job.0;
    let found = async |text: &str| {
        let listing = Listing { text: Some(text.to_owned()), ..Listing::default() };
        (jobs(&f, listing.clone()).await, page(&f, ItemKind::Run, &listing).await.0)
    };
    let (of_member, _) = found("big-one").await;
    assert!(of_member.contains(&pipeline), "{of_member:?}");
    let (of_model, runs) = found("architecture").await;
    assert_eq!((of_model.len(), runs.len()), (1, 1));
    assert!(!of_model.contains(&pipeline));
}

pub async fn every_order_reads_all_of_a_list_once_in_both_directions(f: Fixture) {
    for seed in 1..=4 {
        f.submit(pipeline(seed)).await;
    }
    // Some have equal names and priorities, and several trainings have equal steps.
    for seed in 5..=7 {
        f.submit_one(with_execution(simulate(seed), i32::try_from(seed % 2).unwrap() - 1, 3)).await;
    }
    for _ in 0..20 {
        let Some(task) = f.claim().await else { break };
        match task.kind.as_str() {
            "simulate" => {
                let shard = f.publish_shard(&task).await;
                f.store.commit_shard(task.fence, &shard, None).await.unwrap();
            }
            _ => {
                if task.kind == "train" {
                    commit(&f, &task, 100, false).await;
                    commit(&f, &task, 200, false).await;
                }
                f.store.complete(task.fence, None).await.unwrap();
            }
        }
    }
    let orders = [
        (ItemKind::Job, wire::Evaluation::LIST.sorts),
        (ItemKind::Run, wire::Run::LIST.sorts),
        (ItemKind::Dataset, wire::Dataset::LIST.sorts),
        (ItemKind::Checkpoint, wire::Checkpoint::LIST.sorts),
    ];
    for (item, sorts) in orders {
        let mut all = page(&f, item, &Listing { limit: 500, ..Listing::default() }).await.0;
        assert!(all.len() >= 4, "{item:?}: {all:?}");
        all.sort_unstable();
        for sort in sorts {
            let mut readings = Vec::new();
            for direction in [Direction::Ascending, Direction::Descending] {
                let whole = Listing { sort: *sort, direction, limit: 500, ..Listing::default() };
                let expected = page(&f, item, &whole).await.0;
                for limit in [1, 2, 3] {
                    let listing = Listing { limit, ..whole.clone() };
                    assert_eq!(
                        read_through(&f, item, &listing).await,
                        expected,
                        "{item:?} {sort:?} {limit}"
                    );
                }
                readings.push(expected);
            }
            readings[1].reverse();
            assert_eq!(readings[0], readings[1], "{item:?} {sort:?}: the other way round");
            readings[1].sort_unstable();
            assert_eq!(readings[1], all, "{item:?} {sort:?}: each once");
        }
    }
}

pub async fn orders_are_those_of_their_fields(f: Fixture) {
    let mut ids = Vec::new();
    for (seed, name) in (1..).zip(["b", "B", "ä", "a", "b"]) {
        let job = with_execution(simulate(seed), 3 - i32::try_from(seed).unwrap(), 3);
        ids.push(submitted(&f, job, labels(Some(name), &[])).await);
    }
    let order = async |sort: Sort| jobs(&f, Listing { sort, ..Listing::default() }).await;
    let at = |places: [usize; 5]| places.map(|place| ids[place]).to_vec();
    assert_eq!(order(Sort::Created).await, ids);
    assert_eq!(order(Sort::Name).await, at([1, 3, 0, 4, 2]));
    assert_eq!(order(Sort::Priority).await, at([4, 3, 2, 1, 0]));
    f.store.cancel(JobId(ids[3])).await.unwrap();
    tokio::time::sleep(Duration::from_millis(3)).await;
    f.store.cancel(JobId(ids[1])).await.unwrap();
    assert_eq!(order(Sort::Finished).await, at([3, 1, 0, 2, 4]));
}

/// The ids in the order of their errors, ascending and descending, as pages of every length give them.
async fn by_error(f: &Fixture, item: ItemKind, kind: &str) -> [Vec<i64>; 2] {
    let mut orders = [Vec::new(), Vec::new()];
    let directions = [Direction::Ascending, Direction::Descending];
    for (order, direction) in orders.iter_mut().zip(directions) {
        let kind = Some(kind.to_owned());
        let whole = Listing { kind, sort: Sort::Rmse, direction, ..Listing::default() };
        *order = page(f, item, &whole).await.0;
        for limit in [1, 2, 3] {
            let listing = Listing { limit, ..whole.clone() };
            assert_eq!(read_through(f, item, &listing).await, *order, "{item:?} {limit}");
        }
    }
    orders
}

pub async fn things_are_sorted_by_their_errors_and_those_without_one_come_last(f: Fixture) {
    // One has no error, and the error of another is not finite.
    let errors = [2.5, 0.1, f64::INFINITY, 0.1, f64::NAN, 1e-7];
    let (mut runs, mut checkpoints, mut evaluations) = (Vec::new(), Vec::new(), Vec::new());
    for (seed, error) in (1..).zip(errors) {
        let trained = train(&simulate(seed), vec![]);
        let training = f.submit_one(trained.clone()).await;
        let task = f.must_claim().await;
        let metric = Metric { key: "validation/rmse_deg".to_owned(), step: 100, value: error };
        f.store.record_metrics(task.fence, &[metric]).await.unwrap();
        runs.push(f.store.run_of_job(training).await.unwrap().id.0);
        let known = Some(error).filter(|error| error.is_finite());
        let metrics = known.map(|error| ("validation/rmse_deg".to_owned(), error));
        checkpoints.push(commit_measured(&f, &task, metrics.into_iter().collect()).await.0);
        f.store.complete(task.fence, None).await.unwrap();

        let evaluation = f.submit_one(evaluate(&simulate(seed), &trained, vec![])).await;
        evaluations.push(evaluation.0);
        while let Some(task) = f.claim().await {
            let best =
                json!([{"predictor": "a", "rmse_deg": known}, {"predictor": "b", "rmse_deg": 0.0}]);
            let result = json!({"headline": {"group": "g", "best": best}});
            let result = known.filter(|_| task.stage == 1).map(|_| &result);
            f.store.complete(task.fence, result).await.unwrap();
        }
    }
    let things = [
        (ItemKind::Run, "train", runs),
        (ItemKind::Checkpoint, "train", checkpoints),
        (ItemKind::Job, "evaluate", evaluations),
    ];
    for (item, kind, ids) in things {
        let [ascending, descending] = by_error(&f, item, kind).await;
        let at = |places: [usize; 6]| places.map(|place| ids[place]).to_vec();
        assert_eq!(ascending, at([5, 1, 3, 0, 2, 4]), "{item:?}");
        assert_eq!(descending, at([0, 3, 1, 5, 4, 2]), "{item:?}");
    }
}

/// Errors can be compared on the same data alone.
pub async fn lists_are_filtered_by_the_data_that_jobs_read(f: Fixture) {
    let mut datasets = Vec::new();
    let mut runs = Vec::new();
    for seed in [1, 2] {
        let data = simulate(seed);
        let made = f.submit_one(data.clone()).await;
        datasets.push(f.store.job(made).await.unwrap().dataset.unwrap());
        let training = f.submit_one(train(&data, vec![])).await;
        runs.push(f.store.run_of_job(training).await.unwrap().id.0);
    }
    for (data, run) in datasets.into_iter().zip(runs) {
        let listing = Listing { data: Some(data), ..Listing::default() };
        assert_eq!(page(&f, ItemKind::Run, &listing).await.0, [run]);
        assert_eq!(page(&f, ItemKind::Job, &listing).await.0.len(), 1, "the job that reads it");
        assert_eq!(page(&f, ItemKind::Checkpoint, &listing).await.0, [0; 0]);
    }
}

/// Rows that appear between two pages neither repeat nor hide others.
pub async fn rows_that_appear_meanwhile_change_no_page_behind(f: Fixture) {
    let mut seed = 0;
    for name in ["b", "m", "m", "y"] {
        seed += 1;
        submitted(&f, simulate(seed), labels(Some(name), &[])).await;
    }
    for sort in [Sort::Created, Sort::Name, Sort::Priority, Sort::Finished] {
        for direction in [Direction::Ascending, Direction::Descending] {
            let whole = Listing { sort, direction, limit: 500, ..Listing::default() };
            let before = page(&f, ItemKind::Job, &whole).await.0;
            let (mut seen, mut added) = (Vec::new(), 0);
            let mut listing = Listing { limit: 2, ..whole };
            loop {
                let (ids, end) = page(&f, ItemKind::Job, &listing).await;
                seen.extend(ids);
                seed += 1;
                let (name, priority) = if seed % 2 == 0 { ("a", -5) } else { ("z", 5) };
                if added < 12 {
                    added += 1;
                    let job = with_execution(simulate(seed), priority, 3);
                    submitted(&f, job, labels(Some(name), &[])).await;
                }
                match end {
                    Some(end) => listing.after = Some(end),
                    None => break,
                }
            }
            let old: Vec<i64> = seen.iter().copied().filter(|id| before.contains(id)).collect();
            assert_eq!(old, before, "{sort:?} {direction:?}");
            let mut once = seen.clone();
            once.sort_unstable();
            once.dedup();
            assert_eq!(once.len(), seen.len(), "{sort:?} {direction:?}: {seen:?}");
        }
    }
}

pub async fn summaries_are_those_of_all_runs_that_are_there(f: Fixture) {
    let mut runs = Vec::new();
    for seed in 1..=3 {
        let job = f.submit(alone(train(&simulate(seed), vec![]))).await.job;
        runs.push(f.store.run_of_job(job).await.unwrap());
    }
    work(&f).await;
    f.store.delete(runs[1].id.into(), &FORCED).await.unwrap();
    let all = f.store.list_runs(&Listing::default()).await.unwrap().items;
    let summaries = f.store.run_summaries().await.unwrap();
    assert_eq!(summaries, all.iter().map(RunSummary::from).collect::<Vec<_>>());
    assert_eq!(summaries.iter().map(|run| run.id).collect::<Vec<_>>(), [runs[2].id, runs[0].id]);
    let found = f.store.runs_with_ids(&[runs[2].id, RunId(1 << 40)]).await.unwrap();
    assert_eq!(found.iter().map(|run| run.id).collect::<Vec<_>>(), [runs[2].id]);
}
