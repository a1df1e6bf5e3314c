//! The columns of an imported dataset's two tables.

use super::spec::ImportSpec;
use crate::{Column, ColumnType};

impl ImportSpec {
    /// Columns of the table with one row per time step.
    pub fn trajectory_columns(&self) -> Vec<Column> {
        let joints = self.joints();
        let mut columns = vec![Column::trajectory(), Column::step()];
        columns.extend(Column::torques(joints).chain(Column::positions(joints)));
        if self.columns.qd.is_some() {
            columns.extend(Column::velocities(joints));
        }
        columns
    }

    /// Columns of the table with one row per trajectory, which say where in the file it comes from.
    pub fn table_columns(&self) -> Vec<Column> {
        vec![
            Column::trajectory(),
            Column::new(
                "recording",
                ColumnType::Text,
                "name of its recording in the file; empty when the file names none",
            ),
            Column::new(
                "first_time_s",
                ColumnType::Float64,
                "time of its first sample in the file",
            )
            .unit("s"),
            Column::new(
                "first_row",
                ColumnType::Int64,
                "row of the file at or before its first sample",
            ),
        ]
    }
}
