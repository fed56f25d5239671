//! A proxy that breaks: forwards bytes to the server until a budget is spent, then drops both sides.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::thread::spawn;

pub(crate) struct Proxy {
    pub(crate) address: SocketAddr,
    /// Bytes that go through, both ways together, before every connection breaks; as many as one likes where it is negative.
    budget: Arc<AtomicI64>,
}

impl Proxy {
    pub(crate) fn before(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let budget = Arc::new(AtomicI64::new(i64::MAX));
        let left = Arc::clone(&budget);
        spawn(move || {
            for client in listener.incoming().flatten() {
                let Ok(server) = TcpStream::connect(server) else { continue };
                let ends = [(client.try_clone(), server.try_clone()), (server.try_clone(), client.try_clone())];
                for (from, to) in ends {
                    let (Ok(from), Ok(to), left) = (from, to, Arc::clone(&left)) else { continue };
                    spawn(move || pump(from, to, &left));
                }
            }
        });
        Self { address, budget }
    }

    /// Break after so many more bytes.
    pub(crate) fn allow(&self, bytes: i64) {
        self.budget.store(bytes, Ordering::SeqCst);
    }

    /// Whether it broke.
    pub(crate) fn is_cut(&self) -> bool {
        self.budget.load(Ordering::SeqCst) <= 0
    }
}

fn pump(mut from: TcpStream, mut to: TcpStream, left: &AtomicI64) {
    let mut buffer = [0; 4096];
    while let Ok(n) = from.read(&mut buffer) {
        if n == 0 {
            break;
        }
        let before = left.fetch_sub(n as i64, Ordering::SeqCst);
        let through = usize::try_from(before).unwrap_or(0).min(n);
        if to.write_all(&buffer[..through]).is_err() || through < n {
            break;
        }
    }
    drop((from.shutdown(std::net::Shutdown::Both), to.shutdown(std::net::Shutdown::Both)));
}
