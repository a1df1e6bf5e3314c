//! The modules of a crate, and the imports among their files.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::TokenStream;

use crate::scan::{Child, Module, without_tests};

/// The names from a crate's root to a module.
type ModulePath = Vec<String>;

/// The modules of a crate.
pub struct Crate(BTreeMap<ModulePath, Module>);

/// For each file, the files that it imports with a path that says so.
pub type Imports = BTreeMap<PathBuf, BTreeMap<PathBuf, String>>;

/// What a path leads to.
enum Target {
    Module(ModulePath),
    Item(PathBuf),
}

impl Crate {
    pub fn read(root: &Path) -> Self {
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

    pub fn imports(&self) -> Imports {
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
