//! `kilwa serve` as a process under everything that a public server meets: exact ranges, hostile addresses, slow and many clients, the
//! order to stop, proxies in front of it.
//!
//! `cargo xtask test` runs the short form, without asserting times; `cargo xtask test soak` sets `KILWA_SOAK` and runs the full numbers,
//! one test at a time, and prints each claim with its bound and what was measured (archived in docs/bench).
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

/// Whether the full numbers are wanted.
fn full() -> bool {
    std::env::var_os("KILWA_SOAK").is_some()
}

/// State a claim: prints the row of the table, and fails where what was measured is more than the bound.
fn claim(what: &str, unit: &str, bound: f64, measured: f64) {
    println!("soak | {what}, {unit} | {bound} | {measured:.3}");
    assert!(measured <= bound, "{what}: {measured} {unit} is more than {bound}");
}

/// As [`claim`], about time or memory: in the short form, on a machine that does other things too, it is printed and not asserted.
fn claim_when_quiet(what: &str, unit: &str, bound: f64, measured: f64) {
    if full() {
        claim(what, unit, bound, measured);
    } else {
        println!("{what}: {measured:.3} {unit}, bound {bound} (asserted by cargo xtask test soak)");
    }
}

/// State a claim about a count of exceptions, which has to be zero.
fn claim_none(what: &str, of: usize, exceptions: &[String]) {
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
