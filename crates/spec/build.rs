//! Lists the files of the folder `presets`, sorted by name. To add a preset, add a file.

use std::path::{Path, PathBuf};

fn main() {
    let here = std::env::var("CARGO_MANIFEST_DIR").expect("cargo says where the package is");
    let folder = Path::new(&here).join("presets");
    println!("cargo::rerun-if-changed={}", folder.display());
    let entries = std::fs::read_dir(&folder).expect("the folder of presets can be read");
    let mut files: Vec<PathBuf> =
        entries.map(|entry| entry.expect("a file of the folder").path()).collect();
    files.sort();
    let includes: String = files
        .iter()
        .map(|file| {
            format!("({:?}, include_str!({:?})),\n", file.file_stem().unwrap_or_default(), file)
        })
        .collect();
    let out = std::env::var("OUT_DIR").expect("cargo says where to write");
    let list = Path::new(&out).join("presets.rs");
    std::fs::write(list, format!("&[\n{includes}]")).expect("the list can be written");
}
