//! The trust suite (docs/trust.md): what `kilwa measure` promises, each property with its bound and the error measured.
//!
//! `cargo xtask test trust` runs it and prints the properties as one table, which `docs/trust.md` explains, so that other viewers can
//! be held to the same. Packs are built from phantoms whose sizes are known, at the origin, at UTM coordinates and 10^7 m away; the
//! oracles are rewritten here, from the triangles that went in, not from the code that is tested.

mod accuracy;
mod digits;
mod drawings;
mod opinions;
mod oracle;
mod page;
mod phantoms;
mod provisional;
mod rays;
mod refusals;
mod saved;

/// Check a property: prints the row of the table, and fails if the measured error exceeds the bound.
fn check_bound(what: &str, bound: f64, measured: f64) {
    println!("trust | {what} | {bound:.3e} | {measured:.3e}");
    assert!(measured <= bound, "{what}: {measured:e} is more than {bound:e}");
}

/// Check that a count of exceptions is zero.
fn check_none(what: &str, of: usize, exceptions: usize) {
    println!("trust | {what} | 0 of {of} | {exceptions}");
    assert_eq!(exceptions, 0, "{what}");
}
