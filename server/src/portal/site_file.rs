//! `site.toml` beside the objects, which describes the institution ([`institution`](super::institution)), and the logo beside it.
//!
//! Both are followed while the server runs ([`watched`](super::watched)). What is adjusted or left out (a colour, a missing logo, a featured model that is
//! not there or not public) is logged once, with its line; the pages work without it.

use super::institution::Institution;
use super::language::Language;
use super::logo::{LOGO_MAX, Logo};
use super::watched::{At, Expected, Watched};
use crate::store::Place;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Its name in a folder of objects.
pub const FILE: &str = "site.toml";
/// Longest file that is read, bytes.
const FILE_MAX: u64 = 256 << 10;

/// What pages show of the institution.
#[derive(Debug, Clone, Default)]
pub(crate) struct Branding {
    pub(crate) institution: Arc<Institution>,
    pub(crate) logo: Option<Arc<Logo>>,
}

impl Branding {
    /// The institution's name for programs, which have no language.
    pub(crate) fn title(&self) -> Option<&str> {
        self.institution.name.as_ref().map(|name| name.for_reader(Language::english()).1)
    }
}

/// The institution of an archive, as its file says now.
#[derive(Debug)]
pub struct SiteFile {
    file: Watched<Institution>,
    /// Where the logo is looked for.
    beside: Beside,
    /// The logo that the file names, by its name.
    logo: Mutex<Option<(String, Arc<LogoFile>)>>,
    remarks: Remarks,
    of_featured: Remarks,
    freshness: Option<Duration>,
}

/// A file with a logo; `None` if there is no file.
type LogoFile = Watched<Option<Arc<Logo>>>;

#[derive(Debug)]
enum Beside {
    Shelf(Place),
    Folder(PathBuf),
}

/// Remarks for the log that were true at the last look.
#[derive(Debug, Default)]
struct Remarks(Mutex<BTreeSet<String>>);

impl Remarks {
    /// Log those that were not true before.
    fn log(&self, file: &str, now: BTreeSet<String>) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for remark in now.difference(&known) {
            tracing::warn!("{file}: {remark}");
        }
        *known = now;
    }
}

impl SiteFile {
    /// For this file, which need not exist yet; the logo is beside it.
    #[must_use]
    pub fn new(file: PathBuf) -> Self {
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.map_or_else(|| PathBuf::from("."), PathBuf::from);
        Self::at(At::Named(file), Beside::Folder(folder))
    }

    /// For the `site.toml` beside the objects of `shelf`, a folder or a store. Reads it immediately.
    #[must_use]
    pub fn beside(shelf: &Place) -> Self {
        let file = Self::at(At::Beside(shelf.join(FILE)), Beside::Shelf(shelf.clone()));
        drop(file.branding());
        file
    }

    fn at(at: At, beside: Beside) -> Self {
        let read = |bytes: &[u8]| {
            let text = std::str::from_utf8(bytes).map_err(|e| e.to_string())?;
            Institution::parse(text).map_err(|problems| problems.to_string())
        };
        let otherwise =
            "the last valid version stays in use; without one, the file has no effect until it is corrected";
        let file = Watched::new(at, Expected { max: FILE_MAX, read, otherwise });
        let (remarks, of_featured) = Default::default();
        Self { file, beside, logo: Mutex::default(), remarks, of_featured, freshness: None }
    }

    /// With a freshness other than [`FRESHNESS`](crate::FRESHNESS); with zero, every request checks local files.
    #[must_use]
    pub fn with_freshness(self, freshness: Duration) -> Self {
        let (file, logo) = (self.file.with_freshness(freshness), Mutex::default());
        Self { file, logo, freshness: Some(freshness), ..self }
    }

    /// The current content of the file and its logo. Blocks like [`Watched::content`].
    pub(crate) fn branding(&self) -> Branding {
        let institution = self.file.content();
        let mut remarks: BTreeSet<String> = institution.remarks.iter().cloned().collect();
        let mut logo = None;
        if let Some((name, line)) = &institution.logo {
            let watched = self.logo_named(name);
            logo.clone_from(&watched.content());
            if watched.is_missing() {
                remarks.insert(format!(
                    "line {line}: logo: there is no {name} beside this file; put the picture there, or correct the name"
                ));
            }
        }
        self.remarks.log(self.file.name(), remarks);
        Branding { institution, logo }
    }

    /// Log which featured models are not shown, and why: slugs and reasons.
    pub(crate) fn report_featured(&self, line: usize, left_out: &[(String, &'static str)]) {
        let remark = |(slug, why): &(String, &str)| format!("line {line}: featured: {slug} {why}");
        self.of_featured.log(self.file.name(), left_out.iter().map(remark).collect());
    }

    fn logo_named(&self, name: &str) -> Arc<LogoFile> {
        let mut logo = self.logo.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, watched)) = logo.as_ref().filter(|(known, _)| known == name) {
            return Arc::clone(watched);
        }
        let at = match &self.beside {
            Beside::Shelf(shelf) => At::Beside(shelf.join(name)),
            Beside::Folder(folder) => At::InFolder(folder.clone(), name.to_owned()),
        };
        let read = |bytes: &[u8]| Logo::read(bytes).map(Arc::new).map(Some);
        let watched = Watched::new(
            at,
            Expected {
                max: LOGO_MAX,
                read,
                otherwise: "the last valid logo of this name stays in use, if there was one",
            },
        );
        let watched = Arc::new(match self.freshness {
            Some(freshness) => watched.with_freshness(freshness),
            None => watched,
        });
        *logo = Some((name.to_owned(), Arc::clone(&watched)));
        watched
    }
}
