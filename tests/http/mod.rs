//! `kilwa serve` as a process under the conditions of a public server: exact ranges, hostile addresses, slow and many clients,
//! signals to stop, proxies in front of it.
//!
//! `cargo xtask test` runs the short form, which makes no claims about time; `cargo xtask test soak` sets `KILWA_SOAK` and runs the full numbers,
//! one test at a time, and prints each property with its bound and the measured value (archived in docs/bench).
//! Traffic goes to this machine only, from several of its loopback addresses; loops are bounded.

pub(crate) mod client;
mod crowd;
mod limits;
mod logs;
mod portal;
mod process;
mod proxies;
mod ranges;
mod slow;
mod stop;
mod traversal;
mod viewers;
mod worst;

/// Whether to run with the full numbers.
fn full() -> bool {
    std::env::var_os("KILWA_SOAK").is_some()
}

/// Check a property: prints the row of the table, and fails if the measured value exceeds the bound.
fn check_bound(what: &str, unit: &str, bound: f64, measured: f64) {
    println!("soak | {what}, {unit} | {bound} | {measured:.3}");
    assert!(measured <= bound, "{what}: {measured} {unit} is more than {bound}");
}

/// As [`check_bound`], for times: a machine that is busy with other things proves nothing about them, so only the long form checks them.
fn check_time(what: &str, unit: &str, bound: f64, measured: f64) {
    if full() {
        check_bound(what, unit, bound, measured);
    }
}

/// A remark below the table of the long form.
fn remark(text: &str) {
    if full() {
        println!("{text}");
    }
}

/// Check that a count of exceptions is zero.
fn check_none(what: &str, of: usize, exceptions: &[String]) {
    println!("soak | {what} | 0 of {of} | {}", exceptions.len());
    assert!(exceptions.is_empty(), "{what}: {} of {of}, such as {}", exceptions.len(), exceptions[0]);
}

/// A reproducible file of no particular content.
fn noise(length: usize, seed: u64) -> Vec<u8> {
    let mut bytes = vec![0; length];
    let (magic, rest) = bytes.split_at_mut(kilwa_pack::header::MAGIC.len());
    magic.copy_from_slice(&kilwa_pack::header::MAGIC);
    fastrand::Rng::with_seed(seed).fill(rest);
    bytes
}

/// The value below which `share` of the values lie.
fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (sorted.len() as f64 * share).ceil() as usize;
    sorted[at.clamp(1, sorted.len()) - 1]
}
