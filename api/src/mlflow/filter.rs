//! Filters of searches: `metrics.loss < 0.1 AND params.optimizer = 'adam' AND tags.note LIKE 'a%'`.

use super::scan::Scanner;
use super::{Attribute, Datum, Field, MlflowError, limits};

/// Clauses that must all be true.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter(Vec<Clause>);

#[derive(Clone, Debug, PartialEq)]
struct Clause {
    field: Field,
    test: Test,
}

#[derive(Clone, Debug, PartialEq)]
enum Test {
    Number(Comparison, f64),
    Text(Comparison, String),
    /// Whether upper and lower case differ.
    Like {
        pattern: String,
        any_case: bool,
    },
    /// Whether the value is, or is not, one of these.
    Among {
        texts: Vec<String>,
        is_in: bool,
    },
    /// Whether the value is missing, or present.
    Missing(bool),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Comparison {
    Equal,
    Unequal,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

/// Longer symbols come first.
const SYMBOLS: [(&str, Comparison); 7] = [
    ("==", Comparison::Equal),
    ("!=", Comparison::Unequal),
    ("<=", Comparison::LessOrEqual),
    (">=", Comparison::GreaterOrEqual),
    ("=", Comparison::Equal),
    ("<", Comparison::Less),
    (">", Comparison::Greater),
];

impl Filter {
    /// Reads a filter. `attributes` are the allowed ones.
    pub fn parse(text: &str, attributes: &[Attribute]) -> Result<Self, MlflowError> {
        let mut scanner = Scanner::new(text);
        let mut clauses = Vec::new();
        if scanner.is_at_end() {
            return Ok(Self(clauses));
        }
        loop {
            clauses.push(clause(&mut scanner, attributes)?);
            if scanner.is_at_end() {
                break;
            }
            if clauses.len() == limits::CLAUSES {
                let allowed = format!("{} clauses at most", limits::CLAUSES);
                return Err(MlflowError::invalid("filter", text, &allowed));
            }
            if !scanner.word("AND") {
                return Err(MlflowError::invalid("filter", scanner.rest(), "AND, or the end"));
            }
        }
        Ok(Self(clauses))
    }

    pub fn fields(&self) -> impl Iterator<Item = &Field> {
        self.0.iter().map(|clause| &clause.field)
    }

    /// Whether all clauses are true. `find` returns the value of a field.
    pub fn is_met<'a>(&self, find: impl Fn(&Field) -> Option<Datum<'a>>) -> bool {
        self.0.iter().all(|clause| clause.test.is_met(find(&clause.field)))
    }
}

fn clause(scanner: &mut Scanner<'_>, attributes: &[Attribute]) -> Result<Clause, MlflowError> {
    let field = Field::parse(scanner.name()?, attributes)?;
    let test = if field.is_number() { number(scanner) } else { text(scanner, &field) }?;
    Ok(Clause { field, test })
}

fn number(scanner: &mut Scanner<'_>) -> Result<Test, MlflowError> {
    let Some(comparison) = comparison(scanner) else {
        let allowed = "=, !=, <, <=, > or >=, where the field is a number";
        return Err(MlflowError::invalid("filter", scanner.rest(), allowed));
    };
    Ok(Test::Number(comparison, scanner.number()?))
}

fn text(scanner: &mut Scanner<'_>, field: &Field) -> Result<Test, MlflowError> {
    let before = scanner.rest();
    match comparison(scanner) {
        Some(equality @ (Comparison::Equal | Comparison::Unequal)) => {
            return Ok(Test::Text(equality, scanner.text()?));
        }
        Some(_) => {}
        None => {
            if scanner.word("LIKE") {
                return Ok(Test::Like { pattern: pattern(scanner)?, any_case: false });
            }
            if scanner.word("ILIKE") {
                return Ok(Test::Like { pattern: pattern(scanner)?, any_case: true });
            }
            let is_attribute = matches!(field, Field::Attribute(_));
            if is_attribute && scanner.word("IN") {
                return Ok(Test::Among { texts: texts(scanner)?, is_in: true });
            }
            if is_attribute && scanner.word("NOT") && scanner.word("IN") {
                return Ok(Test::Among { texts: texts(scanner)?, is_in: false });
            }
            if !is_attribute && scanner.word("IS") {
                let is_missing = !scanner.word("NOT");
                if scanner.word("NULL") {
                    return Ok(Test::Missing(is_missing));
                }
            }
        }
    }
    let allowed = "=, !=, LIKE or ILIKE, where the field is a text; IS NULL or IS NOT NULL of a param or tag; IN or \
                   NOT IN of an attribute";
    Err(MlflowError::invalid("filter", before, allowed))
}

fn pattern(scanner: &mut Scanner<'_>) -> Result<String, MlflowError> {
    let pattern = scanner.text()?;
    if pattern.chars().count() > limits::PATTERN {
        let allowed = format!("a pattern of {} characters at most", limits::PATTERN);
        return Err(MlflowError::invalid("filter", &pattern, &allowed));
    }
    Ok(pattern)
}

fn comparison(scanner: &mut Scanner<'_>) -> Option<Comparison> {
    SYMBOLS.into_iter().find(|(symbol, _)| scanner.symbol(symbol)).map(|(_, symbol)| symbol)
}

fn texts(scanner: &mut Scanner<'_>) -> Result<Vec<String>, MlflowError> {
    let allowed = "a list, such as ('a', 'b')";
    if !scanner.symbol("(") {
        return Err(MlflowError::invalid("filter", scanner.rest(), allowed));
    }
    let mut texts = vec![scanner.text()?];
    while scanner.symbol(",") {
        texts.push(scanner.text()?);
    }
    if !scanner.symbol(")") {
        return Err(MlflowError::invalid("filter", scanner.rest(), allowed));
    }
    Ok(texts)
}

impl Test {
    /// Whether the clause is true. A missing field passes no test except the one for missing
    /// fields.
    fn is_met(&self, found: Option<Datum<'_>>) -> bool {
        let Some(found) = found else { return *self == Self::Missing(true) };
        match (self, found) {
            (Self::Missing(is_missing), _) => !is_missing,
            (Self::Number(comparison, value), Datum::Number(found)) => {
                comparison.holds(found.partial_cmp(value))
            }
            (Self::Text(comparison, value), Datum::Text(found)) => {
                comparison.holds(Some(found.cmp(value)))
            }
            (Self::Like { pattern, any_case: false }, Datum::Text(found)) => like(pattern, found),
            (Self::Like { pattern, any_case: true }, Datum::Text(found)) => {
                like(&pattern.to_lowercase(), &found.to_lowercase())
            }
            (Self::Among { texts, is_in }, Datum::Text(found)) => {
                texts.iter().any(|text| text == found) == *is_in
            }
            _ => false,
        }
    }
}

impl Comparison {
    /// Whether the comparison is true. `None` is the result of comparing NaN, which is unequal to
    /// everything.
    fn holds(self, order: Option<std::cmp::Ordering>) -> bool {
        let Some(order) = order else { return self == Self::Unequal };
        match self {
            Self::Equal => order.is_eq(),
            Self::Unequal => order.is_ne(),
            Self::Less => order.is_lt(),
            Self::LessOrEqual => order.is_le(),
            Self::Greater => order.is_gt(),
            Self::GreaterOrEqual => order.is_ge(),
        }
    }
}

/// SQL's LIKE: `%` is any text, and `_` is any character. It takes at most the product of both
/// lengths.
fn like(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) =
        (pattern.chars().collect(), text.chars().collect());
    let (mut p, mut t) = (0, 0);
    // The last `%`, and the end of its text so far.
    let mut back: Option<(usize, usize)> = None;
    while t < text.len() {
        match pattern.get(p) {
            Some('%') => {
                back = Some((p, t));
                p += 1;
            }
            Some(&wanted) if wanted == '_' || wanted == text[t] => {
                p += 1;
                t += 1;
            }
            _ => match &mut back {
                Some((star, end)) => {
                    *end += 1;
                    (p, t) = (*star + 1, *end);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|rest| *rest == '%')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find<'a>(field: &Field) -> Option<Datum<'a>> {
        match field {
            Field::Metric(key) if key == "train/loss" => Some(Datum::Number(0.25)),
            Field::Metric(key) if key == "nan" => Some(Datum::Number(f64::NAN)),
            Field::Param(key) if key == "batch size" => Some(Datum::Text("32")),
            Field::Tag(key) if key == "note" => Some(Datum::Text("it's Fine")),
            Field::Attribute(Attribute::Status) => Some(Datum::Text("FINISHED")),
            Field::Attribute(Attribute::StartTime) => Some(Datum::Number(1_700_000_000_123.0)),
            Field::Attribute(Attribute::RunId) => Some(Datum::Text("abc")),
            _ => None,
        }
    }

    fn meets(filter: &str) -> bool {
        Filter::parse(filter, &Attribute::OF_RUNS).unwrap().is_met(find)
    }

    fn refused(filter: &str) -> String {
        Filter::parse(filter, &Attribute::OF_RUNS).unwrap_err().to_string()
    }

    #[test]
    fn the_common_filters_of_mlflow_are_met_and_not() {
        for met in [
            "",
            "metrics.train/loss < 0.5",
            "metrics.`train/loss`>=0.25 and params.\"batch size\" = '32'",
            "metric.nan != 3",
            "tags.note LIKE 'it''s%' AND tags.note ILIKE '%FINE'",
            "tags.note LIKE \"it's _ine\"",
            "attributes.status = 'FINISHED' AND start_time > 1e12",
            "attribute.run_id IN ('x', 'abc') AND run_id NOT IN ('x')",
            "tags.other IS NULL AND tags.note IS NOT NULL",
            "status != 'FAILED'",
            "attributes.Created <= 1700000000123",
        ] {
            assert!(meets(met), "{met}");
        }
        for unmet in [
            "metrics.train/loss > 0.5",
            "metrics.other != 1",
            "metrics.nan = 1",
            "params.other != '1'",
            "tags.note LIKE '%FINE'",
            "tags.note IS NULL",
            "run_id IN ('x')",
            "status = 'FINISHED' AND start_time < 5",
        ] {
            assert!(!meets(unmet), "{unmet}");
        }
    }

    #[test]
    fn a_filter_that_is_not_understood_says_where() {
        for (filter, part) in [
            ("metrics.loss < 'a'", "\"'a'\", allowed: a number"),
            ("params.a = 3", "\"3\", allowed: a text in quotes"),
            ("params.a < '3'", "\"< '3'\", allowed: =, !="),
            ("params.a = '3' OR params.b = '4'", "\"OR params.b = '4'\", allowed: AND"),
            ("colour = 'red'", "\"colour\", allowed: metrics.KEY"),
            ("models.x = 'red'", "\"models.x\", allowed: one that begins with"),
            ("tags.`a = 'x'", "whose ` is closed"),
            ("tags.a = 'x", "allowed: a text in quotes"),
            ("tags.a = 'x' AND", "allowed: a field"),
        ] {
            let message = refused(filter);
            assert!(message.contains(part), "{filter}: {message}");
        }
    }

    #[test]
    fn like_knows_any_text_and_any_character() {
        for (pattern, text) in
            [("%", ""), ("a%c", "abbc"), ("a_c", "abc"), ("%b%", "abc"), ("%ab%ab", "abxabab")]
        {
            assert!(like(pattern, text), "{pattern} {text}");
        }
        for (pattern, text) in [("a", ""), ("a_c", "ac"), ("a%b", "abc"), ("", "a")] {
            assert!(!like(pattern, text), "{pattern} {text}");
        }
    }
}
