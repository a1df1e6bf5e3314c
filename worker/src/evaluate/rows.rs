//! The result table as Parquet: one row per scenario, joint and predictor.

use std::collections::BTreeMap;
use std::sync::Arc;

use arrow_array::{
    Array, ArrayRef, Float32Array, Float64Array, Int32Array, Int64Array, RecordBatch, StringArray,
};
use arrow_schema::ArrowError;
use evaluation::{CellResult, ErrorHorizon, Measure, Row};
use serde_json::Value;
use spec::{Column, ColumnType};
use store::{TableReader, table_schema};

const PREDICTOR: &str = "predictor";

/// All columns, in order: first those that identify a row, then the measured values, and at last
/// the errors over the first parts of the horizon.
pub(super) fn columns(joints: usize, horizons_s: &[f64]) -> Vec<Column> {
    let nullable = |column: Column| Column { nullable: true, ..column };
    let about = [
        Column::new("cell", ColumnType::Int32, "number of the cell, from 0"),
        nullable(Column::new(
            "family",
            ColumnType::Text,
            "of the torques, such as chirp, or of the references, such as fourier",
        )),
        nullable(
            Column::new("frequency_hz", ColumnType::Float64, "master frequency of the cell")
                .unit("Hz"),
        ),
        Column::new(
            "position_noise_rad",
            ColumnType::Float64,
            "standard deviation of the noise that was added to the positions of the context",
        )
        .unit("rad"),
        Column::trajectory(),
        nullable(Column::new("seed", ColumnType::Int64, "of the simulation that made it")),
        Column::new(PREDICTOR, ColumnType::Text, "as the report calls it"),
        Column::new("joint", ColumnType::Int32, format!("1 to {joints}")),
    ];
    let measured = Measure::ALL.into_iter().map(|measure| {
        let column = Column::new(measure.name(), ColumnType::Float32, measure.about());
        let words = || measure.name().split('_');
        nullable(if words().any(|word| word == "deg") {
            column.unit("deg")
        } else if words().any(|word| word == "nm") {
            column.unit("N·m")
        } else {
            column
        })
    });
    let horizons = horizons_s.iter().map(|&seconds| {
        let about = format!("root mean square error over the first {seconds} s of the horizon");
        let name = ErrorHorizon::column(seconds);
        nullable(Column::new(&name, ColumnType::Float32, about).unit("deg"))
    });
    about.into_iter().chain(measured).chain(horizons).collect()
}

/// The file's metadata.
pub(super) fn footer(spec: &Value, joints: usize, horizons_s: &[f64]) -> BTreeMap<String, String> {
    let columns = serde_json::to_string(&columns(joints, horizons_s)).unwrap_or_default();
    BTreeMap::from([
        ("torqued.spec".to_owned(), spec.to_string()),
        ("torqued.columns".to_owned(), columns),
    ])
}

/// The rows of a cell, with columns for the errors over the first `horizons_s` of the horizon. They
/// are null where the cell does not have them.
pub(super) fn record_batch(
    result: &CellResult,
    horizons_s: &[f64],
    seed: Option<u64>,
) -> Result<RecordBatch, ArrowError> {
    let overflow = |value: &dyn std::fmt::Display| {
        ArrowError::ArithmeticOverflow(format!("{value} is too large for its column"))
    };
    let rows: Vec<Row<'_>> = result.rows().collect();
    let int = |value: u64| i32::try_from(value).map_err(|_| overflow(&value));
    let trajectories = rows.iter().map(|row| int(row.trajectory)).collect::<Result<Vec<_>, _>>()?;
    let joints = rows.iter().map(|row| int(row.joint as u64)).collect::<Result<Vec<_>, _>>()?;
    let seed = seed.map(i64::try_from).transpose().map_err(|error| overflow(&error))?;
    let count = rows.len();
    let family = result.family.map(|family| family.to_string());
    let mut arrays: Vec<ArrayRef> = vec![
        Arc::new(Int32Array::from(vec![int(result.cell as u64)?; count])),
        Arc::new(StringArray::from(vec![family; count])),
        Arc::new(Float64Array::from(vec![result.frequency_hz; count])),
        Arc::new(Float64Array::from(vec![result.position_noise_rad; count])),
        Arc::new(Int32Array::from(trajectories)),
        Arc::new(Int64Array::from(vec![seed; count])),
        Arc::new(StringArray::from_iter_values(rows.iter().map(|row| row.predictor))),
        Arc::new(Int32Array::from(joints)),
    ];
    arrays.extend(Measure::ALL.into_iter().map(|measure| {
        let values: Float32Array = rows.iter().map(|row| row.get(measure)).collect();
        Arc::new(values) as ArrayRef
    }));
    arrays.extend(horizons_s.iter().map(|seconds| {
        let place = result.horizons_s.iter().position(|measured| measured == seconds);
        let values: Float32Array = rows.iter().map(|row| row.horizon(place?)).collect();
        Arc::new(values) as ArrayRef
    }));
    RecordBatch::try_new(table_schema(&columns(result.joints, horizons_s)), arrays)
}

/// All rows of a table, in row groups.
pub(super) fn read(table: &TableReader) -> Result<Vec<RecordBatch>, store::StoreError> {
    let names = table.columns();
    (0..table.row_groups().count()).map(|group| table.read_row_group(group, &names)).collect()
}

