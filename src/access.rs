//! `kilwa access`: who may see what is not public, and who may publish.
//!
//! Changes one file of accounts ([`kilwa_server::access::accounts`]), which `kilwa serve --access` reads and reads again when it changes.
//! A password is asked for without being shown, or taken from the first line of stdin; never from the command line, where other users
//! of the machine could read it. A token is printed once, alone on stdout.

use anyhow::Context;
use clap::Subcommand;
use kilwa_files::made_folders::MadeFolders;
use kilwa_pack::plural::counted;
use kilwa_server::access::{Accounts, Grant, Purpose};
use serde_json::json;
use std::io::{BufRead, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Manage who may see models that are not public, and who may publish.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Make a file of accounts with nobody in it; keep it outside of every folder that is served.
    Init {
        /// The file, for example /etc/kilwa/access.json.
        file: PathBuf,
    },
    /// Add a user, or change a user's password and what the user may see.
    User {
        /// The file.
        file: PathBuf,
        /// Name: a-z, 0-9 and . _ - @.
        name: String,
        /// May see this object (its name in the address); repeat for several objects. Replaces earlier grants.
        #[arg(long, value_name = "SLUG", conflicts_with = "all")]
        object: Vec<String>,
        /// May see every object that is not withdrawn.
        #[arg(long)]
        all: bool,
        /// Set no password: keep the existing one, or give a new user only tokens.
        #[arg(long)]
        no_password: bool,
    },
    /// End all sessions of a user, on every server that uses the file; tokens keep working.
    SignOut {
        /// The file.
        file: PathBuf,
        /// Name.
        name: String,
    },
    /// Take a user away, with all tokens.
    Remove {
        /// The file.
        file: PathBuf,
        /// Name.
        name: String,
    },
    /// Make a token for a program that acts for a user, and print it, this once.
    Token {
        /// The file.
        file: PathBuf,
        /// Name of the user.
        name: String,
        /// Purpose of the token: view or publish.
        #[arg(long = "for", value_name = "PURPOSE", value_parser = purpose, default_value = "view")]
        purpose: Purpose,
        /// Days until the token expires.
        #[arg(long, default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=3660))]
        days: u32,
    },
    /// Take a token away.
    Revoke {
        /// The file.
        file: PathBuf,
        /// Its name, as `kilwa access list` shows it.
        token: String,
    },
    /// Show users, what they may see, and their tokens; no secrets.
    List {
        /// The file.
        file: PathBuf,
        /// Print as JSON.
        #[arg(long)]
        json: bool,
    },
}

