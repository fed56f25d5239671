//! Jobs that wait, and whose turn it is: each network has a queue of its own, and the networks take turns, so that one that asks for many files lets those
//! of all others go between its own.
//!
//! Invariants: a network has at most [`SHARE`] places and there are at most [`PLACES`] in all; a network that had its turn goes behind all that wait at that
//! moment, and no newcomer goes before one that waits, so that everybody's turn comes. A network has at most so many jobs running that a worker is left for
//! others, where there is more than one.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Places in all; for more, whoever asks has to come back.
pub(super) const PLACES: usize = 64;
/// Places of one network.
pub(super) const SHARE: usize = 4;

/// Why there is no place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Full {
    /// All are taken.
    All,
    /// Those of this network are.
    Share,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Queue {
    /// Networks in the order of their turns, each with the keys of its jobs.
    queues: VecDeque<(String, VecDeque<String>)>,
    /// How many jobs of each network are running.
    running: BTreeMap<String, usize>,
}

impl Queue {
    /// A place for a new job.
    ///
    /// # Errors
    /// [`Full`].
    pub(super) fn push(&mut self, network: &str, key: &str) -> Result<(), Full> {
        if self.queue_of(network).map_or(0, VecDeque::len) >= SHARE {
            return Err(Full::Share);
        }
        if self.queues.iter().map(|(_, waiting)| waiting.len()).sum::<usize>() >= PLACES {
            return Err(Full::All);
        }
        match self.queues.iter_mut().find(|(n, _)| n == network) {
            Some((_, waiting)) => waiting.push_back(key.to_owned()),
            None => self.queues.push_back((network.to_owned(), VecDeque::from([key.to_owned()]))),
        }
        Ok(())
    }

    /// Another network wants a job that waits: it has a place in the queue of each, as far as there are places.
    pub(super) fn join(&mut self, network: &str, key: &str) {
        if self.queue_of(network).is_none_or(|waiting| !waiting.iter().any(|k| k == key)) {
            // Without a place of its own it has that of the other.
            let _ = self.push(network, key);
        }
    }

    fn queue_of(&self, network: &str) -> Option<&VecDeque<String>> {
        self.queues.iter().find(|(n, _)| n == network).map(|(_, waiting)| waiting)
    }

    /// Network and key of the job whose turn it is, where `workers` make them.
    pub(super) fn next(&self, workers: usize) -> Option<(String, String)> {
        let max = workers.saturating_sub(1).max(1);
        let running = |network: &str| self.running.get(network).copied().unwrap_or(0);
        let may = self.queues.iter().filter(|(network, _)| running(network) < max);
        // The first of those that have the fewest running.
        let (network, waiting) = may.min_by_key(|(network, _)| running(network))?;
        Some((network.clone(), waiting.front()?.clone()))
    }

    /// A job begins, for a network.
    pub(super) fn begin(&mut self, network: &str, key: &str) {
        self.remove(key);
        *self.running.entry(network.to_owned()).or_default() += 1;
        self.move_back(network);
    }

    /// A job of a network has ended.
    pub(super) fn end(&mut self, network: &str) {
        if let Some(count) = self.running.get_mut(network) {
            *count = count.saturating_sub(1);
        }
        self.running.retain(|_, count| *count > 0);
        self.move_back(network);
    }

    /// A job no longer waits.
    pub(super) fn remove(&mut self, key: &str) {
        for (_, waiting) in &mut self.queues {
            waiting.retain(|k| k != key);
        }
        self.queues.retain(|(_, waiting)| !waiting.is_empty());
    }

    fn move_back(&mut self, network: &str) {
        if let Some(at) = self.queues.iter().position(|(n, _)| n == network)
            && let Some(waiting) = self.queues.remove(at)
        {
            self.queues.push_back(waiting);
        }
    }

