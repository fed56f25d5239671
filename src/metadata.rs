//! `kilwa metadata`: the file that `kilwa publish` reads, begun, edited and checked.

mod download;
mod edit;

use crate::new_file::NewFile;
use crate::source::open_pack;
use anyhow::bail;
use kilwa_archive::metadata::template::{self, Known};
use kilwa_archive::rights::{self, Rights};
use kilwa_geometry::LengthUnit;
use std::io::{BufRead, IsTerminal, Write};
use std::path::PathBuf;

/// Create, edit or check the metadata file of a model.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Write a commented metadata file; on a terminal, ask for what it needs first.
    Init {
        /// A pack, for title, units, reference system and counts.
        pack: Option<PathBuf>,
        /// A ZIP download from Sketchfab: fill in the title, author, licence, credit and source that it states.
        #[arg(long, value_name = "FILE.zip")]
        download: Option<PathBuf>,
        /// The file to write (default: standard output).
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
        /// Do not ask questions.
        #[arg(long)]
        quiet: bool,
    },
    /// Edit a metadata file in a form in the browser.
    ///
    /// Prints an address of this computer, which opens the form. The file is created if it does not exist; in an existing one, comments and everything
    /// that the form does not change stay as they are. Stops when you press Done in the form, or at Ctrl-C.
    Edit {
        /// The file.
        file: PathBuf,
        /// A pack, for title, units, reference system and accuracy where the file does not have them.
        pack: Option<PathBuf>,
    },
    /// Check a metadata file: every mistake with its line.
    Check {
        /// The file.
        file: PathBuf,
    },
}

