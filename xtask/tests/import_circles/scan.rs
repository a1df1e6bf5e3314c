//! Reads the code of a module: its items, bindings and paths.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// The code of a module, as far as imports depend on it.
#[derive(Default)]
pub struct Module {
    pub file: PathBuf,
    pub children: BTreeSet<String>,
    /// Names that are defined here.
    pub items: BTreeSet<String>,
    /// Names that a `use` binds here, with their paths.
    pub bindings: BTreeMap<String, Vec<String>>,
    pub globs: Vec<Vec<String>>,
    /// Paths in the code that name items of other modules.
    pub paths: Vec<Vec<String>>,
    /// Exports of items, which are imports only if the code names them too.
    pub exports: Vec<(String, Vec<String>)>,
    /// All words of the code outside of `use`.
    pub words: BTreeSet<String>,
}

/// A module that a module declares.
pub struct Child {
    pub name: String,
    pub body: Option<TokenStream>,
    pub path_attribute: Option<String>,
}

impl Module {
    /// Scans code. `is_top` says that its items are items of the module.
    pub fn scan(&mut self, tokens: &[TokenTree], is_top: bool, children: &mut Vec<Child>) {
        let mut at = 0;
        while at < tokens.len() {
            match &tokens[at] {
                TokenTree::Ident(word) if word == "use" && !is_punct(tokens.get(at + 1), '<') => {
                    let end = (at..tokens.len()).find(|&end| is_punct(tokens.get(end), ';'));
                    let end = end.unwrap_or(tokens.len());
                    self.bind(&tokens[at + 1..end], &[], is_public(&tokens[..at]));
                    at = end;
                }
                TokenTree::Ident(word) if is_top && word == "mod" => {
                    if let Some(TokenTree::Ident(name)) = tokens.get(at + 1) {
                        let body = match tokens.get(at + 2) {
                            Some(TokenTree::Group(body)) => Some(body.stream()),
                            _ => None,
                        };
                        let path_attribute = path_attribute(&tokens[..at]);
                        children.push(Child { name: name.to_string(), body, path_attribute });
                        self.children.insert(name.to_string());
                    }
                    at += 2;
                }
                TokenTree::Ident(word) => {
                    self.words.insert(word.to_string());
                    if is_top && DEFINING.iter().any(|defining| word == defining) {
                        let name = match tokens.get(at + 1) {
                            Some(TokenTree::Punct(bang)) if bang.as_char() == '!' => {
                                tokens.get(at + 2)
                            }
                            other => other,
                        };
                        if let Some(TokenTree::Ident(name)) = name {
                            self.items.insert(name.to_string());
                        }
                    }
                    let path = path_at(&tokens[at..]);
                    let is_start = at == 0
                        || !is_punct(tokens.get(at - 1), ':')
                        || !is_punct(tokens.get(at.wrapping_sub(2)), ':');
                    if is_start && path.len() > 1 {
                        self.words.extend(path.iter().cloned());
                        let is_of_macro = at > 0 && is_punct(tokens.get(at - 1), '$');
                        at += 3 * (path.len() - 1);
                        if !is_of_macro {
                            self.paths.push(path);
                        }
                    }
                }
                TokenTree::Group(group) => {
                    let inner: Vec<TokenTree> = group.stream().into_iter().collect();
                    self.scan(&inner, false, children);
                }
                TokenTree::Punct(_) | TokenTree::Literal(_) => {}
            }
            at += 1;
        }
    }

    /// Reads one tree of a `use`, below `prefix`.
    fn bind(&mut self, tree: &[TokenTree], prefix: &[String], is_public: bool) {
        let mut path = prefix.to_vec();
        let mut at = 0;
        if is_punct(tree.first(), ':') {
            // Another crate.
            return;
        }
        while at < tree.len() {
            match &tree[at] {
                TokenTree::Ident(word) if word == "as" => {
                    let name = tree.get(at + 1).map(ToString::to_string).unwrap_or_default();
                    return self.bound(name, path, is_public);
                }
                TokenTree::Ident(word) => path.push(word.to_string()),
                TokenTree::Group(group) => {
                    let inner: Vec<TokenTree> = group.stream().into_iter().collect();
                    for tree in inner.split(|token| is_punct(Some(token), ',')) {
                        if !tree.is_empty() {
                            self.bind(tree, &path, is_public);
                        }
                    }
                    return;
                }
                TokenTree::Punct(star) if star.as_char() == '*' => {
                    self.globs.push(path);
                    return;
                }
                TokenTree::Punct(_) | TokenTree::Literal(_) => {}
            }
            at += 1;
        }
        let name = path.last().cloned().unwrap_or_default();
        self.bound(name, path, is_public);
    }

