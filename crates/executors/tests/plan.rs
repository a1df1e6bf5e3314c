//! Laws of the plan, tested on worlds that obey it.

use std::collections::BTreeSet;
use std::time::Duration;

use executors::{Action, Bounds, KnownWorker, SETTLED_AFTER, WorkerState, plan};
use proptest::prelude::*;
use spec::Resources;
use store::Demand;

fn resources(cpus: u32, gpus: u32, tags: &[&str]) -> Resources {
    let tags: BTreeSet<String> = tags.iter().map(|&tag| tag.to_owned()).collect();
    Resources { cpus: Some(cpus), gpus, memory_gb: Some(1.0), tags }
}

/// Everything that tasks and workers of these tests ask for and have.
fn kinds() -> Vec<Resources> {
    vec![
        resources(1, 0, &[]),
        resources(8, 0, &[]),
        resources(1, 1, &[]),
        resources(1, 0, &["a"]),
        resources(4, 1, &["a", "b"]),
    ]
}

fn usual() -> Resources {
    resources(2, 0, &[])
}

fn demand() -> impl Strategy<Value = Vec<Demand>> {
    let waiting = prop_oneof![Just(0), 1_u64..4, Just(1000)];
    prop::collection::vec(waiting, 5).prop_map(|waiting| {
        let pairs = kinds().into_iter().zip(waiting);
        pairs.map(|(resources, waiting)| Demand { resources, waiting }).collect()
    })
}

fn state() -> impl Strategy<Value = WorkerState> {
    prop_oneof![
        Just(WorkerState::Pending(Duration::ZERO)),
        Just(WorkerState::Pending(SETTLED_AFTER)),
        Just(WorkerState::Idle),
        Just(WorkerState::Busy),
        Just(WorkerState::Ending),
    ]
}

fn workers() -> impl Strategy<Value = Vec<KnownWorker>> {
    let worker = (0..5_usize, state(), any::<bool>(), any::<bool>(), 0..10_u32);
    prop::collection::vec(worker, 0..12).prop_map(|drawn| {
        let named = drawn.into_iter().enumerate();
        let worker = |(index, (kind, state, is_ours, stays, age))| KnownWorker {
            name: format!("w{index}"),
            resources: usual().and(&kinds()[kind]),
            state,
            is_ours,
            stays: stays && is_ours && kind == 0,
            // A worker with a task does it to the end.
            claims_nothing: (age == 0 && state != WorkerState::Busy).then_some("it is drained"),
        };
        named.map(worker).collect()
    })
}

fn bounds() -> impl Strategy<Value = Bounds> {
    (0..4_usize, 0..12_usize).prop_map(|(min, more)| Bounds { min, max: min + more })
}

fn ours(workers: &[KnownWorker]) -> usize {
    workers.iter().filter(|worker| worker.is_ours).count()
}

/// Carries the plan out: requested workers wait for their place, and others end.
fn obey(workers: &mut Vec<KnownWorker>, actions: &[Action], count: &mut usize) {
    for action in actions {
        match action {
            Action::Ask { resources, stays } => {
                *count += 1;
                workers.push(KnownWorker {
                    name: format!("asked-{count}"),
                    resources: resources.clone(),
                    state: WorkerState::Pending(SETTLED_AFTER),
                    is_ours: true,
                    stays: *stays,
                    claims_nothing: None,
                });
            }
            Action::LetGo { worker, .. } => workers.retain(|known| known.name != *worker),
        }
    }
}

/// The world after the plan. For an unchanged demand, the plan has no more actions.
fn settled(demand: &[Demand], mut workers: Vec<KnownWorker>, bounds: Bounds) -> Vec<KnownWorker> {
    let mut count = 0;
    for _ in 0..100 {
        let actions = plan(demand, &workers, bounds, &usual());
        workers.retain(|worker| worker.state != WorkerState::Ending);
        if actions.is_empty() {
            return workers;
        }
        obey(&mut workers, &actions, &mut count);
    }
    panic!("the plan never ends: {demand:?} {workers:#?}");
}

