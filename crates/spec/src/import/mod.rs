//! Imports: recordings that become a dataset like any other.

mod check;
mod columns;
mod kind;
mod spec;

pub use spec::{
    AngleUnit, CsvLayout, FileFormat, ImportColumns, ImportRanges, ImportSpec, ImportUnits,
    LowPassHz, McapMessages, NamedFile, NoLowPass, Resampling, Split, TimeUnit,
};
