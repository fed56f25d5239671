//! `kilwa serve`.

use crate::new_file::PrivateFolder;
use anyhow::Context;
use kilwa_pack::plural::counted;
use kilwa_pack::visible::visible;
use kilwa_server::access::Sessions;
use kilwa_server::auth::Auth;
use kilwa_server::extracts::Extracts;
use kilwa_server::index::Index;
use kilwa_server::store::{Place, S3, S3Options};
use kilwa_server::upload::{UploadLimits, Uploads};
use kilwa_server::{
    Audience, Catalogue, Collections, Limits, Page, Policy, Site, SiteFile, Surveyed, app, listen, report_featured,
};
use std::io::Write as _;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Serve archive objects, packs and the viewer page, or a survey.
///
/// Lists the models of a folder as pages that anyone with the address can look at, and streams them to the browser. For a survey (`kilwa scans import`) it
/// shows a plan, a list of the stations, and a range, intensity or colour image of each. Stops at Ctrl-C or SIGTERM.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// A folder with archive objects (`kilwa publish`) and packs (`*.kilwa`), or one of either; a survey (a folder with survey.toml); or `s3://bucket/prefix`.
    #[arg(value_name = "DIR|s3://…")]
    path: PathBuf,
    /// Address and port to listen on; 0.0.0.0 makes it reachable from other machines, port 0 takes a free one.
    #[arg(long, default_value = "127.0.0.1:8080", value_name = "ADDRESS:PORT")]
    listen: SocketAddr,
    /// Use the viewer page of this folder (a built www/dist) instead of the one in this program.
    #[arg(long, value_name = "DIR")]
    www: Option<PathBuf>,
    #[command(flatten)]
    store: StoreArgs,
    #[command(flatten)]
    pages: PageArgs,
    #[command(flatten)]
    catalogue: CatalogueArgs,
    #[command(flatten)]
    extracts: ExtractArgs,
    #[command(flatten)]
    access: AccessArgs,
    #[command(flatten)]
    limits: LimitArgs,
    #[command(flatten)]
    reports: ReportArgs,
}

