//! Specs in a readable form, with the names of what they refer to.

use reports::json::readable;
use serde_json::Value;

use crate::page::lineage::{Lineage, Source};

/// The text of a spec, with links where it refers to results of other jobs.
pub struct Specification {
    pub pieces: Vec<Piece>,
}

/// A piece of the text. The digest of a job belongs to that job.
#[derive(Debug, PartialEq)]
pub struct Piece {
    pub text: String,
    pub source: Option<Source>,
}

impl Specification {
    /// The spec of a job with this lineage.
    pub fn new(spec: &Value, lineage: Option<&Lineage>) -> Self {
        Self { pieces: pieces(&readable(spec), lineage.map_or(&[], |lineage| &lineage.sources)) }
    }
}

fn pieces(text: &str, sources: &[Source]) -> Vec<Piece> {
    let mut pieces = Vec::new();
    let mut rest = text;
    let next = |text: &str| {
        let found = |source: &Source| Some((text.find(&source.digest)?, source.clone()));
        sources.iter().filter_map(found).min_by_key(|(place, _)| *place)
    };
    while let Some((place, source)) = next(rest) {
        let (before, from) = rest.split_at(place);
        let (digest, after) = from.split_at(source.digest.len());
        pieces.push(Piece { text: before.to_owned(), source: None });
        pieces.push(Piece { text: digest.to_owned(), source: Some(source) });
        rest = after;
    }
    pieces.push(Piece { text: rest.to_owned(), source: None });
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_of_another_job_leads_there_and_the_text_stays_the_same() {
        let source = |digest: &str, name: &str| Source {
            digest: digest.to_owned(),
            name: name.to_owned(),
            href: format!("/datasets/{name}"),
        };
        let sources = [source("ab12", "train"), source("cd34", "test"), source("ef56", "unused")];
        let text = "{\"on\": \"cd34\", \"data\": [\"ab12\", \"cd34\"], \"file\": \"9999\"}";
        let pieces = pieces(text, &sources);
        let all: String = pieces.iter().map(|piece| piece.text.as_str()).collect();
        assert_eq!(all, text);
        let named = pieces.iter().filter_map(|piece| Some(piece.source.as_ref()?.name.as_str()));
        assert_eq!(named.collect::<Vec<_>>(), ["test", "train", "test"]);
        assert_eq!(super::pieces(text, &[]).len(), 1);
    }
}
