//! Looks for circles of imports among the files of each crate.
//!
//! A file imports the files that define the items it names. A path is followed through exports of other
//! modules to the definition, so a file that only exports an item again imports nothing. Tests within
//! a file do not count, and neither do methods that are called on a value, and `$crate` in a macro, which
//! is imported where the macro is used.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use proc_macro2::{Delimiter, TokenStream, TokenTree};
use serde_json::Value;

/// The largest number of files in a circle.
const LONGEST: usize = 3;

#[test]
fn circles_of_imports_have_three_files_at_most() {
    let mut circles = Vec::new();
    for root in roots() {
        let imports = Crate::read(&root).imports();
        circles.extend(long_circles(&imports).iter().map(|circle| describe(circle, &imports)));
    }
    assert!(circles.is_empty(), "circles of imports:\n\n{}", circles.join("\n\n"));
}

#[test]
fn a_circle_through_exports_aliases_and_macros_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        ("lib.rs", "mod a; mod b; mod d; pub use b::c::C;"),
        ("a.rs", "use crate::b; fn f() -> b::B { wrap!({ crate::C }) }"),
        ("b/mod.rs", "pub mod c; pub struct B; pub use c::Other; #[cfg(test)] mod tests {}"),
        ("b/c.rs", "use super::super::d::{self as last}; pub struct C(last::D); pub struct Other;"),
        (
            "d.rs",
            "pub struct D(e::E); mod e { pub struct E(crate::a::A); }\n#[cfg(test)] use crate::X;",
        ),
    ];
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    let imports = Crate::read(&folder.path().join("lib.rs")).imports();
    let named = |path: &Path| path.strip_prefix(folder.path()).unwrap().display().to_string();
    let found: Vec<(String, Vec<String>)> = imports
        .iter()
        .map(|(file, imported)| (named(file), imported.keys().map(|file| named(file)).collect()))
        .collect();
    let expected: Vec<(String, Vec<String>)> =
        [("a.rs", &["b/c.rs", "b/mod.rs"][..]), ("b/c.rs", &["d.rs"]), ("d.rs", &["a.rs"])]
            .map(|(file, imported)| {
                (file.to_owned(), imported.iter().copied().map(String::from).collect())
            })
            .into();
    assert_eq!(found, expected);
    assert!(long_circles(&imports).is_empty(), "three files are allowed");
}

/// The files at the roots of this repository's libraries and programs.
fn roots() -> Vec<PathBuf> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap().iter();
    let targets = packages.flat_map(|package| package["targets"].as_array().unwrap());
    let is_product = |target: &&Value| {
        target["kind"] == "lib" || target["kind"][0] == "lib" || target["kind"][0] == "bin"
    };
    targets
        .filter(is_product)
        .map(|target| PathBuf::from(target["src_path"].as_str().unwrap()))
        .collect()
}

/// The names from a crate's root to a module.
type ModulePath = Vec<String>;

/// The modules of a crate.
struct Crate(BTreeMap<ModulePath, Module>);

#[derive(Default)]
struct Module {
    file: PathBuf,
    children: BTreeSet<String>,
    /// Names that are defined here.
    items: BTreeSet<String>,
    /// Names that a `use` binds here, with their paths.
    bindings: BTreeMap<String, Vec<String>>,
    globs: Vec<Vec<String>>,
    /// Paths in the code that name items of other modules.
    paths: Vec<Vec<String>>,
    /// Exports of items, which are imports only if the code names them too.
    exports: Vec<(String, Vec<String>)>,
    /// All words of the code outside of `use`.
    words: BTreeSet<String>,
}

/// For each file, the files that it imports with a path that says so.
type Imports = BTreeMap<PathBuf, BTreeMap<PathBuf, String>>;

/// What a path leads to.
enum Target {
    Module(ModulePath),
    Item(PathBuf),
}

impl Crate {
    fn read(root: &Path) -> Self {
        let mut this = Self(BTreeMap::new());
        this.read_file(root, root.parent().unwrap(), &[]);
        this
    }

