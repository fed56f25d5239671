//! Who is connected: how many in all and from each address, who waits without asking for anything, and who may be closed to make room.
//!
//! Invariants: a [`Link`] is counted from [`Connections::enter`] until it is dropped, whatever ends its task. Only links that have no
//! request running and nothing left to write are ever closed for others, the one that has waited longest first: a server full of idle or
//! creeping connections still takes everyone who has a question. IPv6 clients are counted by their /64, which is what one gets.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};
use tokio::sync::Notify;

/// A link that began to wait less than this ago may be about to ask.
const FRESH: Duration = Duration::from_millis(500);

/// All connections.
#[derive(Debug)]
pub(crate) struct Connections {
    began: Instant,
    table: Mutex<Table>,
}

#[derive(Debug, Default)]
struct Table {
    next: u64,
    links: HashMap<u64, Weak<Link>>,
    by_address: HashMap<IpAddr, usize>,
}

/// One connection.
#[derive(Debug)]
pub(crate) struct Link {
    id: u64,
    /// The client's address as the socket knows it.
    pub(crate) address: IpAddr,
    all: Arc<Connections>,
    /// A request runs, or its answer is not all handed over.
    busy: AtomicBool,
    /// The socket takes nothing at the moment.
    pub(crate) blocked: AtomicBool,
    /// Milliseconds after `began` since which it waits for a request.
    waiting: AtomicU64,
    /// Counts requests, for the clock of the writing side.
    pub(crate) requests: AtomicU64,
    close: Notify,
}

impl Connections {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self { began: Instant::now(), table: Mutex::default() })
    }

    /// Count a new connection, unless its address has `most` already (0: no limit).
    pub(crate) fn enter(self: &Arc<Self>, address: IpAddr, max: usize) -> Option<Arc<Link>> {
        let mut table = self.table.lock().unwrap_or_else(PoisonError::into_inner);
        let count = table.by_address.entry(counted_as(address)).or_default();
        if max > 0 && *count >= max {
            return None;
        }
        *count += 1;
        let id = table.next;
        table.next += 1;
        let link = Arc::new(Link {
            id,
            address,
            all: Arc::clone(self),
            busy: AtomicBool::new(false),
            blocked: AtomicBool::new(false),
            waiting: AtomicU64::new(self.now()),
            requests: AtomicU64::new(0),
            close: Notify::new(),
        });
        table.links.insert(id, Arc::downgrade(&link));
        Some(link)
    }

    /// Close the link that has waited longest, where there is one that may be closed.
    pub(crate) fn evict(&self) -> bool {
        self.evict_idle_for(FRESH)
    }

    fn evict_idle_for(&self, at_least: Duration) -> bool {
        let table = self.table.lock().unwrap_or_else(PoisonError::into_inner);
        let idle = table.links.values().filter_map(Weak::upgrade).filter(|link| link.is_idle());
        let oldest = idle.min_by_key(|link| link.waiting.load(Ordering::Relaxed));
        drop(table);
        let at_least = u64::try_from(at_least.as_millis()).unwrap_or(u64::MAX);
        match oldest {
            Some(link) if self.now().saturating_sub(link.waiting.load(Ordering::Relaxed)) >= at_least => {
                link.close.notify_one();
                true
            }
            _ => false,
        }
    }

    /// Close all, whatever they do.
    pub(crate) fn close_all(&self) -> usize {
        let table = self.table.lock().unwrap_or_else(PoisonError::into_inner);
        let links: Vec<_> = table.links.values().filter_map(Weak::upgrade).collect();
        drop(table);
        for link in &links {
            link.close.notify_one();
        }
        links.len()
    }

    fn now(&self) -> u64 {
        u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX)
    }
}

impl Link {
    /// A request arrived.
    pub(crate) fn begin(&self) {
        self.requests.fetch_add(1, Ordering::Relaxed);
        self.busy.store(true, Ordering::Relaxed);
    }

    /// Its answer was handed over or given up.
    pub(crate) fn end(&self) {
        self.waiting.store(self.all.now(), Ordering::Relaxed);
        self.busy.store(false, Ordering::Relaxed);
    }

    /// Resolves when the link has to go.
    pub(crate) async fn closed(&self) {
        self.close.notified().await;
    }

    fn is_idle(&self) -> bool {
        !self.busy.load(Ordering::Relaxed) && !self.blocked.load(Ordering::Relaxed)
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        let mut table = self.all.table.lock().unwrap_or_else(PoisonError::into_inner);
        table.links.remove(&self.id);
        let address = counted_as(self.address);
        if let Some(count) = table.by_address.get_mut(&address) {
            *count = count.saturating_sub(1);
            if *count == 0 {
                table.by_address.remove(&address);
            }
        }
    }
}

/// An address as it is counted: IPv6 by the network that one client has.
pub(crate) fn counted_as(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => {
            let [a, b, c, d, ..] = v6.segments();
            IpAddr::V6(Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0))
        }
        v4 @ IpAddr::V4(_) => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn an_address_has_its_share_of_connections_and_regains_it() {
        let all = Connections::new();
        let held: Vec<_> = (0..3).map(|_| all.enter(ip("127.0.0.1"), 3).unwrap()).collect();
        assert!(all.enter(ip("127.0.0.1"), 3).is_none());
        assert!(all.enter(ip("::ffff:127.0.0.1"), 3).is_none(), "the same address in the other notation");
        assert!(all.enter(ip("127.0.0.2"), 3).is_some() && all.enter(ip("127.0.0.1"), 0).is_some());
        drop(held);
        assert!(all.enter(ip("127.0.0.1"), 3).is_some());
        let one = all.enter(ip("2001:db8:1:2::1"), 1);
        assert!(one.is_some() && all.enter(ip("2001:db8:1:2:3::9"), 1).is_none(), "one /64 is one client");
        assert!(all.enter(ip("2001:db8:1:3::1"), 1).is_some());
        drop(one);
        assert!(all.table.lock().unwrap().links.is_empty() && all.table.lock().unwrap().by_address.is_empty());
    }

    #[tokio::test]
    async fn the_longest_idle_connection_is_closed_first_and_a_busy_one_never() {
        let all = Connections::new();
        let [first, second, third] = [1, 2, 3].map(|_| all.enter(ip("127.0.0.1"), 0).unwrap());
        assert!(!all.evict_idle_for(Duration::from_secs(3600)), "they have only just come");
        first.begin();
        second.waiting.store(0, Ordering::Relaxed);
        third.waiting.store(1, Ordering::Relaxed);
        let evict = || all.evict_idle_for(Duration::ZERO);
        assert!(evict());
        second.closed().await;
        drop(second);
        third.blocked.store(true, Ordering::Relaxed);
        assert!(!evict(), "one works, the other still writes");
        third.blocked.store(false, Ordering::Relaxed);
        assert!(evict());
        third.closed().await;
        assert_eq!(all.close_all(), 2);
        first.closed().await;
    }
}
