//! The streamer over simulated networks.

mod flights;
mod random_network;
mod support;
