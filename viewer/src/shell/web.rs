//! The browser: canvas, fetch and workers.
