//! Checks the crates in the program: licences, sources, and crates that must occur only once.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// The allowed licences of a dependency, alone or together.
const LICENCES: [&str; 9] = [
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "MIT",
    "MPL-2.0",
    "Unicode-3.0",
    "Zlib",
];

/// A second version of these would double the build, or split a type into two.
const ONCE: [&str; 9] =
    ["arrow-array", "axum", "burn", "parquet", "ring", "rustls", "serde", "sqlx", "tokio"];

/// rustls with `ring` computes TLS to databases and object stores. In front of the server a proxy
/// does.
const ABSENT: [&str; 4] = ["aws-lc-rs", "aws-lc-sys", "native-tls", "openssl-sys"];

/// A package that is part of the program or of its build.
struct Package {
    name: String,
    version: String,
    /// Its source, if it does not come from the registry.
    place: Option<String>,
    licence: String,
}

/// The packages by `cargo tree` for this platform. `cargo metadata` would also list packages that
/// are never compiled.
fn packages() -> Vec<Package> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--workspace", "--offline", "--locked", "--edges", "normal,build"])
        .args(["--target", "x86_64-unknown-linux-gnu", "--prefix", "none", "--format", "{p}|{l}"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let lines: BTreeSet<&str> = text.lines().filter(|line| !line.is_empty()).collect();
    let packages: Vec<Package> = lines.into_iter().map(package).collect();
    assert!(packages.len() > 100, "{text}");
    packages
}

/// Parses `NAME vVERSION (PLACE)|LICENCE (*)`. There may be a `(proc-macro)` before the place.
fn package(line: &str) -> Package {
    let (package, licence) = line.rsplit_once('|').unwrap();
    let mut words = package.split_whitespace().filter(|word| *word != "(proc-macro)");
    Package {
        name: words.next().unwrap().to_owned(),
        version: words.next().unwrap().to_owned(),
        place: words.next().map(str::to_owned),
        licence: licence.trim_end_matches("(*)").trim().to_owned(),
    }
}

#[test]
fn every_dependency_comes_under_a_licence_that_is_fine() {
    let refused: Vec<String> = packages()
        .iter()
        .filter(|package| !is_fine(&package.licence))
        .map(|Package { name, version, licence, .. }| format!("{name} {version}: {licence:?}"))
        .collect();
    assert!(refused.is_empty(), "{refused:#?}");
}

#[test]
fn every_dependency_comes_from_the_registry_or_lies_here() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().canonicalize().unwrap();
    for Package { name, place, .. } in packages() {
        let Some(place) = place else { continue };
        let folder = Path::new(place.trim_matches(['(', ')'])).canonicalize();
        assert!(folder.is_ok_and(|folder| folder.starts_with(&here)), "{name} is from {place}");
    }
}

#[test]
fn large_crates_come_once_and_tls_in_one_way() {
    let mut versions: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for Package { name, version, .. } in packages() {
        versions.entry(name).or_default().insert(version);
    }
    for single in ONCE {
        let found = versions.get(single).cloned().unwrap_or_default();
        assert_eq!(found.len(), 1, "{single}: {found:?}");
    }
    for absent in ABSENT {
        assert_eq!(versions.get(absent), None, "{absent}");
    }
}

/// Whether [`LICENCES`] satisfy an SPDX expression.
fn is_fine(expression: &str) -> bool {
    // Old manifests write "MIT/Apache-2.0".
    let expression = expression.replace('/', " OR ");
    let spaced = expression.replace('(', " ( ").replace(')', " ) ");
    let mut words = spaced.split_whitespace().peekable();
    any(&mut words) && words.next().is_none()
}

type Words<'a> = std::iter::Peekable<std::str::SplitWhitespace<'a>>;

/// Reads every side, even if an earlier one is satisfied.
fn any(words: &mut Words<'_>) -> bool {
    let mut fine = all(words);
    while words.next_if_eq(&"OR").is_some() {
        fine |= all(words);
    }
    fine
}

fn all(words: &mut Words<'_>) -> bool {
    let mut fine = one(words);
    while words.next_if_eq(&"AND").is_some() {
        fine &= one(words);
    }
    fine
}

fn one(words: &mut Words<'_>) -> bool {
    if words.next_if_eq(&"(").is_some() {
        let fine = any(words);
        return fine && words.next() == Some(")");
    }
    let mut licence = words.next().unwrap_or_default().to_owned();
    if words.next_if_eq(&"WITH").is_some() {
        licence = format!("{licence} WITH {}", words.next().unwrap_or_default());
    }
    LICENCES.contains(&licence.as_str())
}