    /// Reads a module whose children are in `folder`.
    fn read_file(&mut self, file: &Path, folder: &Path, path: &[String]) {
        let text =
            fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let tokens: TokenStream =
            text.parse().unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        self.read_module(tokens, file, folder, path);
    }

    fn read_module(&mut self, tokens: TokenStream, file: &Path, folder: &Path, path: &[String]) {
        let mut module = Module { file: file.to_owned(), ..Module::default() };
        let tokens = without_tests(tokens);
        let mut inner = Vec::new();
        module.scan(&tokens, true, &mut inner);
        self.0.insert(path.to_vec(), module);
        for Child { name, body, path_attribute } in inner {
            let child = [path, std::slice::from_ref(&name)].concat();
            let child_folder = folder.join(&name);
            match (body, path_attribute) {
                (Some(body), _) => self.read_module(body, file, &child_folder, &child),
                (None, Some(other)) => {
                    let other = file.parent().unwrap().join(other);
                    self.read_file(&other, other.parent().unwrap(), &child);
                }
                (None, None) => {
                    let flat = folder.join(format!("{name}.rs"));
                    let nested = child_folder.join("mod.rs");
                    let file = if flat.exists() { flat } else { nested };
                    self.read_file(&file, &child_folder, &child);
                }
            }
        }
    }

    fn imports(&self) -> Imports {
        let mut imports = Imports::new();
        for (at, module) in &self.0 {
            let exports = module.exports.iter().filter(|(name, _)| module.words.contains(name));
            for path in exports.map(|(_, path)| path).chain(&module.paths).chain(&module.globs) {
                let file = match self.resolve(at, path, 0) {
                    Some(Target::Item(file)) => file,
                    Some(Target::Module(glob)) if module.globs.contains(path) => {
                        self.0[&glob].file.clone()
                    }
                    _ => continue,
                };
                if file != module.file {
                    let imported = imports.entry(module.file.clone()).or_default();
                    imported.entry(file).or_insert_with(|| path.join("::"));
                }
            }
        }
        imports
    }

    /// What `path` means in the module `at`; `None` if it leads out of the crate.
    fn resolve(&self, at: &[String], path: &[String], depth: u32) -> Option<Target> {
        let (first, rest) = path.split_first()?;
        let module = self.0.get(at)?;
        match first.as_str() {
            "crate" => self.follow(Vec::new(), rest, depth),
            "self" => self.follow(at.to_vec(), rest, depth),
            "super" => match rest.first().map(String::as_str) {
                Some("super") => self.resolve(&at[..at.len().checked_sub(1)?], rest, depth),
                _ => self.follow(at[..at.len().checked_sub(1)?].to_vec(), rest, depth),
            },
            name if module.children.contains(name) || module.bindings.contains_key(name) => {
                self.follow(at.to_vec(), path, depth)
            }
            _ => None,
        }
    }

    /// What `path` means below the module `at`.
    fn follow(&self, at: ModulePath, path: &[String], depth: u32) -> Option<Target> {
        // Exports of exports end sometime, unless two globs export each other.
        if depth > 20 {
            return None;
        }
        let Some((name, rest)) = path.split_first() else { return Some(Target::Module(at)) };
        let module = self.0.get(&at)?;
        if module.children.contains(name) {
            return self.follow([at, vec![name.clone()]].concat(), rest, depth + 1);
        }
        if module.items.contains(name) {
            return Some(Target::Item(module.file.clone()));
        }
        if let Some(binding) = module.bindings.get(name) {
            let target = if binding[0] == *name && !self.is_local(&at, binding) {
                None
            } else {
                self.resolve(&at, binding, depth + 1)
            };
            return match target? {
                Target::Module(module) => self.follow(module, rest, depth + 1),
                item @ Target::Item(_) => Some(item),
            };
        }
        for glob in &module.globs {
            if let Some(Target::Module(source)) = self.resolve(&at, glob, depth + 1)
                && self.exports(&source, name, depth + 1)
            {
                return self.follow(source, path, depth + 1);
            }
        }
        // Made by a macro.
        Some(Target::Item(module.file.clone()))
    }