proptest! {
    #[test]
    fn the_maximum_is_never_exceeded(
        demand in demand(), mut workers in workers(), bounds in bounds(),
    ) {
        let before = ours(&workers);
        let actions = plan(&demand, &workers, bounds, &usual());
        let asks = actions.iter().filter(|action| matches!(action, Action::Ask { .. })).count();
        prop_assert!(asks == 0 || before + asks <= bounds.max, "{actions:?}");
        workers.retain(|worker| worker.state != WorkerState::Ending);
        obey(&mut workers, &actions, &mut 0);
        prop_assert!(ours(&workers) <= bounds.max);
    }

    #[test]
    fn no_more_is_asked_for_than_waits_or_is_to_stay(
        demand in demand(), workers in workers(), bounds in bounds(),
    ) {
        let waiting: u64 = demand.iter().map(|demand| demand.waiting).sum();
        let actions = plan(&demand, &workers, bounds, &usual());
        let count = |wanted: bool| actions.iter().filter(|action| {
            matches!(action, Action::Ask { stays, .. } if *stays == wanted)
        }).count();
        prop_assert!(u64::try_from(count(false)).unwrap() <= waiting);
        prop_assert!(count(true) <= bounds.min);
        for action in &actions {
            let Action::Ask { resources, stays: false } = action else { continue };
            let covers_a_need = demand.iter().any(|demanded| {
                demanded.waiting > 0 && resources.cover(&demanded.resources)
            });
            prop_assert!(covers_a_need);
        }
    }

    #[test]
    fn a_plan_that_is_followed_comes_to_rest_and_serves_every_need(
        demand in demand(), workers in workers(), min in 0..3_usize, more in 0..3_usize,
    ) {
        // As many places as there are kinds of needs and of workers.
        let bounds = Bounds { min, max: min + 10 + more };
        let workers = settled(&demand, workers, bounds);
        for demand in demand.iter().filter(|demand| demand.waiting > 0) {
            let mut serving = workers.iter().filter(|worker| worker.claims_nothing.is_none());
            prop_assert!(
                serving.any(|worker| worker.resources.cover(&demand.resources)),
                "{demand:?} starves beside {workers:#?}"
            );
        }
        let stay = workers.iter().filter(|worker| worker.is_ours && worker.stays && worker.claims_nothing.is_none());
        prop_assert!(stay.count() >= min || ours(&workers) == bounds.max);
    }

    #[test]
    fn a_plan_that_is_followed_comes_to_rest_however_few_are_allowed(
        demand in demand(), workers in workers(), bounds in bounds(),
    ) {
        settled(&demand, workers, bounds);
    }

    #[test]
    fn nobody_is_let_go_who_has_a_task_unless_another_does_the_same_or_there_are_too_many(
        demand in demand(), workers in workers(), bounds in bounds(),
    ) {
        let actions = plan(&demand, &workers, bounds, &usual());
        let remaining = ours(&workers);
        for action in &actions {
            let Action::LetGo { worker, .. } = action else { continue };
            let worker = workers.iter().find(|known| known.name == *worker).unwrap();
            prop_assert!(worker.is_ours && worker.state != WorkerState::Ending);
            let has_like = workers.iter().any(|other| {
                other.name != worker.name && other.resources.cover(&worker.resources)
            });
            prop_assert!(
                worker.state != WorkerState::Busy || has_like || remaining > bounds.max,
                "{worker:?}"
            );
        }
    }
}

const FEW: Bounds = Bounds { min: 0, max: 2 };

fn worker(name: &str, resources: Resources, state: WorkerState) -> KnownWorker {
    KnownWorker {
        name: name.to_owned(),
        resources,
        state,
        is_ours: true,
        stays: false,
        claims_nothing: None,
    }
}

