//! The tests of the whole program, in one binary, because linking one takes as long as linking each of many would.

mod access;
#[path = "../server/tests/store/bucket.rs"]
#[allow(dead_code, reason = "the tests of the server use all of it")]
mod bucket;
#[cfg(unix)]
mod build_resume;
mod capture_accuracy;
mod cli;
mod colour;
mod divided;
#[path = "../server/tests/common/eventually.rs"]
mod eventually;
// Named by `send`, which is compiled into the tests of uploads.
#[path = "../src/distrust.rs"]
mod distrust;
mod extract;
mod gpu;
mod hostile;
mod http;
mod info_mesh;
mod inputs;
#[cfg(unix)]
mod interrupted;
mod merge;
mod pack_verbs;
mod passwords;
mod patch_sizes;
mod points;
mod publish;
mod real_formats;
mod real_input;
mod register;
mod remote;
mod render_verb;
mod scans;
mod second_reader;
mod serve;
mod sketchfab;
mod stored;
mod streaming;
mod support;
mod synth;
mod tasks;
mod trust;
mod tutorial;
mod verify_objects;
mod verify_state;
mod verify_tls;
