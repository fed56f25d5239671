//! Who may see what: rules, accounts, short-lived capabilities for packs, rate limits on guessing, and the audit log.
//!
//! Pure but for [`accounts`] (one file) and [`audit`] (one log): time and addresses are handed in, so that every second of an embargo can be
//! tested. Nothing here speaks HTTP. Secrets are compared in constant time, and appear in no message and no log.
//!
//! One file per part: `rule` (an object's access and the time give a verdict), `accounts` (users and tokens), `secret` (passwords,
//! tokens, keys), `capability` (what a range request carries), `attempts` (rate limits), `audit` (who was let in to what).

pub mod accounts;
pub mod attempts;
pub mod audit;
pub mod capability;
mod rule;
mod secret;
pub mod sessions;

pub use accounts::{Accounts, AccountsError, Grant, Purpose, User};
pub use attempts::Attempts;
pub use audit::Audit;
pub use capability::{Capabilities, Holder, Refusal};
pub use rule::Clock;
pub(crate) use rule::{Verdict, verdict};
pub use sessions::Sessions;
