//! Says where the built page is. A release program embeds it (`cfg(embedded)`): `www/dist` where the page has been built, and an
//! empty folder where it has not, so that the server compiles on a machine that never built the page (it then says how). A page
//! without the places that the facts of a model are put into stops that build. Other programs, those of development and of the
//! tests, read `www/dist` when they run, so that a change of the page compiles nothing again.

use std::path::{Path, PathBuf};

#[path = "src/places.rs"]
mod places;

fn main() -> std::io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=src/places.rs");
    println!("cargo:rustc-check-cfg=cfg(embedded)");
    let here = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let www = here.join("../www");
    let built = www.join("dist");
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "debug") {
        println!("cargo:rustc-env=KILWA_PAGE={}", built.display());
        return Ok(());
    }
    println!("cargo:rustc-cfg=embedded");
    // Watching a path that does not exist would rebuild every time: watch the folder that it would appear in.
    let (page, watched) = if built.join("index.html").is_file() {
        let index = built.join("index.html");
        if let Err(why) = places::cut(&std::fs::read_to_string(&index)?) {
            let why = format!("{}: {why}; mend www/index.html and run `cargo xtask web`", index.display());
            return Err(std::io::Error::other(why));
        }
        (built.clone(), built)
    } else {
        let empty = Path::new(&std::env::var_os("OUT_DIR").unwrap_or_default()).join("no-page");
        std::fs::create_dir_all(&empty)?;
        (empty, www)
    };
    println!("cargo:rerun-if-changed={}", watched.display());
    println!("cargo:rustc-env=KILWA_PAGE={}", page.display());
    Ok(())
}
