//! Integration tests of the server: requests to a site over a folder or a store, without a socket unless one is meant.

mod auth;
mod common;
mod control;
#[path = "common/eventually.rs"]
mod eventually;
mod extracts;
mod index;
mod institution;
mod objects;
mod packs;
mod pages;
mod portal;
mod socket;
mod store;
mod survey;
mod transfers;
mod uploads;
