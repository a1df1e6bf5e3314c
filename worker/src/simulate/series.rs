//! The table of series: one row per time step.

use std::sync::Arc;

use arrow_array::{ArrayRef, Float32Array, Int32Array, RecordBatch};
use arrow_schema::ArrowError;
use arrow_schema::SchemaRef;
use dynamics::Trajectories;
use rayon::prelude::*;

/// Number of values of a pose.
const POSE: usize = 7;

/// The rows of `simulated`, with the columns of `schema`, which the spec asks for.
pub(super) fn record_batch(
    schema: &SchemaRef,
    simulated: &Trajectories,
) -> Result<RecordBatch, ArrowError> {
    let mut columns = ids(simulated)?.to_vec();
    let joints = simulated.series.joints();
    let series = &simulated.series;
    let measured = |prefix: &str, values| {
        schema.field_with_name(&format!("{prefix}1")).is_ok().then_some(values)
    };
    let recorded = [
        (Some(series.true_u()), joints),
        (Some(series.true_y()), joints),
        (simulated.qd.as_deref(), joints),
        (simulated.end_effector.as_deref(), POSE),
        (measured("u_measured", series.u()), joints),
        (measured("q_measured", series.y()), joints),
        (simulated.reference.as_deref(), joints),
    ];
    for (series, width) in recorded {
        let Some(series) = series else { continue };
        columns.par_extend((0..width).into_par_iter().map(|place| column(series, width, place)));
    }
    RecordBatch::try_new(Arc::clone(schema), columns)
}

/// The columns `trajectory` and `step`.
fn ids(simulated: &Trajectories) -> Result<[ArrayRef; 2], ArrowError> {
    let (robots, steps) = (simulated.series.robots(), simulated.series.samples());
    let id = |value: u64| {
        i32::try_from(value).map_err(|_| ArrowError::ArithmeticOverflow(format!("id {value}")))
    };
    let numbers = (0..steps as u64).map(id).collect::<Result<Vec<_>, _>>()?;
    let mut trajectory = Vec::with_capacity(robots * steps);
    let mut step = Vec::with_capacity(robots * steps);
    for (index, _) in (simulated.first..).zip(0..robots) {
        trajectory.resize(trajectory.len() + steps, id(index)?);
        step.extend_from_slice(&numbers);
    }
    Ok([trajectory, step].map(|ids| Arc::new(Int32Array::from(ids)) as ArrayRef))
}

/// One column of a series with the shape `[.., width]`.
fn column(series: &[f32], width: usize, place: usize) -> ArrayRef {
    let samples = series.chunks_exact(width);
    let values: Vec<f32> = samples.map(|sample| sample[place]).collect();
    Arc::new(Float32Array::from(values))
}
