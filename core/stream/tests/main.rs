//! The streamer over simulated networks.

mod flights;
#[cfg(unix)]
mod giant;
mod random_network;
mod support;
