//! Counts the operations of an evaluation of the forward dynamics, for `examples/rates.rs`.

use std::cell::RefCell;
use std::ops::{Add, Mul, Neg, Sub};

use simd::{Exponential, F64Array, Lanes, MAX_LANES, Trigonometry};

use crate::Robot;
use crate::compiled::Compiled;
use crate::integrators::{Scheme, Scratch, State, advance};
use crate::model::Model;

/// Evaluations of a step of Runge-Kutta.
const EVALUATIONS: usize = 4;

/// A number that remembers which operation made it.
#[derive(Clone, Copy)]
struct Recorded {
    value: F64Array<1>,
    /// Position in [`OPERATIONS`]; `None` for an input.
    made_by: Option<usize>,
}

thread_local! {
    /// The operands of every operation so far, as the operations that made them.
    static OPERATIONS: RefCell<Vec<[Option<usize>; 3]>> = const { RefCell::new(Vec::new()) };
}

impl Recorded {
    fn given(value: F64Array<1>) -> Self {
        Self { value, made_by: None }
    }

    fn made<const N: usize>(value: F64Array<1>, operands: [Self; N]) -> Self {
        let mut made_by = [None; 3];
        for (place, operand) in made_by.iter_mut().zip(operands) {
            *place = operand.made_by;
        }
        let index = OPERATIONS.with_borrow_mut(|operations| {
            operations.push(made_by);
            operations.len() - 1
        });
        Self { value, made_by: Some(index) }
    }
}

/// Vector operations per evaluation of the compiled structure without friction: additions,
/// products, fused multiply-adds and reciprocals on which the new state depends. They include a
/// fourth of the operations that a step of Runge-Kutta adds to its four evaluations.
fn operations_per_evaluation() -> f64 {
    OPERATIONS.with_borrow_mut(Vec::clear);
    let zero = [Recorded::splat(0.0); 7];
    let model = Model::splat(Compiled, &Robot::panda());
    let mut state = State { q: zero, q_remainder: zero, qd: zero, qdd: zero };
    let mut scratch = Scratch::new();
    let scheme = Scheme::Rk4 { substeps: 1 };
    advance(Compiled, scheme, 1.0, &model, &zero, &mut state, &mut scratch);

    let results = [state.q, state.q_remainder, state.qd];
    let mut open: Vec<usize> =
        results.iter().flatten().filter_map(|result| result.made_by).collect();
    let operations = OPERATIONS.take();
    let mut needed = vec![false; operations.len()];
    while let Some(operation) = open.pop() {
        if !needed[operation] {
            needed[operation] = true;
            open.extend(operations[operation].into_iter().flatten());
        }
    }
    let count = needed.iter().filter(|needed| **needed).count();
    count as f64 / EVALUATIONS as f64
}

impl Add for Recorded {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::made(self.value + other.value, [self, other])
    }
}

impl Sub for Recorded {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::made(self.value - other.value, [self, other])
    }
}

impl Mul for Recorded {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self::made(self.value * other.value, [self, other])
    }
}

/// Negation does not count as an operation, since most are part of a multiply-add.
impl Neg for Recorded {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, ..self }
    }
}

impl Lanes for Recorded {
    const LANES: usize = 1;
    const TRIGONOMETRY: Trigonometry = simd::F32Array::<1>::TRIGONOMETRY;
    const EXPONENTIAL: Exponential = simd::F32Array::<1>::EXPONENTIAL;
    type Double = F64Array<1>;

    fn splat(value: f64) -> Self {
        Self::given(F64Array::splat(value))
    }

    fn mul_add(self, b: Self, c: Self) -> Self {
        Self::made(self.value.mul_add(b.value, c.value), [self, b, c])
    }

    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        Self::made(self.value.neg_mul_add(b.value, c.value), [self, b, c])
    }

    fn recip(self) -> Self {
        Self::made(self.value.recip(), [self])
    }

    fn max(self, other: Self) -> Self {
        Self::made(Lanes::max(self.value, other.value), [self, other])
    }

    fn turn_by_quadrant(_: Self, sin: Self, cos: Self) -> (Self, Self) {
        (sin, cos)
    }

    fn doubled(self, _: Self) -> Self {
        self
    }

    fn lane(&self, lane: usize) -> f64 {
        self.value.lane(lane)
    }

    fn set_lane(&mut self, _: usize, value: f64) {
        *self = Self::splat(value);
    }

    fn load(values: &[f32; MAX_LANES]) -> Self {
        Self::given(F64Array::load(values))
    }

    fn store(self, values: &mut [f32; MAX_LANES]) {
        self.value.store(values);
    }
}

#[test]
fn only_operations_that_a_result_depends_on_count() {
    let [a, b] = [1.0, 2.0].map(Recorded::splat);
    OPERATIONS.with_borrow_mut(Vec::clear);
    let sum = a + b;
    let _unused = a * b;
    assert_eq!(sum.mul_add(b, a).made_by, Some(2));
    assert_eq!(OPERATIONS.with_borrow(Vec::len), 3);
    // Counted by hand: 699 for the mass matrix and bias forces, 133 for the solution, 14 for each
    // of six turns, 7 for each joint in the integrator.
    assert!((900.0..1100.0).contains(&operations_per_evaluation()));
}

/// `examples/rates.rs` reports this number.
#[test]
fn an_evaluation_has_as_many_operations_as_the_example_reports() {
    assert_eq!(operations_per_evaluation(), 1018.5);
}
