//! Synthetic sites.