/// The features of each package in a build.
fn features(what: &[&str]) -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--target", "x86_64-unknown-linux-gnu"])
        .args(["--prefix", "none", "--format", "{p}|{f}"])
        .args(what)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let mut found: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for line in text.lines().filter(|line| !line.is_empty()) {
        // There are headings between the kinds of dependencies.
        let Some((package, features)) = line.split_once('|') else { continue };
        let features = features.trim_end_matches("(*)").trim().split(',').map(str::to_owned);
        found.entry(package.to_owned()).or_default().extend(features);
    }
    found
}

/// If a dependency of tests enables a feature that the program does not use, arrow, parquet or burn
/// are built a second time. So the manifest of `torqued` asks for such features, too. With
/// `UPDATE=1`, this test writes its lines.
#[test]
fn the_program_and_its_tests_are_made_from_one_build() {
    if std::env::var_os("UPDATE").is_some() {
        let mut shared = BTreeMap::new();
        write_shared_features(&shared);
        // A feature of one package may ask for packages that the program did not have before.
        for (package, features) in
            std::iter::repeat_with(missing_features).take_while(|more| !more.is_empty()).flatten()
        {
            shared.entry(package).or_insert_with(BTreeSet::new).extend(features);
            write_shared_features(&shared);
        }
    }
    let missing = missing_features();
    assert!(missing.is_empty(), "with UPDATE=1 this test adds these features: {missing:#?}");
}

/// The features that tests enable in packages of the program and the program does not.
fn missing_features() -> BTreeMap<String, BTreeSet<String>> {
    let tests = features(&["--workspace", "--edges", "all"]);
    let program = features(&["--package", "torqued", "--edges", "normal,build"]);
    program
        .into_iter()
        .filter_map(|(package, features)| {
            let more: BTreeSet<_> = tests.get(&package)?.difference(&features).cloned().collect();
            (!more.is_empty()).then_some((package, more))
        })
        .collect()
}

/// Replaces the lines between the markers of the root manifest. Packages are `NAME vVERSION`.
fn write_shared_features(packages: &BTreeMap<String, BTreeSet<String>>) {
    const BEGIN: &str = "# BEGIN shared features\n";
    const END: &str = "# END shared features\n";
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.toml");
    let manifest = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = manifest.split_once(BEGIN).unwrap();
    let (_, after) = rest.split_once(END).unwrap();
    let lines: String =
        packages.iter().map(|(package, features)| line(package, features)).collect();
    std::fs::write(path, format!("{before}{BEGIN}{lines}{END}{after}")).unwrap();
}

/// The line of a manifest that asks a package, with any compatible version, for more features.
fn line(package: &str, features: &BTreeSet<String>) -> String {
    let (name, version) = package.split_once(" v").unwrap();
    let parts: Vec<&str> = version.splitn(3, '.').collect();
    let compatible = if parts[0] == "0" { parts[..2].join(".") } else { parts[0].to_owned() };
    let features: Vec<String> = features.iter().map(|feature| format!("{feature:?}")).collect();
    let features = features.join(", ");
    format!(
        "{name} = {{ version = \"{compatible}\", default-features = false, features = [{features}] }}\n"
    )
}

/// Rust calls the generic code of an unoptimised dependency instead of compiling it again. With the
/// specs unoptimised, answers of the server took up to 1.5 times as much processor time.
#[test]
fn server_and_store_depend_on_nothing_that_is_unoptimised() {
    let manifest = include_str!("../../Cargo.toml");
    let unoptimised: BTreeSet<&str> = manifest
        .lines()
        .filter_map(|line| line.strip_prefix("package.")?.strip_suffix(".opt-level = 0"))
        .collect();
    assert!(unoptimised.contains("executors"), "{unoptimised:?}");
    let server = features(&["--package", "api", "--package", "store", "--edges", "normal"]);
    let slow: Vec<&String> = server
        .keys()
        .filter(|package| package.split(' ').next().is_some_and(|name| unoptimised.contains(name)))
        .collect();
    assert!(server.len() > 100 && slow.is_empty(), "{slow:?}");
}

#[test]
fn an_expression_of_licences_is_read_as_spdx_means_it() {
    assert!(is_fine("MIT") && is_fine("MIT/Apache-2.0") && is_fine("GPL-3.0 OR MIT"));
    assert!(is_fine("(MIT OR GPL-3.0) AND Unicode-3.0"));
    assert!(is_fine("Apache-2.0 WITH LLVM-exception OR GPL-2.0"));
    for refused in ["", "GPL-3.0", "MIT AND GPL-3.0", "(MIT", "MIT MIT", "MIT WITH Classpath"] {
        assert!(!is_fine(refused), "{refused}");
    }
}
