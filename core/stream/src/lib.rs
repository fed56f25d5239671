//! Which chunks to fetch, decode, upload, draw and evict: a pure state machine, without I/O, clock or threads.
//!
//! The shell (a browser page, the headless renderer, a simulation) owns a [`Streamer`], passes it what happened as
//! [`Event`]s and where the camera is as a [`View`], and gets [`Command`]s to carry out and the cut to draw
//! ([`DrawPatch`]) from [`Streamer::step`]. The same calls in the same order give the same answers.
//!
//! Invariants, whatever the order of events: every drawn chunk is resident; the drawn cut is closed under parents, and a chunk of it that
//! is not resident is wholly replaced by its children, so it has neither a hole nor an overlap; what is held never exceeds the budgets ([`Budgets`]), the root chunk excepted.
//! With a network that works in the end and a camera at rest, the drawn pixel error falls to the target or to what the
//! budgets allow, and then nothing moves.
//!
//! A camera that glides is met by what it will see ([`streamer`] predicts it from the views it is given); [`Pace`] steers the pixel error by
//! the frame time; [`sim`] flies a streamer over a pack through a simulated network.
//!
//! A failed request, a damaged chunk or page is retried for as long as the streamer lives, with exponential backoff
//! and deterministic jitter.

pub mod command;
mod draw;
mod fetch;
mod nodes;
pub mod pace;
mod predict;
mod select;
pub mod sim;
mod skip;
pub mod streamer;
pub mod view;

pub use command::{Budgets, Command, DrawPatch, Event, FetchKind, HEAD_REQUEST, RequestId, Stats, Step, length_of};
pub use kilwa_geometry::clip::{self, Clip};
pub use pace::Pace;
pub use streamer::Streamer;
pub use view::{Projection, View};
