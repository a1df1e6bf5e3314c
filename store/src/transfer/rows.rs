//! Rows of any table, in a form that all databases share.

use sha2::{Digest as _, Sha256};

/// A table of a database, with its columns sorted by name.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    pub name: &'static str,
    pub columns: Vec<DatabaseColumn>,
}

#[derive(Clone, Debug)]
pub(crate) struct DatabaseColumn {
    pub name: String,
    pub kind: Kind,
}

/// How a database stores the values of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Integer,
    /// A boolean, which SQLite stores as an integer.
    Truth,
    Real,
    Text,
}

/// A value of a column, the same in every database. A boolean is 0 or 1.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Nothing,
    Integer(i64),
    Real(f64),
    Text(String),
}

/// Values in the order of their columns' names.
pub(crate) type Values = Vec<Value>;

/// A digest of rows that does not depend on their order. It is the sum of their SHA-256, as four
/// numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct RowsDigest {
    rows: u64,
    sum: [u64; 4],
}

impl Table {
    pub fn has(&self, column: &str) -> bool {
        self.columns.iter().any(|own| own.name == column)
    }

    /// The names of the columns, separated by commas.
    pub fn column_list(&self) -> String {
        let quoted: Vec<String> =
            self.columns.iter().map(|column| format!("\"{}\"", column.name)).collect();
        quoted.join(", ")
    }
}

impl Kind {
    /// The kind of a column with this type in SQLite or PostgreSQL.
    pub fn of_type(name: &str) -> Option<Self> {
        Some(match name {
            "INTEGER" | "bigint" => Self::Integer,
            "boolean" => Self::Truth,
            "REAL" | "double precision" => Self::Real,
            "TEXT" | "text" => Self::Text,
            _ => return None,
        })
    }
}

impl Value {
    /// Its approximate size in memory, in bytes.
    pub fn size(&self) -> usize {
        let text = if let Self::Text(text) = self { text.len() } else { 0 };
        size_of::<Self>() + text
    }

    pub const fn integer(&self) -> Option<i64> {
        if let Self::Integer(integer) = self { Some(*integer) } else { None }
    }

    pub fn truth(&self) -> Option<bool> {
        self.integer().map(|integer| integer != 0)
    }

    pub const fn real(&self) -> Option<f64> {
        if let Self::Real(real) = self { Some(*real) } else { None }
    }

    pub fn text(&self) -> Option<&str> {
        if let Self::Text(text) = self { Some(text) } else { None }
    }

    /// A floating-point value. NaN becomes NULL, as in SQLite.
    pub fn of_real(real: f64) -> Self {
        if real.is_nan() { Self::Nothing } else { Self::Real(real) }
    }

    fn digest(&self, digest: &mut Sha256) {
        match self {
            Self::Nothing => digest.update([0]),
            Self::Integer(integer) => {
                digest.update([1]);
                digest.update(integer.to_be_bytes());
            }
            Self::Real(real) => {
                digest.update([2]);
                // Not every database stores the sign of a zero.
                digest.update((real + 0.0).to_bits().to_be_bytes());
            }
            Self::Text(text) => {
                digest.update([3]);
                digest.update((text.len() as u64).to_be_bytes());
                digest.update(text);
            }
        }
    }
}

impl RowsDigest {
    pub fn add(&mut self, row: &[Value]) {
        let mut digest = Sha256::new();
        row.iter().for_each(|value| value.digest(&mut digest));
        for (sum, bytes) in self.sum.iter_mut().zip(digest.finalize().chunks_exact(8)) {
            let number = bytes.iter().fold(0, |number, byte| (number << 8) | u64::from(*byte));
            *sum = sum.wrapping_add(number);
        }
        self.rows += 1;
    }

    pub const fn rows(&self) -> u64 {
        self.rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn digest(rows: &[Values]) -> RowsDigest {
        let mut digest = RowsDigest::default();
        rows.iter().for_each(|row| digest.add(row));
        digest
    }

    #[test]
    fn a_digest_of_rows_knows_every_value_and_no_order() {
        let text = |text: &str| Value::Text(text.to_owned());
        let rows = [vec![Value::Integer(1), text("a")], vec![Value::Integer(2), Value::Nothing]];
        let [first, second] = rows.clone();
        assert_eq!(digest(&rows), digest(&[second.clone(), first.clone()]));
        let others = [
            vec![first.clone()],
            vec![first.clone(), second.clone(), second],
            vec![first.clone(), vec![Value::Integer(2), text("")]],
            vec![first, vec![Value::Real(2.0), Value::Nothing]],
            vec![vec![Value::Integer(2), text("a")], vec![Value::Integer(1), Value::Nothing]],
        ];
        for other in others {
            assert_ne!(digest(&rows), digest(&other), "{other:?}");
        }
        assert_ne!(digest(&[vec![text("ab"), text("c")]]), digest(&[vec![text("a"), text("bc")]]));
    }

    #[test]
    fn reals_are_those_that_every_database_has() {
        assert_eq!(Value::of_real(f64::NAN), Value::Nothing);
        assert_eq!(digest(&[vec![Value::of_real(-0.0)]]), digest(&[vec![Value::of_real(0.0)]]));
        assert_eq!(Value::of_real(f64::NEG_INFINITY), Value::Real(f64::NEG_INFINITY));
    }
}