    /// Whether a path that begins with its own name, as `use jobs::jobs`, starts at a module here.
    fn is_local(&self, at: &[String], path: &[String]) -> bool {
        self.0[at].children.contains(&path[0])
    }

    fn exports(&self, at: &[String], name: &str, depth: u32) -> bool {
        let module = &self.0[at];
        let has = module.children.contains(name)
            || module.items.contains(name)
            || module.bindings.contains_key(name);
        has || depth < 20
            && module.globs.iter().any(|glob| match self.resolve(at, glob, depth + 1) {
                Some(Target::Module(source)) => self.exports(&source, name, depth + 1),
                _ => false,
            })
    }
}

struct Child {
    name: String,
    body: Option<TokenStream>,
    path_attribute: Option<String>,
}

impl Module {
    /// Scans code. `is_top` says that its items are items of the module.
    fn scan(&mut self, tokens: &[TokenTree], is_top: bool, children: &mut Vec<Child>) {
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
fn without_tests(tokens: TokenStream) -> Vec<TokenTree> {
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

/// For each group of files that import each other, the shortest circle that is too long.
fn long_circles(imports: &Imports) -> Vec<Vec<&PathBuf>> {
    let mut circles: Vec<Vec<&PathBuf>> = Vec::new();
    for start in imports.keys() {
        let is_known = circles.iter().any(|circle| {
            is_reachable(imports, start, circle[0]) && is_reachable(imports, circle[0], start)
        });
        if is_known {
            continue;
        }
        circles.extend(long_circle(imports, start));
    }
    circles
}

/// A circle of more than [`LONGEST`] files through `start`: the shortest one.
fn long_circle<'a>(imports: &'a Imports, start: &'a PathBuf) -> Option<Vec<&'a PathBuf>> {
    let mut shortest: Option<Vec<&PathBuf>> = None;
    let mut beginnings = vec![vec![start]];
    for _ in 0..LONGEST {
        beginnings = beginnings
            .into_iter()
            .flat_map(|beginning| {
                let next = successors(imports, beginning[beginning.len() - 1]);
                next.filter(|file| !beginning.contains(file))
                    .map(|file| [&beginning[..], &[file]].concat())
                    .collect::<Vec<_>>()
            })
            .collect();
    }
    for beginning in beginnings {
        let (last, before) = beginning.split_last().unwrap();
        let Some(back) = way(imports, last, start, &before[1..]) else { continue };
        let circle = [before, &back[..back.len() - 1]].concat();
        if shortest.as_ref().is_none_or(|shortest| circle.len() < shortest.len()) {
            shortest = Some(circle);
        }
    }
    shortest
}

fn successors<'a>(imports: &'a Imports, file: &Path) -> impl Iterator<Item = &'a PathBuf> {
    imports.get(file).into_iter().flat_map(BTreeMap::keys)
}

fn is_reachable(imports: &Imports, from: &PathBuf, to: &PathBuf) -> bool {
    way(imports, from, to, &[]).is_some()
}

/// The shortest way that passes none of the files in `avoided`.
fn way<'a>(
    imports: &'a Imports,
    from: &'a PathBuf,
    to: &PathBuf,
    avoided: &[&PathBuf],
) -> Option<Vec<&'a PathBuf>> {
    let mut ways = VecDeque::from([vec![from]]);
    let mut seen: BTreeSet<&PathBuf> = avoided.iter().copied().collect();
    while let Some(way) = ways.pop_front() {
        let last = way[way.len() - 1];
        if last == to {
            return Some(way);
        }
        for file in successors(imports, last) {
            if seen.insert(file) {
                ways.push_back([&way[..], &[file]].concat());
            }
        }
    }
    None
}

/// The circle with the paths that close it.
fn describe(circle: &[&PathBuf], imports: &Imports) -> String {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let named =
        |file: &PathBuf| file.strip_prefix(repository).unwrap_or(file).display().to_string();
    let next = circle.iter().cycle().skip(1);
    let steps = circle.iter().zip(next).map(|(file, imported)| {
        format!("  {} imports {} of {}", named(file), imports[*file][*imported], named(imported))
    });
    steps.collect::<Vec<_>>().join("\n")
}
