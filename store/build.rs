//! Has the crate built again when a migration is added. The macro that embeds migrations does not
//! notice a new file.

fn main() {
    println!("cargo::rerun-if-changed=../migrations/sqlite");
}
