//! Capabilities: what a request for bytes of a closed pack carries instead of a password.
//!
//! `k2.<until>.<who>.<session>.<signature>`: until when (seconds since 1970), for whom, the session that it belongs to, and a keyed BLAKE3 hash over all of
//! it and the pack's SHA-256. One opens one pack for [`LIFE`]; the page asks for the next before it ends, or on 401, and a view in progress
//! loses nothing. A session, after signing in, is the same over no pack.
//!
//! A signature says that this server, or another one with the same key, gave it; whether the session has ended meanwhile is for
//! [`super::sessions`] to say. Both are asked, so that a capability ends with its session.

use super::secret::Key;
use thiserror::Error;

/// How long a capability opens its pack, seconds.
pub const LIFE: u64 = 600;
/// How long a session lasts, seconds.
pub const SESSION: u64 = 12 * 3600;
/// Longest that is looked at, bytes.
const LONGEST: usize = 256;

/// Why one does not open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Refusal {
    /// It did once.
    #[error("it has expired; request another")]
    Ended,
    /// It never did, or is for something else.
    #[error("it is for something else")]
    Wrong,
}

/// Whom a session or a capability was given to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holder {
    /// Name of the user.
    pub who: String,
    /// Identifier of the session, 32 hexadecimal digits.
    pub session: String,
}

/// Makes and checks them.
#[derive(Debug, Clone)]
pub struct Capabilities {
    key: Key,
}

impl Capabilities {
    pub(super) fn new(key: Key) -> Self {
        Self { key }
    }

    /// A capability for the pack with this SHA-256, from `now` on; `stamp` is [`super::User::stamp`], so that a changed password ends it.
    pub fn for_pack(&self, pack: &str, holder: &Holder, stamp: &str, now: u64) -> String {
        self.make("pack", &format!("{pack} {stamp}"), holder, now.saturating_add(LIFE))
    }

    /// For whom one opens the pack at `now`, where `stamp_of` gives the present stamp of a name.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn of_pack(
        &self,
        capability: &str,
        pack: &str,
        stamp_of: impl Fn(&str) -> Option<String>,
        now: u64,
    ) -> Result<Holder, Refusal> {
        let stamp = parts(capability).and_then(|parts| stamp_of(parts.who)).ok_or(Refusal::Wrong)?;
        self.check("pack", capability, &format!("{pack} {stamp}"), now, LIFE)
    }

    /// A session; `stamp` is [`super::User::stamp`], so that a changed password ends it.
    pub fn session(&self, holder: &Holder, stamp: &str, now: u64) -> String {
        self.make("session", stamp, holder, now.saturating_add(SESSION))
    }

    /// Who is signed in, where `stamp_of` gives the present stamp of a name.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn of_session(
        &self,
        session: &str,
        stamp_of: impl Fn(&str) -> Option<String>,
        now: u64,
    ) -> Result<Holder, Refusal> {
        let stamp = parts(session).and_then(|parts| stamp_of(parts.who)).ok_or(Refusal::Wrong)?;
        self.check("session", session, &stamp, now, SESSION)
    }

    /// Who signed in with a session that was issued here, even if it has expired by this clock. Used to end it for good, whatever the clock says later.
    pub fn signed_in(&self, session: &str, stamp_of: impl Fn(&str) -> Option<String>) -> Option<Holder> {
        let stamp = parts(session).and_then(|parts| stamp_of(parts.who))?;
        self.signed("session", session, &stamp).map(|(holder, _)| holder)
    }

    fn make(&self, purpose: &str, subject: &str, holder: &Holder, until: u64) -> String {
        let Holder { who, session } = holder;
        let signature = self.key.sign(purpose, &message(subject, who, session, until));
        format!("k2.{until}.{who}.{session}.{}", signature.to_hex())
    }

    fn check(&self, purpose: &str, given: &str, subject: &str, now: u64, life: u64) -> Result<Holder, Refusal> {
        let (holder, until) = self.signed(purpose, given, subject).ok_or(Refusal::Wrong)?;
        // A clock that was set back does not make old ones live longer than they were given.
        if now >= until || until - now > life { Err(Refusal::Ended) } else { Ok(holder) }
    }

    /// The holder of a validly signed value, and when it expires.
    fn signed(&self, purpose: &str, given: &str, subject: &str) -> Option<(Holder, u64)> {
        let Parts { until, who, session, signature } = parts(given)?;
        // Equality of `blake3::Hash` takes the same time wherever they differ.
        let is_ours = self.key.sign(purpose, &message(subject, who, session, until)) == signature;
        is_ours.then(|| (Holder { who: who.to_owned(), session: session.to_owned() }, until))
    }
}

/// Lengths first, so that no two different things sign alike.
fn message(subject: &str, who: &str, session: &str, until: u64) -> String {
    format!("{}:{subject}{}:{who}{}:{session}{until}", subject.len(), who.len(), session.len())
}

