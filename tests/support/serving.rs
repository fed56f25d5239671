//! What `kilwa serve` and `kilwa publish` need in a test: a page of small files, and the address that a server says.

use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::path::Path;
use std::process::Child;

/// Files of a built page whose content does not matter here.
const MADE: [&str; 10] = [
    "app.js",
    "boot.js",
    "viewer.js",
    "viewer_bg.wasm",
    "viewer-gl.js",
    "viewer-gl_bg.wasm",
    "decode.js",
    "decode_bg.wasm",
    "icons/kilwa.svg",
    "icons/sprite.svg",
];
/// Those that are written into other pages, as they are.
const TRUE: [&str; 4] = ["index.html", "style.css", "plain/plain.css", "plain/plain.js"];

/// A page in `www`.
pub(crate) fn page(www: &Path) {
    for folder in ["plain", "icons"] {
        std::fs::create_dir_all(www.join(folder)).unwrap();
    }
    for name in MADE {
        std::fs::write(www.join(name), name).unwrap();
    }
    for name in TRUE {
        std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("www").join(name), www.join(name)).unwrap();
    }
}

/// The address that a server prints when it listens. Its standard output is a pipe.
pub(crate) fn address(child: &mut Child) -> SocketAddr {
    let mut line = String::new();
    BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    let address = line.split("http://").nth(1).and_then(|rest| rest.split('/').next());
    address.unwrap_or_else(|| panic!("no address: {line}")).parse().unwrap()
}
