//! The form for signing in: plain HTML in the catalogue's languages, works without scripts.

use crate::portal::language::Language;
use askama::Template;
use kilwa_archive::html::render;

/// What the form says above its fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Message {
    /// Nothing yet.
    Nothing,
    /// Name or password was wrong; which of them is not disclosed.
    Wrong,
    /// Too many failures: so many seconds to wait.
    Wait(u64),
    /// The server could not begin a session.
    Failed,
    /// Signed in as somebody.
    Done,
}

#[derive(Template)]
#[template(path = "sign-in.html")]
struct Page<'a> {
    l: &'static Language,
    next: &'a str,
    name: &'a str,
    /// Who is signed in, as a sentence; else there is a form.
    signed_in: Option<String>,
    problem: Option<String>,
}

/// The page; `next` is where it leads, an address of this site.
pub(crate) fn form(language: &'static Language, message: Message, next: &str, name: Option<&str>) -> String {
    let name = name.unwrap_or_default();
    let problem = match message {
        Message::Nothing | Message::Done => None,
        Message::Wrong => Some(language.t("signInWrong").to_owned()),
        Message::Failed => Some(language.t("signInFailed").to_owned()),
        Message::Wait(seconds) => Some(language.with("signInWait", &[("seconds", seconds)])),
    };
    let signed_in = (message == Message::Done).then(|| language.with("signedIn", &[("name", name)]));
    render(&Page { l: language, next, name, signed_in, problem })
}