/// What a text is made of.
struct Parts<'a> {
    until: u64,
    who: &'a str,
    session: &'a str,
    signature: blake3::Hash,
}

/// Whether a text is written as hexadecimal digits are here.
pub(super) fn is_lower_hex(text: &str) -> bool {
    text.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b))
}

fn parts(text: &str) -> Option<Parts<'_>> {
    if text.len() > LONGEST {
        return None;
    }
    let rest = text.strip_prefix("k2.")?;
    let (until, rest) = rest.split_once('.')?;
    // Names may have dots.
    let (rest, signature) = rest.rsplit_once('.')?;
    let (who, session) = rest.rsplit_once('.')?;
    // One way of writing each, so that there are no two of the same.
    let is_plain = until.bytes().all(|b| b.is_ascii_digit()) && (until == "0" || !until.starts_with('0'));
    let is_lower = is_lower_hex(signature) && is_lower_hex(session);
    let until = until.parse().ok().filter(|_| is_plain && is_lower)?;
    Some(Parts { until, who, session, signature: blake3::Hash::from_hex(signature).ok()? })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NOW: u64 = 1_800_000_000;

    #[expect(clippy::unnecessary_wraps, reason = "it stands for a look into the accounts")]
    fn stamp(_: &str) -> Option<String> {
        Some("s".to_owned())
    }

    fn holder(who: &str) -> Holder {
        Holder { who: who.to_owned(), session: "0123456789abcdef".repeat(2) }
    }

    fn capabilities() -> Capabilities {
        Capabilities::new(Key([7; 32]))
    }

    #[test]
    fn a_capability_opens_only_its_pack_and_only_until_it_expires() {
        let c = capabilities();
        let (pack, other) = ("ab".repeat(32), "cd".repeat(32));
        let given = c.for_pack(&pack, &holder("amina.h"), "s", NOW);
        assert_eq!(c.of_pack(&given, &pack, stamp, NOW), Ok(holder("amina.h")));
        assert_eq!(c.of_pack(&given, &pack, stamp, NOW + LIFE - 1), Ok(holder("amina.h")));
        assert_eq!(c.of_pack(&given, &pack, stamp, NOW + LIFE), Err(Refusal::Ended));
        assert_eq!(c.of_pack(&given, &pack, stamp, NOW - 10), Err(Refusal::Ended), "the clock was set back");
        assert_eq!(c.of_pack(&given, &other, stamp, NOW), Err(Refusal::Wrong));
        let changed = |_: &str| Some("another password".to_owned());
        assert_eq!(c.of_pack(&given, &pack, changed, NOW), Err(Refusal::Wrong));
        assert_eq!(Capabilities::new(Key([8; 32])).of_pack(&given, &pack, stamp, NOW), Err(Refusal::Wrong));
        assert_eq!(c.of_session(&given, |_| Some(pack.clone()), NOW), Err(Refusal::Wrong), "it is no session");
    }

    #[test]
    fn a_session_ends_when_its_password_changes() {
        let c = capabilities();
        let session = c.session(&holder("amina"), "stamp", NOW);
        let now_is = |stamp: Option<&str>| c.of_session(&session, |_| stamp.map(str::to_owned), NOW + 60);
        assert_eq!(now_is(Some("stamp")), Ok(holder("amina")));
        assert_eq!(now_is(Some("another")), Err(Refusal::Wrong));
        assert_eq!(now_is(None), Err(Refusal::Wrong), "the user is gone");
        assert_eq!(c.of_session(&session, |_| Some("stamp".to_owned()), NOW + SESSION), Err(Refusal::Ended));
    }

    #[test]
    fn a_capability_with_any_byte_changed_opens_nothing() {
        let c = capabilities();
        let pack = "ab".repeat(32);
        let given = c.for_pack(&pack, &holder("amina"), "s", NOW).into_bytes();
        for at in 0..given.len() {
            for to in [b'0', b'9', b'a', b'F', b'.', b' ', b'-', 0] {
                let mut changed = given.clone();
                changed[at] = to;
                if changed != given {
                    let text = String::from_utf8(changed).expect("ASCII");
                    assert!(c.of_pack(&text, &pack, stamp, NOW).is_err(), "{text}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn arbitrary_text_opens_nothing_and_never_panics(text in ".{0,300}", until in any::<u64>(), who in "[a-z.]{0,9}") {
            let c = capabilities();
            prop_assert!(c.of_pack(&text, "", stamp, NOW).is_err());
            let forged = format!("k2.{until}.{who}.{}.{}", "0".repeat(32), "0".repeat(64));
            prop_assert!(c.of_pack(&forged, "", stamp, NOW).is_err());
        }
    }
}