    /// The jobs that will begin before one that waits, in their order, as far as is known now.
    pub(super) fn before(&self, key: &str) -> Vec<String> {
        let mut queues = self.queues.clone();
        // Whoever has one running goes behind the others when it ends.
        let has_running = |(network, _): &(String, VecDeque<String>)| self.running.contains_key(network);
        queues.make_contiguous().sort_by_key(has_running);
        let (mut before, mut begun) = (Vec::new(), BTreeSet::new());
        while let Some((network, mut waiting)) = queues.pop_front() {
            let Some(next) = waiting.pop_front() else { continue };
            if next == key {
                break;
            }
            if begun.insert(next.clone()) {
                before.push(next);
            }
            queues.push_back((network, waiting));
        }
        before
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Begin and end one job after the other, with one worker; the keys in their order.
    fn order(queue: &mut Queue) -> Vec<String> {
        let mut all = Vec::new();
        while let Some((network, key)) = queue.next(1) {
            queue.begin(&network, &key);
            queue.end(&network);
            all.push(key);
        }
        all
    }

    fn with(jobs: &[(&str, &str)]) -> Queue {
        let mut queue = Queue::default();
        for (network, key) in jobs {
            queue.push(network, key).unwrap();
        }
        queue
    }

    #[test]
    fn networks_take_turns_regardless_of_order_and_number_of_their_requests() {
        let jobs = [("a", "a1"), ("a", "a2"), ("a", "a3"), ("a", "a4"), ("b", "b1"), ("c", "c1"), ("b", "b2")];
        let mut queue = with(&jobs);
        for (key, before) in [("a1", 0), ("b1", 1), ("c1", 2), ("a2", 3), ("b2", 4), ("a4", 6)] {
            assert_eq!(queue.before(key).len(), before, "{key}");
        }
        assert_eq!(order(&mut queue), ["a1", "b1", "c1", "a2", "b2", "a3", "a4"]);
    }

    #[test]
    fn a_network_that_arrives_while_another_is_served_is_next() {
        let mut queue = with(&[("a", "a1"), ("a", "a2"), ("a", "a3")]);
        queue.begin("a", "a1");
        queue.push("b", "b1").unwrap();
        assert_eq!(queue.before("b1"), [""; 0]);
        assert_eq!(queue.next(1).unwrap().1, "b1");
        queue.end("a");
        assert_eq!(order(&mut queue), ["b1", "a2", "a3"]);
    }

    #[test]
    fn one_of_several_workers_is_kept_free_for_other_networks() {
        let mut queue = with(&[("a", "a1"), ("a", "a2"), ("a", "a3")]);
        queue.begin("a", "a1");
        assert_eq!(queue.next(2), None, "the second worker is for others");
        assert_eq!(queue.next(3).unwrap().1, "a2");
        queue.push("b", "b1").unwrap();
        assert_eq!(queue.next(2).unwrap().1, "b1");
        assert_eq!(queue.next(3).unwrap().1, "b1", "it has fewer running");
    }

    #[test]
    fn the_queue_is_limited_per_network_and_in_total_and_a_waiting_job_can_be_joined() {
        let mut queue = Queue::default();
        for number in 0..SHARE {
            queue.push("greedy", &format!("g{number}")).unwrap();
        }
        assert_eq!(queue.push("greedy", "more"), Err(Full::Share));
        for number in 0..PLACES - SHARE {
            queue.push(&format!("n{number}"), &format!("j{number}")).unwrap();
        }
        assert_eq!(queue.push("late", "l"), Err(Full::All));
        queue.join("late", "g3");
        assert_eq!(queue.before("l").len(), PLACES, "it has no place");
        queue.remove("j0");
        queue.join("late", "g3");
        queue.join("late", "g3");
        assert_eq!(queue.queue_of("late").unwrap().len(), 1);
        let all = order(&mut queue);
        assert_eq!(all.len(), PLACES - 1, "what two want is made once");
        assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), all.len());
    }

    #[test]
    fn many_new_networks_do_not_delay_anyone_already_waiting() {
        let mut queue = with(&[("a", "a1"), ("a", "a2")]);
        let mut waited = 0;
        for number in 0..50 {
            queue.push(&format!("n{number}"), &format!("j{number}")).unwrap();
            let (network, key) = queue.next(1).unwrap();
            queue.begin(&network, &key);
            queue.end(&network);
            if key == "a2" {
                break;
            }
            waited += 1;
        }
        assert!(waited <= 3, "{waited}");
    }
}
