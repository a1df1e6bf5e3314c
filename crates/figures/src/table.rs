//! The data table of a figure.

use crate::Figure;

/// The figure's points as CSV. [`Figure::to_csv`] describes the format.
pub(crate) fn csv(figure: &Figure) -> String {
    let headings = ["series", &figure.x.heading(), &figure.y.heading(), "low", "high"].map(cell);
    let mut table = headings.join(",");
    table.push('\n');
    for series in &figure.series {
        let name = cell(&series.name);
        for point in &series.points {
            let row = [
                name.clone(),
                number(point.x),
                number(point.y),
                point.low.map(number).unwrap_or_default(),
                point.high.map(number).unwrap_or_default(),
            ];
            table.push_str(&row.join(","));
            table.push('\n');
        }
    }
    table
}

/// A text cell. It is quoted where RFC 4180 requires it, and never a formula.
fn cell(text: &str) -> String {
    // https://owasp.org/www-community/attacks/CSV_Injection
    let formula = text.starts_with(['=', '+', '-', '@', '\t', '\r']);
    let text = if formula { format!("'{text}") } else { text.to_owned() };
    if text.contains([',', '"', '\n', '\r']) {
        return format!("\"{}\"", text.replace('"', "\"\""));
    }
    text
}

/// The shortest decimal that reads back as the same `f64`: `1000`, `0.25`, `1e-7`.
fn number(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e15 {
        return format!("{value}");
    }
    format!("{value:?}")
}
