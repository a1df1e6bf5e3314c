//! The layout of tables in Parquet files.
//!
//! Trajectories have one row per time step: `trajectory` and `step`, then the channels. Floats are
//! split by byte and compressed with zstd at level 1. That took a set of 10 000 trajectories from
//! 224 to 168 MB, and wrote and read faster than every denser choice. The two id columns are
//! delta-encoded; otherwise they would add 29 %. Row groups hold whole trajectories, so training
//! shuffles row groups instead of seeking rows.

use std::collections::BTreeMap;
use std::sync::Arc;

use arrow_schema::{DataType, Field, Schema, SchemaRef};
use parquet::arrow::ArrowSchemaConverter;
use parquet::basic::{Compression, Encoding, Type, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use spec::{Column, ColumnType};

/// Column with the index of the trajectory in its dataset.
pub const TRAJECTORY: &str = "trajectory";
/// Column with the index of the sample in its trajectory.
pub const STEP: &str = "step";

const MAX_TRAJECTORIES_PER_ROW_GROUP: u32 = 500;

/// 500 trajectories of 400 samples: about 8 MB of 16 columns.
const ROWS_PER_ROW_GROUP: u32 = 200_000;

const PAGE_SIZE: usize = 64 * 1024;

/// It is part of a file's bytes, and so of its digest.
const CREATED_BY: &str = concat!("torqued version ", env!("CARGO_PKG_VERSION"));

/// The number of trajectories of `samples` samples per row group: 500, or fewer when they are long.
pub fn trajectories_per_row_group(samples: u32) -> u32 {
    (ROWS_PER_ROW_GROUP / samples.max(1)).clamp(1, MAX_TRAJECTORIES_PER_ROW_GROUP)
}

/// The schema of a table with these columns.
pub fn table_schema(columns: &[Column]) -> SchemaRef {
    let field = |column: &Column| {
        let data_type = match column.data_type {
            ColumnType::Boolean => DataType::Boolean,
            ColumnType::Int32 => DataType::Int32,
            ColumnType::Int64 => DataType::Int64,
            ColumnType::Float32 => DataType::Float32,
            ColumnType::Float64 => DataType::Float64,
            ColumnType::Text => DataType::Utf8,
        };
        Field::new(&column.name, data_type, column.nullable)
    };
    Arc::new(Schema::new(columns.iter().map(field).collect::<Vec<_>>()))
}

/// Writer properties that make a file's bytes depend only on its rows and `footer`.
pub(crate) fn writer_properties(
    schema: &Schema,
    rows_per_row_group: usize,
    footer: &BTreeMap<String, String>,
) -> Result<WriterProperties, ParquetError> {
    let footer = footer
        .iter()
        .map(|(key, value)| KeyValue::new(key.clone(), value.clone()))
        .collect::<Vec<_>>();
    let mut properties = WriterProperties::builder()
        .set_created_by(CREATED_BY.to_owned())
        .set_key_value_metadata(Some(footer))
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .set_dictionary_enabled(false)
        .set_data_page_size_limit(PAGE_SIZE)
        .set_max_row_group_row_count(Some(rows_per_row_group))
        .set_statistics_enabled(EnabledStatistics::None);
    for column in ArrowSchemaConverter::new().convert(schema)?.columns() {
        let path = column.path().clone();
        properties = match column.physical_type() {
            // Statistics of ids let readers skip to a trajectory. Statistics of floats help nobody.
            Type::INT32 | Type::INT64 => properties
                .set_column_encoding(path.clone(), Encoding::DELTA_BINARY_PACKED)
                .set_column_statistics_enabled(path, EnabledStatistics::Page),
            Type::FLOAT | Type::DOUBLE => {
                properties.set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT)
            }
            Type::BYTE_ARRAY => {
                properties.set_column_encoding(path, Encoding::DELTA_LENGTH_BYTE_ARRAY)
            }
            Type::BOOLEAN | Type::INT96 | Type::FIXED_LEN_BYTE_ARRAY => {
                properties.set_column_encoding(path, Encoding::PLAIN)
            }
        };
    }
    Ok(properties.build())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_groups_hold_500_trajectories_or_as_many_as_fit() {
        assert_eq!(trajectories_per_row_group(400), 500);
        assert_eq!(trajectories_per_row_group(50), 500);
        assert_eq!(trajectories_per_row_group(10_000), 20);
        assert_eq!(trajectories_per_row_group(1_000_000), 1);
    }
}
