//! The form for signing in: plain HTML in the catalogue's languages, works without scripts.

use crate::html::HEAD;
use crate::portal::language::Language;
use kilwa_archive::record::xml::escape;
use std::fmt::Write as _;

/// What the form says above its fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Said {
    /// Nothing yet.
    Nothing,
    /// Name or password was wrong; which of them is not told.
    Wrong,
    /// Too many failures: so many seconds to wait.
    Wait(u64),
    /// The server could not begin a session.
    Failed,
    /// Signed in as somebody.
    Done,
}

/// The page; `next` is where it leads, an address of this site.
pub(crate) fn form(language: &'static Language, said: Said, next: &str, name: Option<&str>) -> String {
    let t = |key: &'static str| language.t(key);
    let mut s =
        HEAD.replacen("<html lang=\"en\">", &format!("<html lang=\"{}\" dir=\"{}\">", language.code, t("dir")), 1);
    let _ = write!(
        s,
        "<meta name=\"robots\" content=\"noindex\">\n<title>{0} - Kilwa</title>\n</head>\n<body class=\"list\">\n\
         <header class=\"site\"><a class=\"brand\" href=\"/\"><img src=\"/viewer/icons/kilwa.svg\" alt=\"\" width=\"28\" height=\"28\"> Kilwa</a></header>\n\
         <main class=\"sign-in\">\n<h1>{0}</h1>\n",
        t("signIn")
    );
    match said {
        Said::Nothing => {}
        Said::Wrong => {
            let _ = writeln!(s, "<p class=\"problem\" role=\"alert\">{}</p>", t("signInWrong"));
        }
        Said::Failed => {
            let _ = writeln!(s, "<p class=\"problem\" role=\"alert\">{}</p>", t("signInFailed"));
        }
        Said::Wait(seconds) => {
            let text = language.with("signInWait", &[("seconds", seconds)]);
            let _ = writeln!(s, "<p class=\"problem\" role=\"alert\">{text}</p>");
        }
        Said::Done => {
            let who = language.with("signedIn", &[("name", &escape(name.unwrap_or_default()))]);
            let _ = write!(
                s,
                "<p role=\"status\">{who}</p>\n<form method=\"post\" action=\"/sign-out\">\n\
                 <p class=\"actions\"><a class=\"button filled\" href=\"{}\">{}</a> <button class=\"button outlined\">{}</button> \
                 <button class=\"button outlined\" name=\"everywhere\" value=\"1\">{}</button></p>\n</form>\n</main>\n</body>\n</html>\n",
                escape(next),
                t("goOn"),
                t("signOut"),
                t("signOutEverywhere")
            );
            return s;
        }
    }
    let _ = write!(
        s,
        "<form method=\"post\" action=\"/sign-in\">\n<input type=\"hidden\" name=\"next\" value=\"{}\"><input type=\"hidden\" name=\"lang\" value=\"{}\">\n\
         <p><label for=\"name\">{}</label><br><input id=\"name\" name=\"name\" autocomplete=\"username\" autocapitalize=\"none\" spellcheck=\"false\" required value=\"{}\" dir=\"ltr\"></p>\n\
         <p><label for=\"password\">{}</label><br><input id=\"password\" name=\"password\" type=\"password\" autocomplete=\"current-password\" required dir=\"ltr\"></p>\n\
         <p class=\"actions\"><button class=\"button filled\">{}</button></p>\n</form>\n</main>\n</body>\n</html>\n",
        escape(next),
        language.code,
        t("userName"),
        escape(name.unwrap_or_default()),
        t("password"),
        t("signIn")
    );
    s
}
