//! The common parts of the portal's pages: head, header with links to its parts, the choice of language and signing in, footer with the institution's notices.

use super::encoded;
use super::institution::{Institution, Texts, link};
use super::language::Language;
use super::site_file::Branding;

/// For whom a page is written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reader<'a> {
    pub(crate) language: &'static Language,
    /// The code of the language that the address names, which its links keep: one of ours, never the address's own text.
    pub(crate) lang: Option<&'a str>,
    /// Whether there are collections to lead to.
    pub(crate) has_collections: bool,
    /// Whether there is an index, and so a map.
    pub(crate) has_map: bool,
    /// The institution that runs the archive, if known.
    pub(crate) branding: Option<&'a Branding>,
    /// The visitor, if the server has accounts.
    pub(crate) visit: Option<&'a Visit>,
}

/// A visit to a server that has accounts.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Visit {
    /// The user who is signed in.
    pub(crate) who: Option<String>,
}

impl<'a> Reader<'a> {
    /// A reader about whom only the language is known.
    pub(crate) fn of(language: &'static Language, lang: Option<&'a str>) -> Self {
        Self { language, lang, has_collections: false, has_map: false, branding: None, visit: None }
    }

    /// An address of this site with the reader's language; `path` has no query.
    pub(crate) fn to(&self, path: &str) -> String {
        let lang = self.lang.map(|lang| format!("?lang={}", encoded(lang))).unwrap_or_default();
        format!("{path}{lang}")
    }

    fn institution(&self) -> Option<&'a Institution> {
        self.branding.map(|branding| &*branding.institution)
    }

    /// The institution's name.
    pub(crate) fn name(&self) -> Option<&'a str> {
        self.institution()?.name.as_ref().map(|name| name.for_reader(self.language).1)
    }

    /// The paragraphs of the institution's introduction, and their language.
    pub(crate) fn introduction(&self) -> Option<(&'a str, Vec<&'a str>)> {
        let (language, text) = self.institution()?.introduction.as_ref()?.for_reader(self.language);
        Some((language, text.split("\n\n").map(str::trim).filter(|p| !p.is_empty()).collect()))
    }

    /// The top of a page; `other` is the address of the same page in another language.
    pub(crate) fn top(&self, other: &dyn Fn(&str) -> String) -> Top {
        let parts = [("/map", "map", self.has_map), ("/collections/", "collections", self.has_collections)];
        let parts: Vec<_> = parts.into_iter().filter(|(.., is_there)| *is_there).collect();
        let all = (!parts.is_empty()).then_some(("/", "title", true));
        let choice = |one: &'static Language| Choice {
            address: other(one.code),
            code: one.code,
            name: one.t("name"),
            is_current: one.code == self.language.code,
        };
        Top {
            l: self.language,
            home: self.to("/"),
            parts: all.into_iter().chain(parts).map(|(path, key, _)| (self.to(path), key)).collect(),
            languages: Language::all().iter().map(choice).collect(),
            brand: self.brand(),
            account: self.visit.map(|visit| self.account(visit, other(self.language.code))),
            notices: self.notices(),
        }
    }

    fn brand(&self) -> Option<Brand> {
        let (language, name) = self.institution()?.name.as_ref()?.for_reader(self.language);
        let logo = self.branding.and_then(|branding| branding.logo.as_ref()).map(|logo| logo.format.address());
        Some(Brand { name: name.to_owned(), language: language.to_owned(), logo })
    }

    fn account(&self, visit: &Visit, here: String) -> Account {
        let sign_in = format!("/sign-in?next={}&lang={}", encoded(&here), self.language.code);
        let who = visit.who.clone();
        let sentence = who.as_deref().map(|who| self.language.with("signedIn", &[("name", who)])).unwrap_or_default();
        Account { who, sentence, sign_in, here }
    }

    fn notices(&self) -> Vec<Notice> {
        let Some(institution) = self.institution() else { return Vec::new() };
        let notice = |(key, texts): (&'static str, &Option<Texts>)| {
            let (language, text) = texts.as_ref()?.for_reader(self.language);
            Some(Notice { key, language: language.to_owned(), text: text.to_owned(), link: link(text) })
        };
        let all = [("imprint", &institution.imprint), ("contact", &institution.contact)];
        all.into_iter().filter_map(notice).collect()
    }
}

/// What `templates/portal.html` shows around the content of a page: the institution, links to the site's parts, the languages, sign-in, notices.
#[derive(Debug)]
pub(crate) struct Top {
    pub(crate) l: &'static Language,
    /// Address of the list.
    pub(crate) home: String,
    /// Addresses of the parts and the keys of their names.
    pub(crate) parts: Vec<(String, &'static str)>,
    pub(crate) languages: Vec<Choice>,
    /// The institution.
    pub(crate) brand: Option<Brand>,
    /// Signing in or out, where the server has accounts.
    pub(crate) account: Option<Account>,
    /// At the foot of the page.
    pub(crate) notices: Vec<Notice>,
}

/// A language that the page can be read in.
#[derive(Debug)]
pub(crate) struct Choice {
    pub(crate) address: String,
    pub(crate) code: &'static str,
    pub(crate) name: &'static str,
    pub(crate) is_current: bool,
}

/// The institution's name, its language, and the address of the logo.
#[derive(Debug)]
pub(crate) struct Brand {
    pub(crate) name: String,
    pub(crate) language: String,
    pub(crate) logo: Option<&'static str>,
}

/// The link to sign in, or who is signed in and the form to sign out.
#[derive(Debug)]
pub(crate) struct Account {
    pub(crate) who: Option<String>,
    /// "You are signed in as …"
    pub(crate) sentence: String,
    /// Address of the sign-in form, which leads back to this page.
    pub(crate) sign_in: String,
    /// Address of this page.
    pub(crate) here: String,
}

/// The imprint or the contact.
#[derive(Debug)]
pub(crate) struct Notice {
    /// Key of its name.
    pub(crate) key: &'static str,
    pub(crate) language: String,
    pub(crate) text: String,
    /// The target of the link, if it is an address and not a text.
    pub(crate) link: Option<String>,
}