impl Args {
    /// Whether this runs until a signal ends it, which is then no failure.
    pub(crate) fn is_edit(&self) -> bool {
        matches!(self.what, What::Edit { .. })
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    match &args.what {
        What::Init { pack, download, output, quiet } => init(pack.as_ref(), download.as_ref(), output.as_ref(), *quiet),
        What::Edit { file, pack } => edit::run(file, pack.as_ref()),
        What::Check { file } => {
            let m = crate::publish::read_metadata(file)?;
            Ok(writeln!(crate::terminal::out(), "{}: right. \"{}\", {}", file.display(), m.title, m.rights.uri)?)
        }
    }
}

fn init(
    pack: Option<&PathBuf>,
    download: Option<&PathBuf>,
    output: Option<&PathBuf>,
    quiet: bool,
) -> anyhow::Result<()> {
    if let Some(path) = output.filter(|p| p.exists()) {
        bail!("{} already exists; choose another name, or move it away", path.display());
    }
    let mut known = match pack {
        Some(path) => of_pack(open_pack(path)?.metadata()),
        None => Known::default(),
    };
    if let Some(path) = download {
        download::fill(&mut known, path)?;
    }
    let (input, mut errors) = (std::io::stdin(), crate::terminal::err());
    if !quiet && input.is_terminal() && std::io::stderr().is_terminal() {
        ask(&mut known, &mut input.lock(), &mut errors)?;
    }
    let text = template::write(&known);
    let Some(path) = output else { return Ok(crate::terminal::out().write_all(text.as_bytes())?) };
    NewFile::write(path, text.as_bytes(), false)?;
    crate::terminal::say!(
        "{} was written: check and complete it, then run kilwa publish PACK --to DIR --metadata {}",
        path.display(),
        path.display()
    );
    Ok(())
}

fn of_pack(m: &kilwa_pack::Metadata) -> Known {
    Known {
        title: Some(m.title.clone()).filter(|t| !t.trim().is_empty()),
        units: Some(m.source_units.clone()),
        crs: Some(m.crs.clone().unwrap_or_else(|| "local".to_owned())),
        accuracy: m.capture_accuracy,
        counts: Some((m.triangles, m.vertices)),
        ..Known::default()
    }
}

/// Ask for what is needed and for what is mostly known; an empty answer takes what is proposed, or nothing.
fn ask(known: &mut Known, input: &mut impl BufRead, out: &mut impl Write) -> anyhow::Result<()> {
    writeln!(
        out,
        "Some questions; Enter takes the value in brackets, or leaves the field empty. Everything can be changed in the file."
    )?;
    let any = |text: &str| Ok(text.to_owned());
    question("Title", &mut known.title, any, input, out)?;
    let uri = |text: &str| Rights::parse(text).map(|r| r.uri);
    writeln!(out, "Rights: {}", rights::CHOICES)?;
    question("Rights", &mut known.rights, uri, input, out)?;
    question("Who holds the rights", &mut known.holder, any, input, out)?;
    loop {
        let mut name = None;
        let ask = if known.creators.is_empty() {
            "Made by (a person as Family, Given, or an organisation)"
        } else {
            "And by"
        };
        question(ask, &mut name, any, input, out)?;
        let Some(name) = name else { break };
        known.creators.push(who(name, input, out)?);
    }
    question("What the model shows, in a sentence", &mut known.description, any, input, out)?;
    question("Published by", &mut known.publisher, any, input, out)?;
    question("Place", &mut known.place, any, input, out)?;
    let country = |text: &str| {
        let right = text.len() == 2 && text.bytes().all(|b| b.is_ascii_alphabetic());
        if right { Ok(text.to_uppercase()) } else { Err("expected two letters, for example TZ".to_owned()) }
    };
    question("Country (two letters)", &mut known.country, country, input, out)?;
    let date = |text: &str| {
        let right = kilwa_archive::date::is_date_or_span(text);
        if right { Ok(text.to_owned()) } else { Err("for example 2009, 2009-07 or 2009-07/2009-08".to_owned()) }
    };
    question("Captured (2009-07, or a span 2009-07/2009-08)", &mut known.captured, date, input, out)?;
    question("How (for example terrestrial laser scanning)", &mut known.method, any, input, out)?;
    let units = |text: &str| {
        let unit = LengthUnit::parse(text).ok_or_else(|| format!("one of {}", LengthUnit::symbols()))?;
        Ok(unit.symbol().to_owned())
    };
    question("Units of the mesh that was scanned", &mut known.units, units, input, out)
}

/// Words that names of organisations have and names of people do not.
const ORGANISATIONS: [&str; 31] = [
    "museum",
    "museums",
    "muse",
    "musée",
    "museu",
    "universit",
    "institut",
    "archiv",
    "department",
    "division",
    "ministry",
    "project",
    "foundation",
    "trust",
    "fund",
    "society",
    "association",
    "authority",
    "service",
    "agency",
    "council",
    "centre",
    "center",
    "library",
    "college",
    "school",
    "laborator",
    "ltd",
    "gmbh",
    "inc",
    "unesco",
];

/// A name as it is written in citations, and whether it is an organisation's: asked where the name does not say so itself.
fn who(name: String, input: &mut impl BufRead, out: &mut impl Write) -> anyhow::Result<(String, bool)> {
    // People have a comma between family name and given name.
    if name.contains(',') {
        return Ok((name, false));
    }
    let is_likely = name.split(|c: char| !c.is_alphanumeric()).any(|word| {
        let word = word.to_lowercase();
        ORGANISATIONS.iter().any(|o| word == *o || o.len() > 5 && word.starts_with(o))
    });
    let mut kind = Some(if is_likely { "organisation" } else { "person" }.to_owned());
    let known = |text: &str| match text.to_lowercase().as_str() {
        "p" | "person" => Ok("person".to_owned()),
        "o" | "organisation" | "organization" => Ok("organisation".to_owned()),
        _ => Err("person or organisation (p or o)".to_owned()),
    };
    question("  A person or an organisation", &mut kind, known, input, out)?;
    if kind.as_deref() == Some("organisation") {
        return Ok((name, true));
    }
    // The last word is the family name of most; whoever has another says so.
    let Some((given, family)) = name.rsplit_once(' ') else { return Ok((name, false)) };
    let mut written = Some(format!("{family}, {given}"));
    question("  Family name first", &mut written, |text| Ok(text.to_owned()), input, out)?;
    Ok((written.unwrap_or(name), false))
}

/// One question, until the answer can be used.
fn question(
    text: &str,
    value: &mut Option<String>,
    check: impl Fn(&str) -> Result<String, String>,
    input: &mut impl BufRead,
    out: &mut impl Write,
) -> anyhow::Result<()> {
    loop {
        match value.as_deref() {
            Some(proposed) => write!(out, "{text} [{proposed}]: ")?,
            None => write!(out, "{text}: ")?,
        }
        out.flush()?;
        let mut line = String::new();
        if input.read_line(&mut line)? == 0 {
            writeln!(out)?;
            return Ok(());
        }
        let answer: String = line.chars().filter(|c| !c.is_control()).collect();
        let answer = answer.trim();
        if answer.is_empty() {
            return Ok(());
        }
        match check(answer) {
            Ok(right) => {
                *value = Some(right);
                return Ok(());
            }
            Err(problem) => writeln!(out, "  {problem}")?,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_archive::Metadata;
    use kilwa_archive::metadata::AgentKind;

    #[test]
    fn answers_fill_the_file_and_invalid_ones_are_asked_again() {
        let answers = "\nsecret\nCC BY 4.0\nMuseum\nRüther, Heinz\nZamani Project\n\nAmina Juma\nx\n\n\nOmar\no\n\nA fort.\n\nKilwa\nTanzania\nTZ\n2009-7\n2009-07\nscan\nmiles\nmm\n";
        let mut known = Known { title: Some("Fort".to_owned()), ..Known::default() };
        let mut shown = Vec::new();
        ask(&mut known, &mut answers.as_bytes(), &mut shown).unwrap();
        let m = Metadata::parse(&template::write(&known)).unwrap();
        assert_eq!((m.title.as_str(), m.model.units.as_str()), ("Fort", "mm"));
        assert_eq!(m.rights.uri, "https://creativecommons.org/licenses/by/4.0/");
        let names: Vec<(&str, AgentKind)> = m.creators.iter().map(|c| (c.name.as_str(), c.kind)).collect();
        let (person, organisation) = (AgentKind::Person, AgentKind::Organisation);
        assert_eq!(
            names,
            [
                ("Rüther, Heinz", person),
                ("Zamani Project", organisation),
                ("Juma, Amina", person),
                ("Omar", organisation)
            ]
        );
        assert_eq!(m.place.unwrap().country.as_deref(), Some("TZ"));
        assert_eq!(m.capture.unwrap().date.as_deref(), Some("2009-07"));
        let shown = String::from_utf8(shown).unwrap();
        assert!(
            shown.contains("Title [Fort]: ") && shown.contains("not a known licence or rights statement"),
            "{shown}"
        );
    }

    #[test]
    fn the_end_of_the_input_ends_the_questions() {
        let mut known = Known::default();
        ask(&mut known, &mut "".as_bytes(), &mut Vec::new()).unwrap();
        assert_eq!(known, Known::default());
    }
}
