//! The gradients of a batch: the sum over its micro-batches, in their order.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use burn::module::{ModuleMapper, Param};
use burn::tensor::{Gradients, Tensor};

use crate::ModelError;
use crate::optimizer::NamedGradients;
use crate::parameters::for_each_parameter;
use crate::sequence_model::SequenceModel;
use crate::single_threads::on_one_thread;

/// Loss and gradients of some micro-batches of a batch.
pub(crate) struct GradientSum {
    loss: f64,
    /// By parameter name, flattened.
    gradients: BTreeMap<String, Tensor<1>>,
}

impl GradientSum {
    /// Loss and gradients of one micro-batch. `model` is the one that computed them.
    pub fn of(model: &SequenceModel, loss: f64, mut gradients: Gradients) -> Self {
        let mut named = BTreeMap::new();
        for_each_parameter(model, |name, parameter| {
            if let Some(gradient) = parameter.gradient(&mut gradients) {
                named.insert(name, gradient);
            }
        });
        Self { loss, gradients: named }
    }

    /// A micro-batch whose loss is not finite, so that its gradients do not matter.
    pub fn without_gradients(loss: f64) -> Self {
        Self { loss, gradients: BTreeMap::new() }
    }

    pub fn loss(&self) -> f64 {
        self.loss
    }

    pub fn named(self) -> Result<NamedGradients, ModelError> {
        NamedGradients::new(self.gradients)
    }

    fn plus(mut self, other: Self) -> Self {
        self.loss += other.loss;
        for (name, gradient) in other.gradients {
            let sum = match self.gradients.remove(&name) {
                Some(sum) => sum + gradient,
                None => gradient,
            };
            self.gradients.insert(name, sum);
        }
        self
    }
}

/// Sums `part(model, index)` over the indexes below `count`, of which `at_once` are computed at the
/// same time. The sum does not depend on how many these are. An error is that of the first index
/// that has one.
///
/// Each thread computes with a model of its own, which shares the weights: burn keeps a lock on all
/// operations that follow from the same parameters while it computes gradients.
///
/// # Errors
/// Those of `part`.
pub(crate) fn over_micro_batches(
    model: &SequenceModel,
    count: usize,
    at_once: usize,
    part: impl Fn(&SequenceModel, usize) -> Result<GradientSum, ModelError> + Sync,
) -> Result<GradientSum, ModelError> {
    let models: Vec<SequenceModel> = match at_once.min(count) {
        0 | 1 => vec![model.clone()],
        several => (0..several).map(|_| model.clone().map(&mut OwnParameters)).collect(),
    };
    if let [model] = &models[..] {
        let mut sum = None;
        for index in 0..count {
            sum = Some(plus(sum, part(model, index)));
        }
        return sum.expect(NOT_EMPTY);
    }
    let next = AtomicUsize::new(0);
    let sum = InOrder::default();
    // If every thread has the same number of micro-batches, none could help another one.
    let is_even =
        at_once > 1 && at_once == rayon::current_num_threads() && count.is_multiple_of(at_once);
    rayon::scope(|scope| {
        for (place, model) in models.into_iter().enumerate() {
            let (next, sum, part) = (&next, &sum, &part);
            let work = move || {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        return;
                    }
                    sum.add(index, part(&model, index));
                }
            };
            scope.spawn(move |_| if is_even { on_one_thread(place, work) } else { work() });
        }
    });
    sum.total().expect(NOT_EMPTY)
}

const NOT_EMPTY: &str = "every batch has a micro-batch";

fn plus(sum: Option<Summand>, term: Summand) -> Summand {
    match (sum, term) {
        (None, term) => term,
        (Some(Ok(sum)), Ok(term)) => Ok(sum.plus(term)),
        (Some(Err(error)), _) | (Some(Ok(_)), Err(error)) => Err(error),
    }
}

/// Makes parameters with the same values, whose gradients are recorded apart.
struct OwnParameters;

impl ModuleMapper for OwnParameters {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|value| {
            let is_trained = value.is_require_grad();
            Tensor::from_inner(value.inner()).set_require_grad(is_trained)
        })
    }
}

type Summand = Result<GradientSum, ModelError>;

/// A sum whose terms arrive in any order and are added in the order of their indexes.
#[derive(Default)]
struct InOrder(Mutex<Arrived>);

#[derive(Default)]
struct Arrived {
    /// The sum so far. It is missing while a thread adds to it.
    sum: Option<Summand>,
    is_being_added_to: bool,
    /// Terms before this index are in the sum.
    next: usize,
    waiting: BTreeMap<usize, Summand>,
}

impl InOrder {
    /// Adds a term and those that waited for it. No thread waits for another one's addition.
    fn add(&self, index: usize, term: Summand) {
        let mut arrived = self.lock();
        arrived.waiting.insert(index, term);
        if arrived.is_being_added_to {
            return;
        }
        arrived.is_being_added_to = true;
        loop {
            let next = arrived.next;
            let Some(term) = arrived.waiting.remove(&next) else { break };
            arrived.next += 1;
            let sum = arrived.sum.take();
            // The addition may run other tasks of the pool meanwhile, so that it must not hold the
            // lock.
            drop(arrived);
            let sum = plus(sum, term);
            arrived = self.lock();
            arrived.sum = Some(sum);
        }
        arrived.is_being_added_to = false;
    }

    fn total(self) -> Option<Summand> {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner).sum
    }

    fn lock(&self) -> MutexGuard<'_, Arrived> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
