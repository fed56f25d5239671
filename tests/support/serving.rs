//! A page of small files, which `kilwa serve` and `kilwa publish` need in a test, and the address that a server prints.

use kilwa_archive::viewer::Page;
use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::path::Path;
use std::process::Child;

/// Files that a built page can do without.
const MORE: [&str; 3] = ["app.js", "icons/kilwa.svg", "icons/sprite.svg"];
/// Those that are written into other pages, as they are.
const TRUE: [&str; 4] = ["index.html", "style.css", "plain/plain.css", "plain/plain.js"];

/// A page in `www`; where the content of a file does not matter here, it is the file's name.
pub(crate) fn page(www: &Path) {
    for folder in ["plain", "icons"] {
        std::fs::create_dir_all(www.join(folder)).unwrap();
    }
    for name in Page::NEEDED.into_iter().chain(MORE) {
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
