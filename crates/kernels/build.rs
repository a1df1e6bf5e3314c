//! Compiles the bridge to PyTorch's libraries, if the feature `torch` asks for it.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    #[cfg(feature = "torch")]
    bridge();
}

#[cfg(feature = "torch")]
fn bridge() {
    use std::path::PathBuf;

    const SOURCE: &str = "src/torch/bridge.cpp";
    println!("cargo:rerun-if-changed={SOURCE}");
    // torch-sys has found PyTorch, and says where.
    let libraries = PathBuf::from(std::env::var_os("DEP_TCH_LIBTORCH_LIB").unwrap_or_default());
    let include = libraries.with_file_name("include");
    cc::Build::new()
        .cpp(true)
        .std("c++17")
        .warnings(false)
        .include(include.join("torch/csrc/api/include"))
        .include(include)
        .file(SOURCE)
        .compile("torqued_torch_bridge");
}
