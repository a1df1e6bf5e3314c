//! The table of series: one row per time step.

use std::sync::Arc;

use arrow::array::{ArrayRef, Float32Array, Int32Array, RecordBatch};
use arrow::error::ArrowError;
use dynamics::Trajectories;
use spec::JOINTS;

/// Columns of the joints' torques, N·m.
pub(crate) const TORQUES: [&str; JOINTS] = ["u1", "u2", "u3", "u4", "u5", "u6", "u7"];
/// Columns of the joints' positions, rad.
pub(crate) const POSITIONS: [&str; JOINTS] = ["q1", "q2", "q3", "q4", "q5", "q6", "q7"];

/// Columns `trajectory`, `step`, `u1` to `u7`, `q1` to `q7`.
pub(super) fn record_batch(simulated: &Trajectories) -> Result<RecordBatch, ArrowError> {
    let steps = simulated.samples;
    let id = |value: u64| {
        i32::try_from(value).map_err(|_| ArrowError::ArithmeticOverflow(format!("id {value}")))
    };
    let mut trajectory = Vec::with_capacity(simulated.count * steps);
    let mut step = Vec::with_capacity(simulated.count * steps);
    for (index, _) in (simulated.first..).zip(0..simulated.count) {
        trajectory.extend(std::iter::repeat_n(id(index)?, steps));
        for k in 0..steps as u64 {
            step.push(id(k)?);
        }
    }
    let ids = [trajectory, step].map(|ids| Arc::new(Int32Array::from(ids)) as ArrayRef);
    let channels = [&simulated.u, &simulated.q].into_iter().flat_map(|series| channels(series));
    let columns = ids.into_iter().chain(channels).collect();
    RecordBatch::try_new(store::trajectory_schema(TORQUES.into_iter().chain(POSITIONS)), columns)
}

/// `[.., 7]` as seven columns.
fn channels(series: &[f32]) -> [ArrayRef; JOINTS] {
    let samples = series.as_chunks::<JOINTS>().0;
    std::array::from_fn(|joint| {
        Arc::new(samples.iter().map(|sample| Some(sample[joint])).collect::<Float32Array>())
            as ArrayRef
    })
}
