//! `kilwa`: build, check, render, measure and serve multiresolution packs of scanned sites. One file per verb.

mod access;
mod build;
mod colour;
mod distrust;
mod extract;
mod info;
mod inputs;
mod measure;
mod merge;
mod metadata;
mod named_files;
mod new_file;
mod plausible;
mod progress;
mod publish;
mod redact;
mod register;
mod render;
mod resources;
mod scans;
mod secrets;
mod serve;
mod sheet;
mod signals;
mod source;
mod stations;
mod stores;
mod synth;
mod tasks;
mod terminal;
mod tiles;
mod verify;

use clap::{Parser, Subcommand};
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

/// Publish scanned heritage sites in 3D, and measure on them.
#[derive(Parser)]
#[command(name = "kilwa", version, about)]
pub(crate) struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
pub(crate) enum Verb {
    Synth(synth::Args),
    Scans(scans::Args),
    Register(register::Args),
    Merge(merge::Args),
    Colour(colour::Args),
    Build(build::Args),
    Plan(Box<tasks::PlanArgs>),
    Task(tasks::TaskArgs),
    Assemble(tasks::AssembleArgs),
    Info(info::Args),
    Verify(verify::Args),
    Extract(extract::Args),
    Render(render::Args),
    Measure(measure::Args),
    Publish(Box<publish::Args>),
    Metadata(metadata::Args),
    Serve(serve::Args),
    Access(access::Args),
}

fn run(cli: Cli) -> anyhow::Result<()> {
    match cli.verb {
        Verb::Synth(a) => synth::run(&a),
        Verb::Build(a) => build::run(&a),
        Verb::Plan(a) => tasks::plan(&a),
        Verb::Task(a) => tasks::task(&a),
        Verb::Assemble(a) => tasks::assemble(&a),
        Verb::Scans(a) => scans::run(&a),
        Verb::Register(a) => register::run(&a),
        Verb::Merge(a) => merge::run(&a),
        Verb::Colour(a) => colour::run(&a),
        Verb::Info(a) => info::run(&a),
        Verb::Verify(a) => verify::run(&a),
        Verb::Extract(a) => extract::run(&a),
        Verb::Render(a) => render::run(&a),
        Verb::Measure(a) => measure::run(&a),
        Verb::Publish(a) => publish::run(&a),
        Verb::Metadata(a) => metadata::run(&a),
        Verb::Serve(a) => serve::run(&a),
        Verb::Access(a) => access::run(&a),
    }
}

/// Exit codes: 0 done, 1 the input or the environment is wrong, 2 usage (clap's own), 128 plus the number of the signal that stopped it (130 for Ctrl-C). A
/// closed pipe is success.
fn main() -> ExitCode {
    let cli = parsed();
    if matches!(cli.verb, Verb::Publish(_) | Verb::Render(_)) {
        without_wayland();
    }
    if !matches!(&cli.verb, Verb::Build(_) | Verb::Task(_) | Verb::Assemble(_) | Verb::Colour(_) | Verb::Serve(_))
        && !matches!(&cli.verb, Verb::Merge(a) if a.is_pack())
        && !matches!(&cli.verb, Verb::Metadata(a) if a.is_edit())
    {
        signals::end_at_once();
    }
    match run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) if broken_pipe(&e) => ExitCode::SUCCESS,
        Err(e) if e.is::<build::Interrupted>() => {
            crate::terminal::say!("kilwa: {e}");
            ExitCode::from(build::Interrupted::code())
        }
        Err(e) => {
            crate::terminal::say!("kilwa: {e:#}");
            ExitCode::FAILURE
        }
    }
}

/// Where nobody is signed in to a desktop, a layer of Mesa's looks for one all the same, and prints an error of its own among ours for each
/// picture. An environment variable prevents it, so the program restarts itself with it: the environment of a running program cannot be changed safely.
#[cfg(target_os = "linux")]
fn without_wayland() {
    use std::os::unix::process::CommandExt;
    const LAYER: &str = "NODEVICE_SELECT";
    if std::env::var_os("XDG_RUNTIME_DIR").is_some() || std::env::var_os(LAYER).is_some() {
        return;
    }
    if let Ok(program) = std::env::current_exe() {
        // Comes back only where it could not begin again: then there are some lines more.
        drop(std::process::Command::new(program).args(std::env::args_os().skip(1)).env(LAYER, "1").exec());
    }
}

#[cfg(not(target_os = "linux"))]
fn without_wayland() {}

/// Parse the arguments. Shells put file names among them. If one contains control characters, or an address contains a password, messages of the
/// parser are printed without colours, through `terminal`.
fn parsed() -> Cli {
    let error = match Cli::try_parse() {
        Ok(cli) => return cli,
        Err(error) => error,
    };
    let acts = |arg: std::ffi::OsString| arg.to_str().is_none_or(|arg| arg.contains(kilwa_pack::visible::is_control));
    if !error.use_stderr() {
        // The user asked for help or the version, so a full disk must not look like success.
        match error.print().and_then(|()| terminal::out().flush()) {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => {
                terminal::say!("kilwa: cannot print: {e}");
                std::process::exit(1);
            }
            _ => std::process::exit(error.exit_code()),
        }
    }
    if !(secrets::are_known() || std::env::args_os().any(acts)) {
        error.exit();
    }
    terminal::say!("{}", error.render().to_string().trim_end());
    std::process::exit(error.exit_code());
}

fn broken_pipe(e: &anyhow::Error) -> bool {
    e.chain().any(|c| c.downcast_ref::<std::io::Error>().is_some_and(|io| io.kind() == std::io::ErrorKind::BrokenPipe))
}