fn purpose(text: &str) -> Result<Purpose, String> {
    match text {
        "view" => Ok(Purpose::View),
        "publish" => Ok(Purpose::Publish),
        _ => Err("expected view or publish".to_owned()),
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    match &args.what {
        What::Init { file } => init(file),
        What::User { file, name, object, all, no_password } => {
            let grant = if *all { Grant::All } else { Grant::Objects(object.clone()) };
            set_user(file, name, &grant, !no_password)
        }
        What::SignOut { file, name } => change(file, |a| {
            a.sign_out(name)?;
            Ok(format!("{name} is signed out everywhere."))
        }),
        What::Remove { file, name } => change(file, |a| {
            a.remove_user(name)?;
            Ok(format!("{name} and all of {name}'s tokens were removed."))
        }),
        What::Token { file, name, purpose, days } => token(file, name, *purpose, *days),
        What::Revoke { file, token } => change(file, |a| {
            a.revoke(token)?;
            Ok(format!("The token {token} no longer works."))
        }),
        What::List { file, json } => list(file, *json),
    }
}

fn init(file: &Path) -> anyhow::Result<()> {
    if file.exists() {
        anyhow::bail!("{} already exists and was left as it is", file.display());
    }
    let _folders = MadeFolders::for_file(file).with_context(|| format!("cannot write {}", file.display()))?;
    Accounts::new()?.create(file)?;
    writeln!(crate::terminal::out(), "{}: no users yet; add some with `kilwa access user`.", file.display())?;
    Ok(())
}

fn set_user(file: &Path, name: &str, grant: &Grant, ask: bool) -> anyhow::Result<()> {
    // Before the password is asked for: is there such a file?
    Accounts::read(file)?;
    // Outside of the lock: a person may take minutes to type it.
    let password = if ask { Some(password(name)?) } else { None };
    change(file, |a| {
        let known = a.user(name).is_some();
        a.set_user(name, grant, password.as_deref())?;
        let sees = match grant {
            Grant::All => "everything that is not withdrawn".to_owned(),
            Grant::Objects(slugs) if slugs.is_empty() => "what is public".to_owned(),
            Grant::Objects(slugs) => format!("what is public and {}", slugs.join(", ")),
        };
        Ok(format!("{name} is {} and may see {sees}.", if known { "changed" } else { "added" }))
    })
}

/// Asked for twice on a terminal, else the first line of stdin.
fn password(name: &str) -> anyhow::Result<String> {
    let stdin = std::io::stdin();
    if !stdin.is_terminal() {
        let mut line = String::new();
        stdin.lock().read_line(&mut line).context("cannot read the password from stdin")?;
        let password = line.trim_end_matches(['\n', '\r']).to_owned();
        anyhow::ensure!(!password.is_empty(), "no password on standard input; use --no-password to set none");
        return Ok(password);
    }
    let terminal = console::Term::stderr();
    let ask = |what: &str| -> anyhow::Result<String> {
        terminal.write_str(what)?;
        Ok(terminal.read_secure_line()?)
    };
    let first = ask(&format!("Password for {name}: "))?;
    anyhow::ensure!(first == ask("Once more: ")?, "the two passwords differ; nothing was changed");
    Ok(first)
}

fn token(file: &Path, name: &str, purpose: Purpose, days: u32) -> anyhow::Result<()> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let token = Accounts::change(file, |a| a.add_token(name, purpose, days, now))?;
    crate::terminal::say!("This token works for {} for {name}, and is not shown again:", counted(days, "day", "days"));
    writeln!(crate::terminal::out(), "{token}")?;
    Ok(())
}

/// Change the accounts, then print the message that `how` returns.
fn change(file: &Path, how: impl FnOnce(&mut Accounts) -> anyhow::Result<String>) -> anyhow::Result<()> {
    let message = Accounts::change(file, how)?;
    writeln!(crate::terminal::out(), "{message}")?;
    Ok(())
}

fn list(file: &Path, as_json: bool) -> anyhow::Result<()> {
    let accounts = Accounts::read(file)?;
    let mut out = crate::terminal::out();
    if as_json {
        let users = accounts.users().iter().map(|u| {
            let grants = match u.grant() {
                Grant::All => json!("all"),
                Grant::Objects(slugs) => json!(slugs),
            };
            let tokens: Vec<_> = u
                .tokens
                .iter()
                .map(|t| json!({"id": t.id, "for": t.purpose, "made": t.made, "until": t.until}))
                .collect();
            json!({"name": u.name, "password": u.has_password(), "sees": grants, "tokens": tokens})
        });
        writeln!(out, "{}", crate::terminal::json_text(&json!({ "users": users.collect::<Vec<_>>() }))?)?;
        return Ok(());
    }
    if accounts.users().is_empty() {
        writeln!(out, "No users yet; add some with `kilwa access user`.")?;
    }
    for user in accounts.users() {
        let sees = match user.grant() {
            Grant::All => "everything that is not withdrawn".to_owned(),
            Grant::Objects(slugs) if slugs.is_empty() => "what is public".to_owned(),
            Grant::Objects(slugs) => slugs.join(", "),
        };
        let signs = if user.has_password() { "" } else { "; no password" };
        writeln!(out, "{}: sees {sees}{signs}", user.name)?;
        for t in &user.tokens {
            let purpose = if t.purpose == Purpose::View { "view" } else { "publish" };
            writeln!(out, "  token {} for {purpose}, made {}, works until {}", t.id, t.made, t.until)?;
        }
    }
    Ok(())
}
