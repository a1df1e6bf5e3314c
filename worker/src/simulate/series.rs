//! The table of series: one row per time step.

use std::sync::Arc;

use arrow::array::{ArrayRef, Float32Array, Int32Array, RecordBatch};
use arrow::datatypes::SchemaRef;
use arrow::error::ArrowError;
use dynamics::Trajectories;
use rayon::prelude::*;
use spec::JOINTS;

/// Columns of the joints' torques, N·m.
pub(crate) const TORQUES: [&str; JOINTS] = ["u1", "u2", "u3", "u4", "u5", "u6", "u7"];
/// Columns of the joints' positions, rad.
pub(crate) const POSITIONS: [&str; JOINTS] = ["q1", "q2", "q3", "q4", "q5", "q6", "q7"];

/// Numbers of a pose: as many as there are joints, so that all series lie alike.
const WIDTH: usize = JOINTS;

/// The rows of `simulated`, with the columns of `schema`: those that its spec asks for.
pub(super) fn record_batch(
    schema: &SchemaRef,
    simulated: &Trajectories,
) -> Result<RecordBatch, ArrowError> {
    let mut columns = ids(simulated)?.to_vec();
    let recorded = [Some(&simulated.u), Some(&simulated.q)].into_iter();
    let recorded = recorded.chain([simulated.qd.as_ref(), simulated.end_effector.as_ref()]);
    for series in recorded.flatten() {
        columns.par_extend((0..WIDTH).into_par_iter().map(|place| column(series, place)));
    }
    RecordBatch::try_new(Arc::clone(schema), columns)
}

/// `trajectory` and `step`.
fn ids(simulated: &Trajectories) -> Result<[ArrayRef; 2], ArrowError> {
    let steps = simulated.samples;
    let id = |value: u64| {
        i32::try_from(value).map_err(|_| ArrowError::ArithmeticOverflow(format!("id {value}")))
    };
    let numbers = (0..steps as u64).map(id).collect::<Result<Vec<_>, _>>()?;
    let mut trajectory = Vec::with_capacity(simulated.count * steps);
    let mut step = Vec::with_capacity(simulated.count * steps);
    for (index, _) in (simulated.first..).zip(0..simulated.count) {
        trajectory.resize(trajectory.len() + steps, id(index)?);
        step.extend_from_slice(&numbers);
    }
    Ok([trajectory, step].map(|ids| Arc::new(Int32Array::from(ids)) as ArrayRef))
}

/// One of the seven columns of `[.., 7]`.
fn column(series: &[f32], place: usize) -> ArrayRef {
    let samples = series.as_chunks::<WIDTH>().0;
    let values: Vec<f32> = samples.iter().map(|sample| sample[place]).collect();
    Arc::new(Float32Array::from(values))
}
