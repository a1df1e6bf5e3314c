//! The order of search results: `metrics.loss ASC`, then `attributes.start_time DESC`.

use std::cmp::Ordering;

use super::{Attribute, Datum, Field, MlflowError};

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Order {
    pub field: Field,
    is_descending: bool,
}

impl Order {
    pub const fn descending(attribute: Attribute) -> Self {
        Self { field: Field::Attribute(attribute), is_descending: true }
    }

    pub const fn ascending(attribute: Attribute) -> Self {
        Self { field: Field::Attribute(attribute), is_descending: false }
    }

    /// Reads one item of `order_by`. `attributes` are the allowed ones.
    pub fn parse(text: &str, attributes: &[Attribute]) -> Result<Self, MlflowError> {
        let text = text.trim();
        let split = text.rsplit_once(char::is_whitespace);
        let (field, is_descending) = match split {
            Some((field, direction)) if direction.eq_ignore_ascii_case("desc") => (field, true),
            Some((field, direction)) if direction.eq_ignore_ascii_case("asc") => (field, false),
            _ => (text, false),
        };
        Ok(Self { field: Field::parse(field.trim(), attributes)?, is_descending })
    }

    /// Compares two values. In either direction NaN comes after numbers, and a missing value comes
    /// last.
    pub fn compare(&self, a: Option<Datum<'_>>, b: Option<Datum<'_>>) -> Ordering {
        let rank = |datum: &Option<Datum<'_>>| match datum {
            None => 2,
            Some(Datum::Number(number)) if number.is_nan() => 1,
            Some(_) => 0,
        };
        rank(&a).cmp(&rank(&b)).then_with(|| {
            let order = match (a, b) {
                (Some(Datum::Number(a)), Some(Datum::Number(b))) => {
                    a.partial_cmp(&b).unwrap_or(Ordering::Equal)
                }
                (Some(Datum::Text(a)), Some(Datum::Text(b))) => a.cmp(b),
                _ => Ordering::Equal,
            };
            if self.is_descending { order.reverse() } else { order }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(order: &str, values: &[Option<f64>]) -> Vec<String> {
        let order = Order::parse(order, &Attribute::OF_RUNS).unwrap();
        let mut values = values.to_vec();
        let datum = |value: &Option<f64>| value.map(Datum::Number);
        values.sort_by(|a, b| order.compare(datum(a), datum(b)));
        values.iter().map(|value| value.map_or("-".to_owned(), |value| value.to_string())).collect()
    }

    #[test]
    fn what_is_missing_comes_last_in_either_direction() {
        let values = [None, Some(f64::NAN), Some(2.0), Some(f64::INFINITY), Some(-1.0)];
        assert_eq!(sorted("metrics.loss", &values), ["-1", "2", "inf", "NaN", "-"]);
        assert_eq!(sorted("metrics.`a b` DESC", &values), ["inf", "2", "-1", "NaN", "-"]);
    }

    #[test]
    fn an_order_by_what_is_not_there_is_refused() {
        let error = Order::parse("size desc", &Attribute::OF_RUNS).unwrap_err().to_string();
        assert!(error.starts_with("a field is \"size\", allowed: metrics.KEY"), "{error}");
    }
}
