//! Names of elements of lists: `state[2]`, and ranges such as `state[0:6]`, as in NumPy.

use std::ops::Range;

use super::spec::{ImportColumns, ImportSpec};

/// The list and the elements that a name such as `state[2]`, `state[0:6]` or `state[:6]` states.
/// `None` for every other name.
pub fn list_elements(name: &str) -> Option<(&str, Range<usize>)> {
    let (list, index) = name.trim().strip_suffix(']')?.rsplit_once('[')?;
    let number = |text: &str| -> Option<usize> {
        text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok())?
    };
    let elements = match index.split_once(':') {
        None => {
            let element = number(index)?;
            element..element.checked_add(1)?
        }
        Some(("", end)) => 0..number(end)?,
        Some((start, end)) => number(start)?..number(end)?,
    };
    (!list.trim().is_empty() && !elements.is_empty()).then_some((list, elements))
}

impl ImportSpec {
    /// The columns with a name for each joint. Those of a column of lists are its elements, such as
    /// `action[0]`.
    pub fn joint_columns(&self) -> ImportColumns {
        let joints = self.joints();
        let of_joints = |names: &[String]| match names {
            [only] if joints > 1 => {
                let range = list_elements(only).filter(|(_, elements)| elements.len() == joints);
                let (list, elements) = range.unwrap_or((only, 0..joints));
                elements.map(|element| format!("{list}[{element}]")).collect()
            }
            names => names.to_vec(),
        };
        let ImportColumns { u, q, qd, .. } = &self.columns;
        ImportColumns {
            u: of_joints(u),
            q: of_joints(q),
            qd: qd.as_deref().map(of_joints),
            ..self.columns.clone()
        }
    }

    /// Whether a quantity, `u`, `q` or `qd`, has one column for all joints.
    pub fn has_one_column(&self, quantity: &str) -> bool {
        let names = match quantity {
            "u" => Some(&self.columns.u),
            "q" => Some(&self.columns.q),
            "qd" => self.columns.qd.as_ref(),
            _ => None,
        };
        names.is_some_and(|names| names.len() == 1)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn elements_are_named_as_in_numpy() {
        assert_eq!(list_elements("state[2]"), Some(("state", 2..3)));
        assert_eq!(list_elements(" a[0][1:6] "), Some(("a[0]", 1..6)));
        assert_eq!(list_elements("state[:6]"), Some(("state", 0..6)));
        for other in [
            "state",
            "state[]",
            "[2]",
            "state[2",
            "state[-1]",
            "state[+1]",
            "state[3:3]",
            "state[4:]",
            "state[0:6:2]",
            "state[x]",
            "state[99999999999999999999]",
        ] {
            assert_eq!(list_elements(other), None, "{other}");
        }
    }

    #[test]
    fn a_range_is_named_by_its_elements() {
        let names = |u: &str, q: &str| {
            let spec = json!({
                "file": "0".repeat(64), "format": "parquet", "columns": {"u": [u], "q": [q]},
            });
            let spec: ImportSpec = serde_json::from_value(spec).unwrap();
            let ImportColumns { u, q, .. } = spec.joint_columns();
            (u[0].clone(), u[6].clone(), q[0].clone(), q.len())
        };
        let of = |u: &str, q: &str| (format!("{u}[0]"), format!("{u}[6]"), q.to_owned(), 7);
        assert_eq!(names("u", "state[3:10]"), of("u", "state[3]"));
        // Another number of elements is refused where the file is read.
        assert_eq!(names("u", "state[3:9]"), of("u", "state[3:9][0]"));
    }
}
