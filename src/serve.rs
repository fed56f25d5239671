//! `kilwa serve`.

use anyhow::Context;
use kilwa_server::{Catalogue, Limits, Page, Site, app, listen};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

/// Serve packs and the viewer page.
///
/// Lists the packs of a folder as pages that anyone with the address can look at, and streams them to the browser.
/// Stops at Ctrl-C or SIGTERM.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A folder with packs (`*.kilwa`), or one pack.
    #[arg(value_name = "DIR")]
    path: PathBuf,
    /// Address and port to listen on; 0.0.0.0 makes it reachable from other machines, port 0 takes a free one.
    #[arg(long, default_value = "127.0.0.1:8080", value_name = "ADDRESS:PORT")]
    listen: SocketAddr,
    /// Take the viewer page from this folder (a built www/dist) instead of the one in this program.
    #[arg(long, value_name = "DIR")]
    www: Option<PathBuf>,
    /// Connections at once; further ones wait.
    #[arg(long, default_value_t = 1024, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    connections: u32,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| "warn".into());
    // A second subscriber (in a test that serves twice) is no reason to fail.
    drop(tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).try_init());
    let page = Page::load(args.www.as_deref())?;
    let catalogue = Arc::new(Catalogue::open(&args.path)?);
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().context("cannot start threads")?;
    runtime.block_on(async {
        let listener = match tokio::net::TcpListener::bind(args.listen).await {
            Err(e) if e.kind() == std::io::ErrorKind::AddrInUse => anyhow::bail!(
                "{} is in use by another program; stop it or give another port, for example --listen {}:0",
                args.listen,
                args.listen.ip()
            ),
            bound => bound.with_context(|| format!("cannot listen on {}", args.listen))?,
        };
        let address = listener.local_addr()?;
        let models = catalogue.models();
        for model in &models {
            if let Err(why) = &model.summary {
                eprintln!("{}: {why}", model.file_name);
            }
        }
        println!("Serving {} at http://{address}/ (Ctrl-C stops)", count(models.len()));
        if let [model] = models.as_slice() {
            println!("  {}: http://{address}/m/{}", model.title(), model.slug);
        }
        let limits = Limits { connections: args.connections as usize, ..Limits::default() };
        listen(listener, app(Site { catalogue, page }), limits, stop()).await?;
        Ok(())
    })
}

fn count(models: usize) -> String {
    if models == 1 { "1 model".to_owned() } else { format!("{models} models") }
}

/// Resolves at Ctrl-C or SIGTERM.
async fn stop() {
    let interrupt = async {
        // Without a handler there is nothing to wait for; the system's default (to end) stays.
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    };
    #[cfg(unix)]
    let terminate = async {
        match tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate()) {
            Ok(mut s) => {
                s.recv().await;
            }
            Err(_) => std::future::pending().await,
        }
    };
    #[cfg(not(unix))]
    let terminate = std::future::pending::<()>();
    tokio::select! {
        () = interrupt => {}
        () = terminate => {}
    }
}
