//! Imports: recordings that become a dataset like any other.

mod check;
mod columns;
mod kind;
mod spec;

pub use spec::{
    AngleUnit, FileFormat, ImportColumns, ImportRanges, ImportSpec, ImportUnits, Resampling, Split,
    TimeUnit,
};
