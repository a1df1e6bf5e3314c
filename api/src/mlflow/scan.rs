//! Splits a filter into words.

use super::MlflowError;

/// The unread part of a filter.
pub struct Scanner<'a> {
    rest: &'a str,
}

impl<'a> Scanner<'a> {
    pub fn new(text: &'a str) -> Self {
        Self { rest: text.trim() }
    }

    pub fn is_at_end(&self) -> bool {
        self.rest.is_empty()
    }

    pub const fn rest(&self) -> &'a str {
        self.rest
    }

    fn take(&mut self, bytes: usize) -> &'a str {
        let (taken, rest) = self.rest.split_at(bytes);
        self.rest = rest.trim_start();
        taken
    }

    /// Reads a name, whose parts may be in quotes. It ends at a space or a comparison.
    pub fn name(&mut self) -> Result<&'a str, MlflowError> {
        let mut quote = None;
        for (place, character) in self.rest.char_indices() {
            match quote {
                Some(open) if character == open => quote = None,
                Some(_) => {}
                None if character == '`' || character == '"' => quote = Some(character),
                None if character.is_whitespace() || "=!<>()',".contains(character) => {
                    return self.name_of(place);
                }
                None => {}
            }
        }
        match quote {
            Some(open) => {
                let allowed = format!("a name whose {open} is closed");
                Err(MlflowError::invalid("filter", self.rest, &allowed))
            }
            None => self.name_of(self.rest.len()),
        }
    }

    fn name_of(&mut self, bytes: usize) -> Result<&'a str, MlflowError> {
        if bytes == 0 {
            return Err(MlflowError::invalid("filter", self.rest, "a field, such as metrics.loss"));
        }
        Ok(self.take(bytes))
    }

    /// Reads the next word if it is `word`, ignoring case.
    pub fn word(&mut self, word: &str) -> bool {
        let Some(found) = self.rest.get(..word.len()) else { return false };
        let ends = !self.rest[word.len()..].starts_with(|next: char| next.is_alphanumeric());
        let is_word = found.eq_ignore_ascii_case(word) && ends;
        if is_word {
            self.take(word.len());
        }
        is_word
    }

    pub fn symbol(&mut self, symbol: &str) -> bool {
        let is_next = self.rest.starts_with(symbol);
        if is_next {
            self.take(symbol.len());
        }
        is_next
    }

    /// Reads a text in single or double quotes. A quote inside is written twice.
    pub fn text(&mut self) -> Result<String, MlflowError> {
        let allowed = "a text in quotes, such as 'adam'";
        let invalid = |rest: &str| MlflowError::invalid("filter", rest, allowed);
        let quote = self.rest.chars().next().filter(|first| matches!(first, '\'' | '"'));
        let Some(quote) = quote else { return Err(invalid(self.rest)) };
        let mut text = String::new();
        let mut characters = self.rest.char_indices().skip(1).peekable();
        while let Some((place, character)) = characters.next() {
            if character != quote {
                text.push(character);
            } else if characters.next_if(|(_, next)| *next == quote).is_some() {
                text.push(quote);
            } else {
                self.take(place + 1);
                return Ok(text);
            }
        }
        Err(invalid(self.rest))
    }

    pub fn number(&mut self) -> Result<f64, MlflowError> {
        let end = self.rest.find(|next: char| next.is_whitespace()).unwrap_or(self.rest.len());
        let found = &self.rest[..end];
        match found.parse() {
            Ok(number) => {
                self.take(end);
                Ok(number)
            }
            Err(_) => {
                let allowed = "a number, where the field is one";
                Err(MlflowError::invalid("filter", self.rest, allowed))
            }
        }
    }
}
