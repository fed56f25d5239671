//! `kilwa register`.

#[cfg_attr(not(test), allow(dead_code))]
mod report;
