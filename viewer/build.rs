//! Strips comments and indentation from the shaders, so that the page loads faster over a slow connection.

use std::path::Path;
use std::{env, fs};

fn main() {
    let shaders = Path::new("../shaders");
    println!("cargo::rerun-if-changed={}", shaders.display());
    let out = env::var("OUT_DIR").expect("cargo sets OUT_DIR for build scripts");
    for entry in fs::read_dir(shaders).expect("the folder `shaders` is beside the viewer's") {
        let path = entry.expect("the folder shaders can be read").path();
        if path.extension().is_some_and(|e| e == "wgsl") {
            let text = fs::read_to_string(&path).expect("a shader can be read");
            let name = path.file_name().expect("a shader has a name");
            fs::write(Path::new(&out).join(name), without_comments(&text)).expect("a shader can be written");
        }
    }
}

/// WGSL has no string literals, so `//` always begins a comment. Block comments are not allowed in the shaders.
fn without_comments(text: &str) -> String {
    assert!(!text.contains("/*"), "comments in the shaders begin with //");
    let lines = text.lines().map(|line| line.split_once("//").map_or(line, |(code, _)| code).trim());
    lines.filter(|line| !line.is_empty()).flat_map(|line| [line, "\n"]).collect()
}