fn waiting(resources: Resources, waiting: u64) -> Vec<Demand> {
    vec![Demand { resources, waiting }]
}

fn ask(resources: Resources) -> Action {
    Action::Ask { resources, stays: false }
}

#[test]
fn a_waiting_task_is_worth_one_worker() {
    let task = kinds()[0].clone();
    assert_eq!(plan(&waiting(task.clone(), 1), &[], FEW, &usual()), [ask(usual())]);
    assert_eq!(plan(&waiting(task.clone(), 9), &[], FEW, &usual()), [ask(usual()), ask(usual())]);
    for state in [WorkerState::Pending(Duration::ZERO), WorkerState::Idle] {
        let one = [worker("w", usual(), state)];
        assert_eq!(plan(&waiting(task.clone(), 1), &one, FEW, &usual()), []);
    }
    let busy = [worker("w", usual(), WorkerState::Busy)];
    assert_eq!(plan(&waiting(task, 1), &busy, FEW, &usual()), [ask(usual())]);
}

#[test]
fn one_that_waits_for_its_place_is_let_go_once_nobody_has_waited_for_it_for_a_while() {
    let fresh = worker("w", usual(), WorkerState::Pending(Duration::ZERO));
    assert_eq!(plan(&[], &[fresh], FEW, &usual()), []);
    let settled = worker("w", usual(), WorkerState::Pending(SETTLED_AFTER));
    let actions = plan(&[], &[settled], FEW, &usual());
    assert!(matches!(&actions[..], [Action::LetGo { worker, .. }] if worker == "w"), "{actions:?}");
    let idle = worker("w", usual(), WorkerState::Idle);
    assert_eq!(plan(&[], &[idle], FEW, &usual()), []);
}

#[test]
fn at_the_maximum_a_need_that_nobody_covers_gets_the_place_of_a_worker_with_a_like() {
    let gpu = kinds()[2].clone();
    let mut demand = waiting(kinds()[0].clone(), 50);
    demand.extend(waiting(gpu.clone(), 1));
    let busy = |name: &str| worker(name, usual(), WorkerState::Busy);
    let actions = plan(&demand, &[busy("w1"), busy("w2")], FEW, &usual());
    assert!(matches!(&actions[..], [Action::LetGo { .. }]), "{actions:?}");
    // While one worker ends, no other is ended.
    let ending = worker("w1", usual(), WorkerState::Ending);
    assert_eq!(plan(&demand, &[ending, busy("w2")], FEW, &usual()), []);
    let with_gpu = usual().and(&gpu);
    assert_eq!(plan(&demand, &[busy("w2")], FEW, &usual()), [ask(with_gpu)]);
    // The last of its kind keeps running.
    let one = Bounds { min: 0, max: 1 };
    assert_eq!(plan(&demand, &[busy("w2")], one, &usual()), []);
}

#[test]
fn helpers_that_were_started_by_hand_serve_what_they_can() {
    let helper = KnownWorker { is_ours: false, ..worker("by-hand", usual(), WorkerState::Idle) };
    assert_eq!(
        plan(&waiting(kinds()[0].clone(), 1), std::slice::from_ref(&helper), FEW, &usual()),
        []
    );
    let actions = plan(&waiting(kinds()[2].clone(), 1), &[helper], FEW, &usual());
    assert_eq!(actions, [ask(usual().and(&kinds()[2]))]);
}

#[test]
fn those_that_claim_nothing_are_replaced() {
    let claims_nothing = Some("it is of another version");
    let old = KnownWorker { claims_nothing, ..worker("old", usual(), WorkerState::Idle) };
    let actions = plan(&waiting(kinds()[0].clone(), 1), &[old], FEW, &usual());
    assert!(
        matches!(&actions[..], [Action::Ask { .. }, Action::LetGo { worker, .. }] if worker == "old"),
        "{actions:?}"
    );
}
