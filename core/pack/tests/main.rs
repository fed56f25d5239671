//! Packs from outside: what is written is read again, and what is damaged is refused.

mod codec;
mod common;
mod container;
mod cuts;
mod relocate;
