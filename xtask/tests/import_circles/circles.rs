//! Circles in a graph of imports.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use crate::modules::Imports;

/// The largest number of files in a circle.
const LONGEST: usize = 3;

/// For each group of files that import each other, the shortest circle that is too long.
pub fn long_circles(imports: &Imports) -> Vec<Vec<&PathBuf>> {
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
pub fn describe(circle: &[&PathBuf], imports: &Imports) -> String {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let named =
        |file: &PathBuf| file.strip_prefix(repository).unwrap_or(file).display().to_string();
    let next = circle.iter().cycle().skip(1);
    let steps = circle.iter().zip(next).map(|(file, imported)| {
        format!("  {} imports {} of {}", named(file), imports[*file][*imported], named(imported))
    });
    steps.collect::<Vec<_>>().join("\n")
}