/// Reads the errors of scenarios from the table into a result. The result is stored without them.
pub(super) fn complete(result: &mut CellResult, table: &[RecordBatch]) -> Result<(), ArrowError> {
    let (joints, horizons) = (result.joints.max(1), result.horizons_s.len());
    let mut rows = Vec::new();
    for batch in table {
        let predictors = column::<StringArray>(batch, PREDICTOR)?;
        let first = rows.len();
        let row = |k: usize| Row::empty(predictors.value(k), (first + k) % joints + 1, horizons);
        rows.extend((0..batch.num_rows()).map(row));
        for measure in Measure::ALL {
            if batch.column_by_name(measure.name()).is_none() {
                // The cell was evaluated by a version that did not measure this.
                continue;
            }
            let values = column::<Float32Array>(batch, measure.name())?;
            for (row, value) in rows[first..].iter_mut().zip(values) {
                row.set(measure, value);
            }
        }
        for (k, &seconds) in result.horizons_s.iter().enumerate() {
            let values = column::<Float32Array>(batch, &ErrorHorizon::column(seconds))?;
            for (row, value) in rows[first..].iter_mut().zip(values) {
                row.set_horizon(k, value);
            }
        }
    }
    if result.take_rows(&rows) {
        return Ok(());
    }
    let detail =
        format!("the table of cell {} does not have the rows of its predictors", result.cell);
    Err(ArrowError::InvalidArgumentError(detail))
}

fn column<'a, A: Array + 'static>(batch: &'a RecordBatch, name: &str) -> Result<&'a A, ArrowError> {
    let array = batch.column_by_name(name).and_then(|array| array.as_any().downcast_ref::<A>());
    array.ok_or_else(|| ArrowError::SchemaError(format!("the table has no such column {name}")))
}

#[cfg(test)]
mod tests {
    use evaluation::{HoldLast, Predictor, Scoring, evaluate_cell};
    use series::{Series, Shape};
    use spec::Family;
    use store::{ObjectWriter, TableWriter};

    use super::*;

    const JOINTS: usize = 7;

    fn result() -> CellResult {
        let y: Vec<f32> = (0..3 * 60 * JOINTS).map(|k| (0.01 * k as f32).sin()).collect();
        let shape = Shape { robots: 3, samples: 60, joints: JOINTS };
        let scenarios = Series::new(shape, 60.0, y.clone(), y).unwrap();
        let scoring = Scoring {
            pre_roll: 0,
            context: 20,
            samples: 1,
            band_edge_hz: Some(8.0),
            given: spec::Given::Torques,
            limits_rad: vec![spec::Range::new(-1.0, 1.0); JOINTS],
            horizons: ErrorHorizon::all(&[0.1, 0.5], 60.0, 40),
        };
        let predictors: [Box<dyn Predictor>; 1] = [Box::new(HoldLast)];
        CellResult {
            cell: 4,
            family: Some(Family::Chirp),
            frequency_hz: Some(0.3),
            position_noise_rad: 1e-3,
            first: 200,
            joints: JOINTS,
            horizons_s: vec![0.1, 0.5],
            predictors: evaluate_cell(&scenarios.view(), &scoring, &predictors),
            measured_jitter_deg: None,
            measured_left_limits: None,
            within_torque_limits: Vec::new(),
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_cell_reads_back_from_its_table() {
        let made = result();
        let folder = tempfile::tempdir().unwrap();
        let object = ObjectWriter::in_folder(folder.path(), "cell.parquet").unwrap();
        let batch = record_batch(&made, &made.horizons_s, Some(7)).unwrap();
        let footer = footer(&Value::Null, JOINTS, &made.horizons_s);
        let mut writer = TableWriter::table(object, batch.schema(), &footer).unwrap();
        writer.write(batch).unwrap();
        writer.finish().unwrap();

        let table = TableReader::open(&folder.path().join("cell.parquet")).unwrap();
        assert!(table.footer("torqued.columns").unwrap().contains("root mean square error"));
        let mut found = made.clone();
        found.predictors[0].scenarios.clear();
        complete(&mut found, &read(&table).unwrap()).unwrap();
        assert_eq!(found, made);
    }

    /// A cell that an earlier version evaluated lacks horizons, and stands in one table with others.
    #[test]
    fn horizons_that_a_cell_does_not_have_are_null() {
        let mut earlier = result();
        let horizons_s = std::mem::take(&mut earlier.horizons_s);
        let batch = record_batch(&earlier, &horizons_s, None).unwrap();
        let same = record_batch(&result(), &horizons_s, None).unwrap();
        assert_eq!(batch.schema(), same.schema());
        let nulls = |batch: &RecordBatch| batch["rmse_100_ms_deg"].null_count();
        assert_eq!((nulls(&batch), nulls(&same)), (batch.num_rows(), 0));
    }

    #[test]
    fn a_table_of_another_cell_is_refused() {
        let made = result();
        let batch = record_batch(&made, &made.horizons_s, None).unwrap();
        let mut other = made;
        other.predictors[0].predictor = "another".to_owned();
        assert!(complete(&mut other, &[batch]).is_err());
    }
}
