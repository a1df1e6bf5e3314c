//! Makes foreign text fit for XML and for the available space.

/// Replaces characters that XML 1.0 forbids or that would reorder the text around them.
const REPLACEMENT: char = '\u{FFFD}';

/// The text on one line, without characters that XML 1.0 forbids or that are invisible but active.
pub(crate) fn printable(text: &str) -> String {
    text.chars()
        .map(|c| match c {
            '\t' | '\n' | '\r' => ' ',
            // Bidirectional overrides and isolates: a name must not rearrange the text around it.
            '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}' => REPLACEMENT,
            '\u{FFFE}' | '\u{FFFF}' => REPLACEMENT,
            c if c.is_control() => REPLACEMENT,
            c => c,
        })
        .collect()
}

/// [`printable`] text with XML's special characters escaped.
pub(crate) fn xml(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in printable(text).chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&apos;"),
            c => escaped.push(c),
        }
    }
    escaped
}

/// The estimated width of a text in pixels. The font is the reader's and is not known here.
pub(crate) fn width(text: &str, font_size: f64) -> f64 {
    text.chars().map(|c| advance(c) * font_size).sum()
}

/// The width of a character in em. It is rather too large than too small for common sans-serif
/// fonts.
fn advance(c: char) -> f64 {
    match c {
        'i' | 'j' | 'l' | 'I' | '.' | ',' | ':' | ';' | '|' | '!' | '\'' | ' ' => 0.33,
        'f' | 'r' | 't' | '(' | ')' | '[' | ']' | '/' | '-' => 0.42,
        'm' | 'w' | 'M' | 'W' | '@' | '%' => 0.95,
        'A'..='Z' => 0.72,
        // Superscript digits, which exponents use.
        '\u{2070}'..='\u{207F}' | '\u{B9}' | '\u{B2}' | '\u{B3}' => 0.42,
        // Everything from Hangul on, including East Asian scripts and emoji, is up to one em wide.
        '\u{1100}'.. => 1.0,
        _ => 0.62,
    }
}

/// The longest beginning of a text that fits, with an ellipsis if something is cut.
pub(crate) fn fit(text: &str, font_size: f64, room: f64) -> String {
    let text = printable(text);
    if width(&text, font_size) <= room {
        return text;
    }
    let mut fitted = String::new();
    let mut left = room - width("…", font_size);
    for c in text.chars() {
        left -= advance(c) * font_size;
        if left < 0.0 {
            break;
        }
        fitted.push(c);
    }
    format!("{}…", fitted.trim_end())
}

/// A count with its noun: `1 point`, `3 points`.
pub(crate) fn counted(count: usize, noun: &str) -> String {
    if count == 1 { format!("1 {noun}") } else { format!("{count} {noun}s") }
}
