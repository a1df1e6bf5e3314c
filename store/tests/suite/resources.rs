use spec::Resources;
use store::{Demand, Wait};

use super::workers::worker;
use super::{Fixture, asking, beginning, resources, simulate, train};

pub async fn a_worker_gets_only_what_its_offer_covers(f: Fixture) {
    let memory = |memory_gb| Resources { memory_gb: Some(memory_gb), ..Resources::default() };
    let tags = resources(2, 1, &["a100", "lab-3"]);
    for (seed, asked, too_little, more) in [
        (1, resources(8, 0, &[]), resources(7, 64, &["a100"]), resources(9, 0, &[])),
        (2, resources(0, 1, &[]), resources(1024, 0, &["gpu"]), resources(1, 1, &["gpu"])),
        (3, memory(16.1), memory(16.0), memory(1000.0)),
        (4, tags.clone(), resources(2, 1, &["a100"]), resources(2, 1, &["a100", "cuda", "lab-3"])),
        (5, tags.clone(), resources(2, 0, &["a100", "lab-3"]), tags.clone()),
    ] {
        let job = f.submit_one(asking(train(&simulate(seed), vec![]), asked.clone())).await;
        assert!(f.claim().await.is_none(), "{asked}");
        assert!(f.claim_with(&too_little).await.is_none(), "{asked}, not {too_little}");
        assert_eq!(f.claim_with(&more).await.unwrap().job, job, "{asked}");
    }
}

pub async fn a_worker_takes_the_first_in_line_of_all_that_it_can_take(f: Fixture) {
    let gpu = resources(0, 1, &[]);
    let mut jobs = Vec::new();
    for (seed, asked) in
        [(1, &gpu), (2, &Resources::default()), (3, &gpu), (4, &resources(4, 0, &[]))]
    {
        jobs.push(f.submit_one(asking(train(&simulate(seed), vec![]), asked.clone())).await);
    }
    let offer = resources(4, 1, &["lab-3"]);
    for job in jobs {
        assert_eq!(f.claim_with(&offer).await.unwrap().job, job);
    }
}

pub async fn a_task_that_was_given_back_asks_for_the_same(f: Fixture) {
    let gpu = resources(0, 1, &[]);
    let job = f.submit_one(asking(simulate(1), gpu.clone())).await;
    assert_eq!(f.store.job(job).await.unwrap().execution.resources, gpu);
    assert!(f.claim().await.is_none());
    for _ in 0..3 {
        let task = f.claim_with(&gpu).await.unwrap();
        f.store.release(task.fence).await.unwrap();
        assert!(f.claim().await.is_none(), "also when it was given back");
        let task = f.claim_with(&gpu).await.unwrap();
        f.store.complete(task.fence, None).await.unwrap();
    }
    assert!(f.claim_with(&gpu).await.is_none());
}

pub async fn demand_is_counted_by_what_tasks_ask_for(f: Fixture) {
    assert_eq!(f.store.demand().await.unwrap(), []);
    let gpu = resources(0, 1, &["a100"]);
    let now = f.store.now().await.unwrap();
    f.submit_one(asking(simulate(1), gpu.clone())).await;
    f.submit_one(simulate(2)).await;
    f.submit_one(asking(train(&simulate(3), vec![]), gpu.clone())).await;
    f.submit_one(beginning(asking(simulate(4), gpu.clone()), now, 1)).await;
    let demand = |resources: &Resources, waiting| Demand { resources: resources.clone(), waiting };
    let nothing = Resources::default();
    assert_eq!(f.store.demand().await.unwrap(), [demand(&gpu, 4), demand(&nothing, 3)]);
    for _ in 0..3 {
        f.claim_with(&gpu).await.unwrap();
    }
    assert_eq!(f.store.demand().await.unwrap(), [demand(&nothing, 3), demand(&gpu, 1)]);
    f.store.pause_queue().await.unwrap();
    assert_eq!(f.store.demand().await.unwrap(), []);
}

pub async fn a_job_that_no_living_worker_can_take_says_so(f: Fixture) {
    let gpu = resources(0, 1, &[]);
    let asks = f.submit_one(asking(simulate(1), gpu.clone())).await;
    let asks_for_nothing = f.submit_one(simulate(2)).await;
    let both = [asks, asks_for_nothing];
    let waits = |wait: Option<Wait>| wait.map(|wait| (asks, wait)).into_iter().collect();
    let unoffered = Wait::Unoffered(gpu.clone());
    assert_eq!(f.store.waits(&both).await.unwrap(), waits(Some(unoffered.clone())));

    let mut process = worker("w1", 1);
    f.store.register_worker(&process).await.unwrap();
    assert_eq!(f.store.waits(&both).await.unwrap(), waits(Some(unoffered.clone())));
    assert_eq!(f.store.why_all_wait().await.unwrap(), None, "one can be taken");
    f.store.cancel(asks_for_nothing).await.unwrap();
    assert_eq!(f.store.why_all_wait().await.unwrap(), Some(unoffered));

    process.offers = gpu.clone();
    f.store.register_worker(&process).await.unwrap();
    assert_eq!(f.store.waits(&both).await.unwrap(), waits(None));
    assert_eq!(f.store.why_all_wait().await.unwrap(), None);

    f.store.drain_worker("w1").await.unwrap();
    let drained = Wait::Drained { resources: gpu.clone(), workers: vec!["w1".to_owned()] };
    assert_eq!(f.store.waits(&both).await.unwrap(), waits(Some(drained.clone())));
    assert_eq!(f.store.why_all_wait().await.unwrap(), Some(drained));

    // A job whose tasks are all with workers waits for no worker.
    f.store.undrain_worker("w1").await.unwrap();
    for _ in 0..3 {
        f.claim_with(&gpu).await.unwrap();
    }
    f.store.forget_worker(&process).await.unwrap();
    assert_eq!(f.store.waits(&both).await.unwrap(), waits(None));
}
