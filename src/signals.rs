//! Handles Ctrl-C, SIGTERM and SIGHUP: unfinished temporary files are removed, and the program exits with 128 plus the number of the
//! signal, as shells report it. `build`, `serve` and `metadata edit` end in their own way.
//!
//! An ignored signal stays ignored (`nohup`).

use kilwa_files::unfinished;
use std::io;

/// The number of SIGINT.
pub(crate) const INTERRUPT: i32 = 2;

/// From here on, a signal ends the program and no unfinished file remains. If signals cannot be handled, they act as before.
pub(crate) fn end_at_once() {
    drop(listen(end));
}

/// Remove unfinished files, and exit.
pub(crate) fn end(signal: i32) {
    unfinished::remove_all();
    std::process::exit(128 + signal);
}

/// Call `act` with the number of each signal received, on a separate thread.
///
/// # Errors
/// If the system does not allow it.
#[cfg(unix)]
pub(crate) fn listen(act: impl FnMut(i32) + Send + 'static) -> io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let mut signals = Vec::new();
    {
        let _inside = runtime.enter();
        for kind in [SignalKind::hangup(), SignalKind::interrupt(), SignalKind::terminate()] {
            let number = kind.as_raw_value();
            if !is_ignored(number) {
                signals.push((number, signal(kind)?));
            }
        }
    }
    let wait = move || runtime.block_on(hand_on(signals, act));
    std::thread::Builder::new().name("signals".to_owned()).spawn(wait)?;
    Ok(())
}

/// Wait for signals, for ever.
#[cfg(unix)]
async fn hand_on(mut signals: Vec<(i32, tokio::signal::unix::Signal)>, mut act: impl FnMut(i32)) {
    use std::task::Poll;
    loop {
        let next = std::future::poll_fn(|context| {
            let came = |(number, signal): &mut (i32, tokio::signal::unix::Signal)| {
                signal.poll_recv(context).is_ready().then_some(*number)
            };
            signals.iter_mut().find_map(came).map_or(Poll::Pending, Poll::Ready)
        });
        act(next.await);
    }
}

/// The same on systems that have only Ctrl-C.
///
/// # Errors
/// If the system does not allow it.
#[cfg(not(unix))]
pub(crate) fn listen(mut act: impl FnMut(i32) + Send + 'static) -> io::Result<()> {
    ctrlc::set_handler(move || act(INTERRUPT)).map_err(io::Error::other)
}

/// Whether a signal is ignored, if the system reports that (Linux). Bit n - 1 of `SigIgn` is for number n.
#[cfg(unix)]
pub(crate) fn is_ignored(number: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (number - 1) & 1 == 1
}
