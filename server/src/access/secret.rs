//! Passwords, tokens and keys.
//!
//! A password is what a person can remember: it is kept as Argon2id (RFC 9106) with a salt. A token and a key are 256 bits from the system's
//! generator: nobody guesses them, so a plain hash (BLAKE3) of a token is enough, and every request can afford to check it. Hashes
//! are compared by `blake3::Hash`, which takes the same time wherever they differ.

use argon2::Argon2;
use argon2::password_hash::{PasswordHasher, PasswordVerifier};
use std::fmt;

/// Shortest password, characters (NIST SP 800-63B).
pub(super) const PASSWORD_MIN: usize = 8;
/// Longest, bytes: hashing must not be made dear by whoever asks.
pub(super) const PASSWORD_MAX: usize = 1024;

/// Random bytes for signing.
#[derive(Clone, PartialEq, Eq)]
pub(super) struct Key(pub(super) [u8; 32]);

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(hidden)")
    }
}

impl Key {
    pub(super) fn new() -> Result<Self, String> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes).map_err(|e| format!("the system provides no random numbers: {e}"))?;
        Ok(Self(bytes))
    }

    pub(super) fn to_hex(&self) -> String {
        blake3::Hash::from_bytes(self.0).to_hex().as_str().to_owned()
    }

    pub(super) fn of_hex(text: &str) -> Option<Self> {
        blake3::Hash::from_hex(text).ok().map(|h| Self(*h.as_bytes()))
    }

    /// The signature of `message` for one `purpose`; those of another purpose do not fit.
    pub(super) fn sign(&self, purpose: &str, message: &str) -> blake3::Hash {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        hasher.update(&(purpose.len() as u64).to_le_bytes());
        hasher.update(purpose.as_bytes());
        hasher.update(message.as_bytes());
        hasher.finalize()
    }
}

/// The hash that a token is known by.
pub(super) fn token_hash(token: &str) -> blake3::Hash {
    blake3::hash(token.as_bytes())
}

/// A password as it is kept.
pub(super) fn hash_password(password: &str) -> Result<String, String> {
    if password.chars().count() < PASSWORD_MIN || password.len() > PASSWORD_MAX {
        return Err(format!("the password needs {PASSWORD_MIN} characters or more; a sentence works well"));
    }
    let hash = Argon2::default().hash_password(password.as_bytes());
    hash.map(|h| h.to_string()).map_err(|e| format!("the password cannot be hashed: {e}"))
}

/// Whether a password is the one that is kept.
pub(super) fn is_password(kept: &str, given: &str) -> bool {
    if given.len() > PASSWORD_MAX {
        return false;
    }
    argon2::password_hash::phc::PasswordHash::new(kept)
        .is_ok_and(|kept| Argon2::default().verify_password(given.as_bytes(), &kept).is_ok())
}
