//! `kilwa metadata edit`: a form for one metadata file, in the browser of whoever runs the program.

use super::of_pack;
use crate::source::open_pack;
use anyhow::Context as _;
use kilwa_server::metadata_form::{Editor, serve_form};
use std::io::Write as _;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Serve the form until its user is done with it, or Ctrl-C.
pub(super) fn run(file: &Path, pack: Option<&PathBuf>) -> anyhow::Result<()> {
    let known = pack.map(|path| anyhow::Ok(of_pack(open_pack(path)?.metadata()))).transpose()?;
    let editor = Arc::new(Editor::open(file, known)?);
    if editor.is_read_only() {
        crate::terminal::say!(
            "kilwa: {} is read-only: you can view it, but not save until it is writable",
            file.display()
        );
    }
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    let runtime = builder.worker_threads(2).enable_all().build().context("cannot start threads")?;
    let served = runtime.block_on(serve(file, Arc::clone(&editor)));
    runtime.shutdown_timeout(Duration::from_millis(200));
    served?;
    let mut out = crate::terminal::out();
    let written = editor.written();
    if written.is_empty() {
        writeln!(out, "Nothing was written")?;
    }
    for path in written {
        writeln!(
            out,
            "{} was written; next: kilwa publish PACK --to DIR --metadata {}",
            path.display(),
            path.display()
        )?;
    }
    Ok(())
}

async fn serve(file: &Path, editor: Arc<Editor>) -> anyhow::Result<()> {
    // Never an address that other computers reach: the form writes a file.
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let listener = tokio::net::TcpListener::bind(address).await.context("cannot listen on 127.0.0.1")?;
    let address = listener.local_addr()?;
    writeln!(
        crate::terminal::out(),
        "Open http://{address}/{}/ in a browser on this computer to edit {} (Ctrl-C stops)",
        editor.secret(),
        file.display()
    )?;
    Ok(serve_form(listener, editor, crate::serve::stop()).await?)
}
