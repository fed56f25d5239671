//! A way to a store on which requests fail as with a store that is too busy: 503, answers that break off or are lost, and slow ones; or which does not keep to conditions.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const BUSY: &str = "<Error><Code>SlowDown</Code><Message>Reduce your request rate.</Message></Error>";

/// Counts of what happened to requests.
#[derive(Default)]
pub(super) struct Seen {
    pub(super) all: AtomicU64,
    pub(super) busy: AtomicU64,
    pub(super) broken: AtomicU64,
}

/// What happens on the way.
#[derive(Clone, Copy, Default)]
pub(super) struct Trouble {
    /// Of a hundred requests, so many fail; with 100, all.
    pub(super) percent: u8,
    /// Whether a refusal to replace an object is answered as if it had been replaced.
    pub(super) ignores_conditions: bool,
    pub(super) seed: u64,
}

/// Its port.
pub(super) fn proxy(upstream: u16, trouble: Trouble) -> (u16, Arc<Seen>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let (seen, random) = (Arc::new(Seen::default()), Arc::new(Mutex::new(fastrand::Rng::with_seed(trouble.seed))));
    let counts = Arc::clone(&seen);
    std::thread::spawn(move || {
        for near in listener.incoming().map_while(Result::ok) {
            let (seen, random) = (Arc::clone(&counts), Arc::clone(&random));
            // Errors of a connection are handled by the client.
            std::thread::spawn(move || drop(one(near, upstream, trouble, &seen, &random)));
        }
    });
    (port, seen)
}

/// One request and its response; then the connection is closed.
fn one(
    mut near: TcpStream,
    upstream: u16,
    Trouble { percent, ignores_conditions, .. }: Trouble,
    seen: &Seen,
    random: &Mutex<fastrand::Rng>,
) -> std::io::Result<()> {
    let mut reader = BufReader::new(near.try_clone()?);
    let (mut head, mut length) = (String::new(), 0);
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 {
            return Ok(());
        }
        if line == "\r\n" {
            break;
        }
        if let Some(("content-length", value)) = line.to_lowercase().split_once(':') {
            length = value.trim().parse().unwrap_or(0);
        }
        head += &line;
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body)?;
    seen.all.fetch_add(1, Ordering::Relaxed);
    let (fails, kind) = {
        let mut random = random.lock().unwrap();
        (random.u8(..100) < percent, random.u8(..10))
    };
    if fails && (kind < 8 || percent == 100) {
        seen.busy.fetch_add(1, Ordering::Relaxed);
        let answer = format!(
            "HTTP/1.1 503 Service Unavailable\r\ncontent-length: {}\r\nconnection: close\r\n\r\n{BUSY}",
            BUSY.len()
        );
        near.write_all(answer.as_bytes())?;
        return near.shutdown(Shutdown::Both);
    }
    let mut far = TcpStream::connect(("127.0.0.1", upstream))?;
    far.write_all(format!("{head}connection: close\r\n\r\n").as_bytes())?;
    far.write_all(&body)?;
    let mut answer = Vec::new();
    far.read_to_end(&mut answer)?;
    if ignores_conditions && answer.starts_with(b"HTTP/1.1 412") {
        answer = b"HTTP/1.1 200 OK\r\netag: \"0\"\r\ncontent-length: 0\r\nconnection: close\r\n\r\n".to_vec();
    }
    if fails {
        seen.broken.fetch_add(1, Ordering::Relaxed);
        answer.truncate(if kind == 8 { 0 } else { answer.len() / 2 });
    } else if kind == 0 {
        std::thread::sleep(Duration::from_millis(10));
    }
    near.write_all(&answer)?;
    near.shutdown(Shutdown::Both)
}