    fn bound(&mut self, name: String, mut path: Vec<String>, is_public: bool) {
        let mut name = name;
        // `use parent::{self}`
        if path.len() > 1 && path.last().is_some_and(|last| last == "self") {
            path.pop();
            if name == "self" {
                name = path.last().cloned().unwrap_or_default();
            }
        }
        if is_public {
            self.exports.push((name.clone(), path.clone()));
        } else {
            self.paths.push(path.clone());
        }
        self.bindings.insert(name, path);
    }
}

/// Words before the name of an item.
const DEFINING: [&str; 9] =
    ["fn", "struct", "enum", "union", "trait", "type", "const", "static", "macro_rules"];

/// The tokens without attributes and items of tests.
pub fn without_tests(tokens: TokenStream) -> Vec<TokenTree> {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let mut kept = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        if !is_test_attribute(&tokens[at..]) {
            kept.push(tokens[at].clone());
            at += 1;
            continue;
        }
        at += 2;
        while is_punct(tokens.get(at), '#') {
            at += 2;
        }
        let is_use = |token: &TokenTree| matches!(token, TokenTree::Ident(word) if word == "use");
        let mut in_use = false;
        while at < tokens.len() {
            in_use |= is_use(&tokens[at]);
            let is_body = matches!(&tokens[at], TokenTree::Group(group) if group.delimiter() == Delimiter::Brace);
            let is_end = is_punct(tokens.get(at), ';') || (is_body && !in_use);
            at += 1;
            if is_end {
                break;
            }
        }
    }
    kept
}

fn is_test_attribute(tokens: &[TokenTree]) -> bool {
    is_punct(tokens.first(), '#')
        && matches!(tokens.get(1), Some(TokenTree::Group(attribute))
        if ["cfg(test)", "cfg(all(test,"].iter().any(|beginning| {
            attribute.stream().to_string().replace(' ', "").starts_with(beginning)
        }))
}

/// The file in `#[path = "..."]` directly before a module.
fn path_attribute(before: &[TokenTree]) -> Option<String> {
    let end = before.iter().rposition(|token| match token {
        TokenTree::Ident(word) => word != "pub",
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        TokenTree::Punct(punct) => punct.as_char() == ';',
        TokenTree::Literal(_) => true,
    });
    let attributes = &before[end.map_or(0, |end| end + 1)..];
    attributes.iter().find_map(|token| {
        let TokenTree::Group(group) = token else { return None };
        let inner: Vec<TokenTree> = group.stream().into_iter().collect();
        match &inner[..] {
            [TokenTree::Ident(name), TokenTree::Punct(_), TokenTree::Literal(path)]
                if name == "path" =>
            {
                Some(path.to_string().trim_matches('"').to_owned())
            }
            _ => None,
        }
    })
}

fn is_public(before: &[TokenTree]) -> bool {
    let is_pub =
        |token: Option<&TokenTree>| matches!(token, Some(TokenTree::Ident(word)) if word == "pub");
    let [.., first, second] = before else { return is_pub(before.last()) };
    is_pub(Some(second)) || (matches!(second, TokenTree::Group(_)) && is_pub(Some(first)))
}

/// The path that begins at an identifier.
fn path_at(tokens: &[TokenTree]) -> Vec<String> {
    let mut path = Vec::new();
    let mut at = 0;
    while let Some(TokenTree::Ident(word)) = tokens.get(at) {
        path.push(word.to_string());
        if !(is_punct(tokens.get(at + 1), ':') && is_punct(tokens.get(at + 2), ':')) {
            break;
        }
        at += 3;
    }
    path
}

fn is_punct(token: Option<&TokenTree>, mark: char) -> bool {
    matches!(token, Some(TokenTree::Punct(punct)) if punct.as_char() == mark)
}