/// For `s3://bucket/prefix`. Keys and region come from the environment: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, AWS_REGION,
/// AWS_ENDPOINT_URL, AWS_VIRTUAL_HOSTED_STYLE_REQUEST; without keys only public files are read.
#[derive(clap::Args)]
#[command(next_help_heading = "Object storage (s3://…; keys from AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY)")]
struct StoreArgs {
    /// Address of a store that is not Amazon's (default: AWS_ENDPOINT_URL).
    #[arg(long = "s3-endpoint", value_name = "URL")]
    endpoint: Option<String>,
    /// Seconds that each step of a request to the store may take.
    #[arg(long = "s3-timeout", default_value_t = 10, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=600))]
    timeout: u64,
    /// Seconds after which the list of objects is requested again.
    #[arg(long = "s3-refresh", default_value_t = 30, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=86_400))]
    refresh: u64,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Other sites")]
struct PageArgs {
    /// Sites that may show the pages in a frame: origins, `self`, `none` or `*` (default: self).
    #[arg(long, value_name = "ORIGIN", num_args = 1.., value_delimiter = ' ')]
    frame_ancestors: Vec<String>,
    /// Further origins whose pages may exchange messages with an embedded viewer; `*` for all.
    #[arg(long, value_name = "ORIGIN", num_args = 1.., value_delimiter = ' ')]
    origins: Vec<String>,
    /// Other hosts that the viewer may fetch packs from.
    #[arg(long, value_name = "ORIGIN", num_args = 1.., value_delimiter = ' ')]
    pack_origins: Vec<String>,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Catalogue")]
struct CatalogueArgs {
    /// Where to keep the index of the catalogue, which is made from the folder and can be deleted at any time (default: in memory).
    #[arg(long, value_name = "FILE")]
    index: Option<PathBuf>,
    /// Public address of the site, such as https://museum.example (default: as each request names it).
    #[arg(long, value_name = "URL")]
    url: Option<String>,
    /// The file that says which models belong together (default: collections.toml beside the objects, in the folder or the store).
    #[arg(long, value_name = "FILE")]
    collections: Option<PathBuf>,
    /// The file that describes the institution: name, logo, introduction, featured models (default: site.toml beside the objects, in the folder or the store).
    #[arg(long, value_name = "FILE")]
    site: Option<PathBuf>,
    /// Mail address for questions about harvesting (default: webmaster at the site).
    #[arg(long, value_name = "ADDRESS")]
    contact: Option<String>,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Extracts")]
struct ExtractArgs {
    /// Where to keep meshes requested by readers; they can be deleted at any time (default: kilwa/extracts in the user's cache folder).
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Megabytes that these may use; the oldest are deleted. 0: no mesh is made on request.
    #[arg(long, default_value_t = 4096, value_name = "MB")]
    cache_size: u64,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Access")]
struct AccessArgs {
    /// Accounts with access to models that are not public: a file made by `kilwa access init` (default: none).
    #[arg(long, value_name = "FILE")]
    access: Option<PathBuf>,
    /// Keep sessions in this folder, so that they survive a restart and servers can share them (default: in memory).
    #[arg(long, value_name = "DIR", requires = "access")]
    sessions: Option<PathBuf>,
    /// Append to this file who was granted or denied access to what.
    #[arg(long, value_name = "FILE", requires = "access")]
    audit: Option<PathBuf>,
    /// Accept versions uploaded (`kilwa publish --to https://…`) by users with a token for it.
    #[arg(long, requires = "access")]
    accept_uploads: bool,
    /// With `s3://…`: where on this computer uploads are kept until they are verified and in the store (default: uploads in the service's state folder under
    /// systemd).
    #[arg(long, value_name = "DIR", requires = "accept_uploads")]
    upload_folder: Option<PathBuf>,
    /// Largest version that is accepted, gigabytes.
    #[arg(long, default_value_t = 1000, value_name = "GB", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    upload_limit: u64,
    /// Days for which an interrupted upload is kept.
    #[arg(long, default_value_t = 7, value_name = "DAYS", value_parser = clap::value_parser!(u32).range(1..=365))]
    upload_days: u32,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Limits")]
struct LimitArgs {
    /// Connections at once. For further ones idle ones are closed, otherwise they wait.
    #[arg(long, default_value_t = 4096, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    connections: u32,
    /// Connections at once from one address (an IPv6 /64); 0 for no limit. Further ones get status 503.
    #[arg(long, default_value_t = 256, value_name = "N")]
    connections_per_address: u32,
    /// Seconds within which the headers of a request must arrive; also the longest pause between two requests of a connection.
    #[arg(long, default_value_t = 10, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=3600))]
    header_timeout: u64,
    /// Seconds after which a response that the client does not read is aborted.
    #[arg(long, default_value_t = 30, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=3600))]
    write_timeout: u64,
    /// Seconds that running transfers may take to finish when the server stops.
    #[arg(long, default_value_t = 5, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(0..=3600))]
    shutdown: u64,
}

#[derive(clap::Args)]
#[command(next_help_heading = "Reports")]
struct ReportArgs {
    /// Format of the log on standard error; RUST_LOG selects its contents.
    #[arg(long, value_enum, default_value_t = LogForm::Text, value_name = "FORM")]
    log: LogForm,
    /// Log a line for every request, without its query.
    #[arg(long)]
    access_log: bool,
    /// Who gets /metrics.
    #[arg(long, value_enum, default_value_t = MetricsFor::Local, value_name = "WHOM")]
    metrics: MetricsFor,
    /// The server is behind your own proxy: the client is the last one in X-Forwarded-For, and connections per address are not limited.
    #[arg(long)]
    behind_proxy: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum LogForm {
    /// A line for people.
    Text,
    /// One JSON object a line.
    Json,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum MetricsFor {
    /// This computer, and nobody through a proxy.
    Local,
    /// Everyone.
    All,
    /// Nobody.
    None,
}

/// Threads that read files: enough for disks that are slow, few enough that a crowd costs no memory.
const READERS: usize = 64;
/// The same for a store, where each waits for the network.
const STORE_READERS: usize = 256;
/// A step of sending a version to a store may take so long.
const UPLOAD_PATIENCE: Duration = Duration::from_secs(120);

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    log(&args.reports);
    let p = &args.pages;
    let policy = Policy::new(&p.frame_ancestors, &p.origins, &p.pack_origins)?;
    let page = Page::load(args.www.as_deref())?;
    let survey = survey(args)?;
    let (catalogue, index) = archive(args)?;
    let mut site = Site::new(catalogue, page.clone()).with_policy(policy);
    site.survey = survey;
    site.uploads = uploads(args, &site, page)?;
    site.index = index;
    site.url = args.catalogue.url.as_deref().map(site_url).transpose()?;
    site.contact.clone_from(&args.catalogue.contact);
    let beside = || site.catalogue.shelf().map(Collections::beside);
    site.collections = args.catalogue.collections.clone().map(Collections::new).or_else(beside).map(Arc::new);
    let institution = args.catalogue.site.clone().map(SiteFile::new);
    site.institution = institution.or_else(|| site.catalogue.shelf().map(SiteFile::beside)).map(Arc::new);
    let cache = if site.survey.is_some() { None } else { extracts(&args.extracts)? };
    site.extracts = cache.as_ref().map(|(_, extracts)| Arc::clone(extracts));
    site.auth = auth(&args.access, &args.path)?;
    site.behind_proxy = args.reports.behind_proxy;
    site.metrics_for = match args.reports.metrics {
        MetricsFor::Local => Audience::Local,
        MetricsFor::All => Audience::All,
        MetricsFor::None => Audience::None,
    };
    let limits = limits(args);
    let readers = if store_url(args).is_some() { STORE_READERS } else { READERS };
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    let runtime = builder.enable_all().max_blocking_threads(readers).build().context("cannot start threads")?;
    let served = runtime.block_on(serve(args.listen, site, limits));
    // A file that is being read for its hash need not be finished.
    runtime.shutdown_timeout(Duration::from_millis(200));
    served
}

/// The address of a store, where it is one that is served.
fn store_url(args: &Args) -> Option<&str> {
    args.path.to_str().filter(|path| path.starts_with("s3://"))
}

/// How the store is asked.
fn store_options(args: &Args, url: &str) -> S3Options {
    let mut options = S3Options::from_environment(url);
    options.endpoint.clone_from(&args.store.endpoint);
    options.timeout = Duration::from_secs(args.store.timeout);
    options.refresh = Duration::from_secs(args.store.refresh);
    options
}

/// The survey, where the folder is one.
fn survey(args: &Args) -> anyhow::Result<Option<Arc<Surveyed>>> {
    let path = &args.path;
    if path.file_name().is_some_and(|name| name == kilwa_scan::survey::FILE) && path.is_file() {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(std::path::Path::new("."));
        anyhow::bail!("{} is the file of a survey; serve its folder: kilwa serve {}", path.display(), folder.display());
    }
    if !kilwa_scan::survey::is_survey(path) {
        return Ok(None);
    }
    // Who gives accounts expects that others are kept out.
    let unfit = [("--access", args.access.access.is_some()), ("--index", args.catalogue.index.is_some())];
    if let Some((option, _)) = unfit.into_iter().find(|(_, is_given)| *is_given) {
        anyhow::bail!(
            "{option} is for archive objects, but {} is a survey, which everyone who reaches the address can see; leave {option} out",
            path.display()
        );
    }
    Ok(Some(Arc::new(Surveyed::open(path)?)))
}

/// The folder, or the store, and the index of its objects, brought up to it.
fn archive(args: &Args) -> anyhow::Result<(Catalogue, Option<Arc<Index>>)> {
    let file = args.catalogue.index.as_deref();
    let Some(url) = store_url(args) else {
        let catalogue = Catalogue::open(&args.path)?;
        if kilwa_scan::survey::is_survey(&args.path) {
            return Ok((catalogue, None));
        }
        let index = catalogue.shelf().map(|shelf| index(shelf, file)).transpose()?;
        return Ok((catalogue, index));
    };
    let store = S3::open(&store_options(args, url))?;
    // The index first: it has what did not change since, which the list of models then need not ask for.
    let is_object = store.is_object().with_context(|| format!("cannot read {}", store.name()))?;
    let shelf = Place::Key(Arc::clone(&store), String::new());
    let index = if is_object { None } else { Some(index(&shelf, file)?) };
    Ok((Catalogue::of_store(&store)?, index))
}

/// The index of a place, brought up to it.
fn index(shelf: &Place, file: Option<&std::path::Path>) -> anyhow::Result<Arc<Index>> {
    let index = Index::of(shelf, file)?;
    if let Err(e) = index.refresh() {
        tracing::warn!("the catalogue cannot be searched: {e}");
    }
    Ok(Arc::new(index))
}

/// Where uploads go: into the folder that is served, or into the store by way of a folder of this computer.
fn uploads(args: &Args, site: &Site, page: Page) -> anyhow::Result<Option<Arc<Uploads>>> {
    let access = &args.access;
    if !access.accept_uploads {
        return Ok(None);
    }
    let version_bytes = access.upload_limit.saturating_mul(1_000_000_000);
    let limits = UploadLimits {
        version_bytes,
        staged_bytes: version_bytes.saturating_mul(2),
        days: access.upload_days,
        ..UploadLimits::default()
    };
    let what = "--accept-uploads needs a folder of objects or s3://bucket/prefix, not a single object or pack";
    let shelf = site.catalogue.shelf().context(what)?;
    if let Some(folder) = shelf.path() {
        anyhow::ensure!(
            access.upload_folder.is_none(),
            "--upload-folder works only with s3://…; for a folder, uploads are kept in its .kilwa-uploads"
        );
        return Ok(Some(Arc::new(Uploads::new(folder.to_owned(), page, limits))));
    }
    let folder = access.upload_folder.clone().or_else(|| service_folder("STATE_DIRECTORY", "uploads"));
    let folder = folder.context(
        "--accept-uploads with s3://… needs a folder on this computer with space for uploads until they are verified: use --upload-folder DIR",
    )?;
    // A part of a pack takes longer to send than readers are kept waiting.
    let mut options = store_options(args, store_url(args).unwrap_or_default());
    options.timeout = options.timeout.max(UPLOAD_PATIENCE);
    options.retries = 3;
    Ok(Some(Arc::new(Uploads::into_store(&folder, &S3::open(&options)?, page, limits)?)))
}

/// The cache of extracts, and the folder that goes with the program where there was no better place.
fn extracts(args: &ExtractArgs) -> anyhow::Result<Option<(Option<PrivateFolder>, Arc<Extracts>)>> {
    if args.cache_size == 0 {
        return Ok(None);
    }
    let (folder, own) = if let Some(folder) = args.cache.clone().or_else(cache_folder) {
        (folder, None)
    } else {
        let own = crate::new_file::private_folder("kilwa-extracts-");
        let own = own.context("cannot make a folder for extracts")?;
        (own.path().to_owned(), Some(own))
    };
    let bytes = args.cache_size.saturating_mul(1_000_000);
    match Extracts::open(folder.clone(), bytes) {
        Ok(extracts) => Ok(Some((own, extracts))),
        // A format that was asked for must be possible; others are left out.
        Err(e) if args.cache.is_some() => {
            Err(e).with_context(|| format!("cannot keep extracts in {}", folder.display()))
        }
        Err(e) => {
            tracing::warn!(
                "no meshes are made on request: cannot keep them in {}: {e}; use --cache DIR",
                folder.display()
            );
            Ok(None)
        }
    }
}

/// The service's cache folder under systemd, else the user's.
fn cache_folder() -> Option<PathBuf> {
    let folder = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let user = || {
        let base = folder("XDG_CACHE_HOME").or_else(|| folder("HOME").map(|home| home.join(".cache")))?;
        Some(base.join("kilwa/extracts"))
    };
    service_folder("CACHE_DIRECTORY", "extracts").or_else(user)
}

/// A folder in one that systemd gives the service.
fn service_folder(variable: &str, name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute())?;
    Some(folder.join(name))
}

/// The accounts, which must not be in the served folder.
fn auth(args: &AccessArgs, served: &std::path::Path) -> anyhow::Result<Option<Arc<Auth>>> {
    let Some(file) = &args.access else { return Ok(None) };
    // Checked before any of them is created.
    for secret in [Some(file), args.audit.as_ref(), args.sessions.as_ref()].into_iter().flatten() {
        if let (Ok(secret_at), Ok(served_at)) = (where_it_will_be(secret), served.canonicalize()) {
            anyhow::ensure!(
                !secret_at.starts_with(&served_at),
                "{} is in the folder that is served; move it elsewhere, for example to /etc/kilwa",
                secret.display()
            );
        }
    }
    if let Some(audit) = &args.audit {
        crate::new_file::refuse_inputs(audit, [file.as_path()])?;
    }
    let kept = |folder: &PathBuf| {
        Sessions::in_folder(folder).with_context(|| format!("cannot keep sessions in {}", folder.display()))
    };
    let sessions = args.sessions.as_ref().map(kept).transpose()?;
    let auth = Auth::open(file, args.audit.as_deref())?.with_sessions(sessions.unwrap_or_default());
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_secs());
    if let Some(doubt) = auth.doubt_of_clock(now) {
        tracing::error!("{doubt}");
    }
    Ok(Some(Arc::new(auth)))
}

/// The real path of a file or folder, which need not exist yet.
fn where_it_will_be(path: &std::path::Path) -> std::io::Result<PathBuf> {
    let mut at = PathBuf::new();
    for part in std::path::absolute(path)?.components() {
        if part == std::path::Component::ParentDir {
            at.pop();
        } else {
            at.push(part);
        }
        // A part that exists may be a link; one that does not exist is kept as it is.
        at = at.canonicalize().unwrap_or(at);
    }
    Ok(at)
}

/// An address that can be given to others.
fn site_url(url: &str) -> anyhow::Result<String> {
    let rest = url.strip_prefix("https://").or_else(|| url.strip_prefix("http://"));
    let is_plain =
        |rest: &str| !rest.is_empty() && rest.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._~:/[]".contains(&b));
    anyhow::ensure!(
        rest.is_some_and(is_plain),
        "--url {url} is not the address of a site; expected for example https://museum.example"
    );
    Ok(url.trim_end_matches('/').to_owned())
}

async fn serve(address: SocketAddr, site: Site, limits: Limits) -> anyhow::Result<()> {
    let listener = match tokio::net::TcpListener::bind(address).await {
        Err(e) if e.kind() == std::io::ErrorKind::AddrInUse => anyhow::bail!(
            "{address} is in use by another program; stop that program or use another port, for example --listen {}:0",
            address.ip()
        ),
        bound => bound.with_context(|| format!("cannot listen on {address}"))?,
    };
    let address = listener.local_addr()?;
    report_featured(&site).await;
    if let Some(survey) = &site.survey {
        let stations = counted(survey.stations(), "station", "stations");
        writeln!(crate::terminal::out(), "Serving a survey of {stations} at http://{address}/ (Ctrl-C stops)")?;
        let metrics = Arc::clone(&site.metrics);
        return Ok(listen(listener, app(site), metrics, limits, stop()).await?);
    }
    let models = site.catalogue.models();
    for model in &models {
        if let Err(why) = &model.summary {
            tracing::warn!("{}: {why}", model.file_name);
        }
    }
    writeln!(
        crate::terminal::out(),
        "Serving {} at http://{address}/ (Ctrl-C stops)",
        counted(models.len(), "model", "models")
    )?;
    if let [model] = models.as_slice() {
        writeln!(crate::terminal::out(), "  {}: http://{address}{}", visible(model.title()), model.page())?;
    }
    if models.is_empty() && site.uploads.is_none() {
        writeln!(
            crate::terminal::out(),
            "  There is nothing here yet: no archive object (kilwa publish), no pack (*.kilwa) and no survey (survey.toml, kilwa scans import). \
             Objects and packs that you put here appear without a restart."
        )?;
    }
    let metrics = Arc::clone(&site.metrics);
    listen(listener, app(site), metrics, limits, stop()).await?;
    Ok(())
}

fn log(args: &ReportArgs) {
    let usual = if args.access_log { "warn,kilwa::access=info" } else { "warn" };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| usual.into());
    let subscriber = tracing_subscriber::fmt().with_env_filter(filter);
    // A second subscriber (in a test that serves twice) is no reason to fail.
    drop(match args.log {
        LogForm::Text => subscriber.with_writer(crate::terminal::err).try_init(),
        LogForm::Json => subscriber.json().flatten_event(true).with_writer(crate::terminal::err_json).try_init(),
    });
}

/// The requested number of connections, or fewer if the system does not allow a process that many open files.
fn limits(args: &Args) -> Limits {
    let LimitArgs { connections, connections_per_address, header_timeout, write_timeout, shutdown } = args.limits;
    let per_address = if args.reports.behind_proxy { 0 } else { connections_per_address as usize };
    let mut limits = Limits {
        connections: connections as usize,
        per_address,
        headers: Duration::from_secs(header_timeout),
        stall: Duration::from_secs(write_timeout),
        shutdown: Duration::from_secs(shutdown),
        ..Limits::default()
    };
    // A connection and the file that it sends, and some for the program itself.
    let wanted = u64::from(connections) * 2 + 128;
    if let Some(files) = max_files(wanted).filter(|files| *files < wanted) {
        limits.connections = usize::try_from(files.saturating_sub(128) / 2).unwrap_or(usize::MAX).max(1);
        tracing::warn!(
            "the system allows {}, so {} at once instead of {connections}; \
             raise the limit to {wanted} (ulimit -n, or LimitNOFILE= of systemd)",
            counted(files, "open file", "open files"),
            counted(limits.connections, "connection", "connections")
        );
    }
    limits
}

/// Raise the limit of open files as far as needed and allowed; what it is then.
#[cfg(unix)]
fn max_files(wanted: u64) -> Option<u64> {
    use nix::sys::resource::{Resource, getrlimit, setrlimit};
    let (soft, hard) = getrlimit(Resource::RLIMIT_NOFILE).ok()?;
    let raised = wanted.min(hard);
    if soft < raised && setrlimit(Resource::RLIMIT_NOFILE, raised, hard).is_ok() { Some(raised) } else { Some(soft) }
}

#[cfg(not(unix))]
fn max_files(_wanted: u64) -> Option<u64> {
    None
}

/// Resolves at Ctrl-C, SIGTERM or SIGHUP; a SIGHUP that is ignored (`nohup`) stays so.
pub(crate) async fn stop() {
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
    #[cfg(unix)]
    let hang_up = async {
        use tokio::signal::unix::{SignalKind, signal};
        let kind = SignalKind::hangup();
        // Asked first: a handler would make it count.
        if crate::signals::is_ignored(kind.as_raw_value()) {
            return std::future::pending::<()>().await;
        }
        match signal(kind) {
            Ok(mut s) => {
                s.recv().await;
            }
            Err(_) => std::future::pending().await,
        }
    };
    #[cfg(not(unix))]
    let (terminate, hang_up) = (std::future::pending::<()>(), std::future::pending::<()>());
    tokio::select! {
        () = interrupt => {}
        () = terminate => {}
        () = hang_up => {}
    }
}
