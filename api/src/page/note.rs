//! Notes in Markdown.

use std::fmt::{self, Display, Formatter};

use ammonia::Builder;
use askama::filters::HtmlSafe;
use pulldown_cmark::{Event, HeadingLevel, Options, Parser, Tag, TagEnd, html};

/// A note as HTML. Markup in it is shown as it was typed, lines break where its author broke them, and headings are below
/// the title of the page.
#[derive(Debug)]
pub struct Note {
    html: String,
}

impl Note {
    /// `None` for an empty note.
    pub fn new(markdown: &str) -> Option<Self> {
        if markdown.trim().is_empty() {
            return None;
        }
        let options = Options::ENABLE_TABLES | Options::ENABLE_STRIKETHROUGH;
        let events = Parser::new_ext(markdown, options).map(|event| match event {
            Event::Html(markup) | Event::InlineHtml(markup) => Event::Text(markup),
            Event::SoftBreak => Event::HardBreak,
            Event::Start(Tag::Heading { level, .. }) => Event::Start(Tag::Heading {
                level: lowered(level),
                id: None,
                classes: Vec::new(),
                attrs: Vec::new(),
            }),
            Event::End(TagEnd::Heading(level)) => Event::End(TagEnd::Heading(lowered(level))),
            other => other,
        });
        let mut text = String::new();
        html::push_html(&mut text, events);
        // Pictures would be fetched from elsewhere.
        let html = Builder::default().rm_tags(["img"]).clean(&text).to_string();
        Some(Self { html })
    }
}

/// The title of the page is the only one of its level.
fn lowered(level: HeadingLevel) -> HeadingLevel {
    HeadingLevel::try_from(level as usize + 1).unwrap_or(HeadingLevel::H6)
}

impl HtmlSafe for Note {}

impl Display for Note {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&self.html)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(markdown: &str) -> String {
        Note::new(markdown).unwrap().to_string()
    }

    #[test]
    fn a_note_is_markdown_and_plain_text_keeps_its_lines() {
        assert_eq!(shown("one\ntwo"), "<p>one<br>\ntwo</p>\n");
        let note = shown("# Why\n\n- *less* `damping`\n\n[run](/runs/3)");
        assert!(note.starts_with("<h2>Why</h2>"), "{note}");
        assert!(note.contains("<li><em>less</em> <code>damping</code></li>"), "{note}");
        assert!(note.contains("<a href=\"/runs/3\""), "{note}");
        assert!(Note::new(" \n").is_none());
    }

    #[test]
    fn nothing_in_a_note_runs_or_is_fetched() {
        for note in [
            "<script>alert(1)</script>",
            "a <img src=x onerror=alert(1)> b",
            "[here](javascript:alert(1))",
            "![picture](https://example.org/x.png)",
            "<a href=\"javascript:alert(1)\">x</a>",
        ] {
            let shown = shown(note);
            for forbidden in ["<script", "<img", "<a href=\"javascript", "example.org"] {
                assert!(!shown.contains(forbidden), "{note}: {shown}");
            }
        }
        // The reader still sees the typed markup.
        assert!(shown("<script>alert(1)</script>").contains("&lt;script&gt;alert(1)"));
    }

    #[test]
    fn a_note_of_any_depth_is_shown() {
        for mark in [">", "- ", "*", "[", "![", "<div>", "`", "# "] {
            let note = mark.repeat(10_000 / mark.len());
            assert!(shown(&note).len() < 10_000_000, "{mark}");
        }
    }
}
