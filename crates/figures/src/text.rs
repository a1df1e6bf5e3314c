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

/// Names that fit, in their order. A long one keeps its beginning and its end, because names of one
/// family often differ in their last word. Names that would look alike are numbered from 1.
pub(crate) fn fit_names(names: &[&str], font_size: f64, room: f64) -> Vec<String> {
    let fitted: Vec<String> = names.iter().map(|name| fit_ends(name, font_size, room)).collect();
    let shown = |(place, name): (usize, &&str)| {
        let looks = &fitted[place];
        let is_cut = *looks != printable(name);
        let same = fitted.iter().zip(names).any(|(other, of)| other == looks && of != name);
        if !is_cut || !same {
            return looks.clone();
        }
        let number = format!("{} ", place + 1);
        let left = room - width(&number, font_size);
        format!("{number}{}", fit_ends(name, font_size, left))
    };
    names.iter().enumerate().map(shown).collect()
}

/// A text whose middle is replaced by an ellipsis if it does not fit.
fn fit_ends(text: &str, font_size: f64, room: f64) -> String {
    let text = printable(text);
    if width(&text, font_size) <= room {
        return text;
    }
    let half = (room - width("…", font_size)) / 2.0;
    let fitting = |characters: &mut dyn Iterator<Item = char>| -> Vec<char> {
        let mut left = half;
        let fits = |c: &char| {
            left -= advance(*c) * font_size;
            left >= 0.0
        };
        characters.take_while(fits).collect()
    };
    let beginning: String = fitting(&mut text.chars()).into_iter().collect();
    let end: String = fitting(&mut text.chars().rev()).into_iter().rev().collect();
    format!("{}…{}", beginning.trim_end(), end.trim_start())
}

/// A count with its noun: `1 point`, `3 points`.
pub(crate) fn counted(count: usize, noun: &str) -> String {
    if count == 1 { format!("1 {noun}") } else { format!("{count} {noun}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_keep_their_beginning_and_their_end() {
        let long = "robomorph with dropout 0.1 and a learning rate of 3e-4, seed";
        let names = [format!("{long} 1"), format!("{long} 2"), "cdt".to_owned()];
        let names = names.each_ref().map(String::as_str);
        let fitted = fit_names(&names, 12.0, 200.0);
        assert!(fitted[0].starts_with("robomorph") && fitted[0].ends_with("seed 1"), "{fitted:?}");
        assert!(fitted[1].ends_with("seed 2"), "{fitted:?}");
        assert_eq!(fitted[2], "cdt");
        assert!(fitted.iter().all(|name| width(name, 12.0) <= 200.0), "{fitted:?}");
    }

    #[test]
    fn names_that_differ_in_their_middle_are_numbered() {
        let name = |seed| format!("{}seed {seed}{}", "a".repeat(60), "b".repeat(60));
        let names = [name(1), name(2)];
        let fitted = fit_names(&names.each_ref().map(String::as_str), 12.0, 200.0);
        assert!(fitted[0].starts_with("1 aa") && fitted[1].starts_with("2 aa"), "{fitted:?}");
        assert!(fitted.iter().all(|name| width(name, 12.0) <= 200.0), "{fitted:?}");
    }
}
