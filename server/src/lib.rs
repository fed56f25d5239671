//! `kilwa serve`: a folder of packs over HTTP, with the viewer page.
//!
//! [`app`] is the whole site as an axum router over a [`Site`] (packs of a [`Catalogue`], files of the [`Page`]);
//! tests drive it with `oneshot`, without a socket. [`listen`] gives it a socket with the limits that axum's own loop
//! lacks.
//!
//! Invariants: a URL never becomes a path (slugs and page files are looked up in a table made from what is really
//! there); a pack is served byte for byte, never encoded, under an ETag that is the hash of its content; the page needs
//! no inline script or style. Everything here would work from a plain static host too: the server adds no protocol.

mod catalogue;
mod html;
pub mod index;
pub mod object;
mod packs;
mod page;
mod range;
mod site;
mod socket;

pub use catalogue::{Catalogue, CatalogueError, Model, Summary};
pub use page::{Page, PageError};
pub use site::{Site, app};
pub use socket::{Limits, listen};
