//! `kilwa serve`: a folder of archive objects and packs over HTTP, with the viewer page; or a survey, with pictures of its stations.
//!
//! [`app`] is the whole site as an axum router over a [`Site`] (models of a [`Catalogue`], files of the [`Page`], a [`Policy`]);
//! tests drive it with `oneshot`, without a socket. [`listen`] gives it a socket with the limits that axum's own loop
//! lacks.
//!
//! Invariants: a URL never becomes a path (slugs, an object's files and page files are looked up in tables made from what is really
//! there); a pack is served byte for byte, never encoded, under an ETag that is the hash of its content; the page needs
//! no inline script or style. Everything here would work from a plain static host too: the server adds no protocol.

pub mod access;
pub mod auth;
mod budget;
mod catalogue;
mod connections;
mod content;
mod countries;
mod ending;
#[cfg(test)]
#[path = "../tests/common/eventually.rs"]
mod eventually;
pub mod extracts;
mod flow;
mod gate;
mod html;
pub mod index;
pub mod metadata_form;
mod metrics;
mod object_files;
mod objects;
mod observe;
mod packs;
mod policy;
mod portal;
mod range;
mod recheck;
mod site;
mod socket;
pub mod store;
mod survey;
pub mod upload;

pub use access::Clock;
pub use catalogue::{Catalogue, CatalogueError, Model, Summary};
pub use kilwa_archive::viewer::{Page, PageError};
pub use metrics::Metrics;
pub use policy::{Policy, PolicyError};
pub use portal::collections::{Collections, FILE as COLLECTIONS_FILE};
pub use portal::featured::report_featured;
pub use portal::site_file::{FILE as SITE_FILE, SiteFile};
pub use site::{Audience, Site, app};
pub use socket::{Limits, listen};
pub use survey::Surveyed;

/// How long the server trusts what it read of a folder, of the accounts or of the right to a running transfer. Then it checks again. Tests set it to zero.
pub const FRESHNESS: std::time::Duration = std::time::Duration::from_secs(1);
