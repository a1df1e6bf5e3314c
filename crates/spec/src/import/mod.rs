//! Imports: recordings that become a dataset like any other.

mod check;
mod columns;
mod elements;
mod kind;
mod spec;

pub use elements::list_elements;
pub use spec::{
    AngleUnit, CsvLayout, FileFormat, ImportColumns, ImportRanges, ImportSpec, ImportUnits,
    LowPassHz, McapMessages, NamedFile, NoLowPass, Resampling, Split, TimeUnit,
};
