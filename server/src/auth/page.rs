//! The form for signing in: plain HTML in the catalogue's languages, works without scripts.

use crate::portal::encoded;
use crate::portal::frame::{Reader, Top};
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
    top: Top,
    next: &'a str,
    name: &'a str,
    /// Who is signed in, as a sentence; else there is a form.
    signed_in: Option<String>,
    problem: Option<String>,
}

/// The page; `next` is where it leads, an address of this site.
pub(crate) fn form(reader: &Reader<'_>, message: Message, next: &str, name: Option<&str>) -> String {
    let (language, name) = (reader.language, name.unwrap_or_default());
    let problem = match message {
        Message::Nothing | Message::Done => None,
        Message::Wrong => Some(language.t("signInWrong").to_owned()),
        Message::Failed => Some(language.t("signInFailed").to_owned()),
        Message::Wait(seconds) => Some(language.with("signInWait", &[("seconds", seconds)])),
    };
    let signed_in = (message == Message::Done).then(|| language.with("signedIn", &[("name", name)]));
    // What the header has on other pages is here the content.
    let reader = Reader { visit: None, ..*reader };
    let top = reader.top(&|code| format!("/sign-in?next={}&lang={code}", encoded(next)));
    render(&Page { top, next, name, signed_in, problem })
}
