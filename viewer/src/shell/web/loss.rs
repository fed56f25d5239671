//! The loss of the graphics device: a flag, and a future for whoever waits for it.

use std::future::poll_fn;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::task::{Poll, Waker};

/// Whether the device is lost.
#[derive(Default)]
pub(super) struct Loss {
    has_happened: AtomicBool,
    waker: Mutex<Option<Waker>>,
}

impl Loss {
    /// It is lost.
    pub(super) fn happened(&self) {
        self.has_happened.store(true, Ordering::Relaxed);
        if let Some(waker) = self.waker.lock().unwrap_or_else(PoisonError::into_inner).take() {
            waker.wake();
        }
    }

    /// Whether it is.
    pub(super) fn has_happened(&self) -> bool {
        self.has_happened.load(Ordering::Relaxed)
    }

    /// Until it is. One at a time can wait.
    pub(super) async fn wait(&self) {
        poll_fn(|context| {
            if self.has_happened() {
                return Poll::Ready(());
            }
            *self.waker.lock().unwrap_or_else(PoisonError::into_inner) = Some(context.waker().clone());
            Poll::Pending
        })
        .await;
    }
}
