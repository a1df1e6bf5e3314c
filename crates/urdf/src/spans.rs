//! Where the elements of a URDF are in its text.

use std::ops::Range;

use quick_xml::events::attributes::Attributes;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;

use crate::UrdfError;
use crate::part::shown;

/// Levels that are looked at: robot, link, inertial, mass.
const LEVELS: usize = 4;

/// An element and those inside it. Places are in bytes of the text.
#[derive(Debug)]
pub(crate) struct Element {
    pub(crate) name: String,
    /// The start tag, which is all of an element that closes itself.
    pub(crate) tag: Range<usize>,
    /// From the start of the start tag to the end of the end tag.
    pub(crate) whole: Range<usize>,
    pub(crate) children: Vec<Element>,
    /// The comments directly inside.
    pub(crate) comments: Vec<Range<usize>>,
}

impl Element {
    fn open(start: &BytesStart<'_>, tag: Range<usize>) -> Self {
        let name = String::from_utf8_lossy(start.name().as_ref()).into_owned();
        Self { name, whole: tag.clone(), tag, children: Vec::new(), comments: Vec::new() }
    }

    pub(crate) fn children<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Self> {
        self.children.iter().filter(move |child| child.name == name)
    }

    pub(crate) fn child(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    pub(crate) fn closes_itself(&self) -> bool {
        self.tag == self.whole
    }

    /// Where the value of an attribute is, without its quotes.
    pub(crate) fn value(&self, text: &str, attribute: &str) -> Option<Range<usize>> {
        let inside = &text[self.tag.start + 1..self.attributes_end(text)];
        let mut attributes = Attributes::new(inside, self.name.len());
        let found = attributes
            .with_checks(false)
            .flatten()
            .find(|found| found.key.as_ref() == attribute.as_bytes())?;
        // The value is a part of the text.
        let start = found.value.as_ptr().addr() - text.as_ptr().addr();
        Some(start..start + found.value.len())
    }

    /// The end of the start tag without its slash and bracket, and without spaces before them.
    pub(crate) fn attributes_end(&self, text: &str) -> usize {
        let tag = &text[self.tag.clone()];
        let inside = tag.strip_suffix("/>").or_else(|| tag.strip_suffix('>')).unwrap_or(tag);
        self.tag.start + inside.trim_ascii_end().len()
    }
}

/// The root element of a text that has been read.
pub(crate) fn root(text: &str) -> Result<Element, UrdfError> {
    let mut reader = Reader::from_str(text);
    // The elements that are open, the root first.
    let mut open: Vec<Element> = Vec::new();
    let mut depth = 0;
    loop {
        let event = reader.read_event();
        let end = text.len() - reader.get_ref().len();
        let not_xml = |reason: &str| UrdfError::NotXml {
            line: 1 + text[..end].matches('\n').count(),
            reason: shown(reason),
        };
        let closed = match event.map_err(|error| not_xml(&error.to_string()))? {
            Event::Start(start) => {
                depth += 1;
                if depth <= LEVELS {
                    // Its brackets are not in the event.
                    open.push(Element::open(&start, end - start.len() - 2..end));
                }
                None
            }
            Event::Empty(start) if depth < LEVELS => {
                Some(Element::open(&start, end - start.len() - 3..end))
            }
            Event::End(_) => {
                depth -= 1;
                let closed = if depth < LEVELS { open.pop() } else { None };
                closed.map(|element| Element { whole: element.whole.start..end, ..element })
            }
            Event::Comment(comment) => {
                if let Some(element) = open.last_mut().filter(|_| depth <= LEVELS) {
                    element.comments.push(end - comment.len() - 7..end);
                }
                None
            }
            Event::Eof => return Err(not_xml("there is no element")),
            _ => None,
        };
        let Some(closed) = closed else { continue };
        match open.last_mut() {
            Some(parent) => parent.children.push(closed),
            None => return Ok(closed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Texts of all elements and comments, from the inside out.
    fn texts<'a>(text: &'a str, element: &Element, found: &mut Vec<&'a str>) {
        for child in &element.children {
            texts(text, child, found);
        }
        found.extend(element.comments.iter().map(|comment| &text[comment.clone()]));
        found.push(&text[element.whole.clone()]);
    }

    #[test]
    fn elements_and_comments_are_found_at_any_place() {
        let text = "\u{feff}<?xml version='1.0'?>\r\n<!-- é --><a b = \"<>é\" ><!-- c --><d\te='f' / ><![CDATA[<x>]]>&lt;\
                    <d><e><f><g/><!-- h --></f></e></d ></a\n><!-- end -->";
        let text = text.replace("/ >", "/>");
        let mut found = Vec::new();
        texts(&text, &root(&text).unwrap(), &mut found);
        assert_eq!(
            found,
            [
                "<d\te='f' />",
                "<!-- h -->",
                "<f><g/><!-- h --></f>",
                "<e><f><g/><!-- h --></f></e>",
                "<d><e><f><g/><!-- h --></f></e></d >",
                "<!-- c -->",
                &text[text.find("<a").unwrap()..text.find("<!-- end").unwrap()],
            ]
        );
    }

    #[test]
    fn values_are_found_in_either_quotes() {
        let text = "<a b='' c = \"x' y\" d='é>' e2='1' e='2'/>";
        let root = root(text).unwrap();
        let value = |name| root.value(text, name).map(|range| &text[range]);
        let expected = [Some(""), Some("x' y"), Some("é>"), Some("2"), None];
        assert_eq!(["b", "c", "d", "e", "f"].map(value), expected);
        assert_eq!(&text[root.attributes_end(text)..], "/>");
    }
}
