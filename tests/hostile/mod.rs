//! Inputs that somebody made to do harm: that name other files, that take time or memory without measure, that write to the
//! terminal of whoever looks at them.

mod bounded;
mod outside;
mod printed;
