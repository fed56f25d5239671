//! Answers that are long by nature, made piece by piece: the next piece is made when the reader has taken the one before, so that an answer of any length
//! holds a piece or two in memory, however slowly it is taken.
//!
//! An error after the first piece ends the connection before the end of the answer, so that no client takes it for complete.

use crate::gate::Turns;
use axum::body::{Body, Bytes};
use futures_util::stream::try_unfold;
use std::io;

/// Makes the next piece; `None` behind the last.
pub(crate) type Next<S> = fn(&mut S) -> io::Result<Option<String>>;

/// A body of `first` and the pieces that `next` makes from `state` on a thread for blocking work. With `turns`, each piece waits for a slot, which is released
/// when the piece is made.
pub(crate) fn body<S: Send + 'static>(first: String, state: S, next: Next<S>, turns: Option<Turns>) -> Body {
    let pieces = try_unfold((Some(first), state, turns), move |(first, mut state, turns)| async move {
        if let Some(first) = first {
            return Ok::<_, io::Error>(Some((Bytes::from(first), (None, state, turns))));
        }
        let place = match &turns {
            Some(turns) => Some(turns.next().await.ok_or_else(|| io::Error::other("the server is stopping"))?),
            None => None,
        };
        let work = move || {
            let made = next(&mut state);
            // Released when the work ends, not when a reader hangs up meanwhile.
            drop(place);
            made.map(|piece| (piece, state))
        };
        let made = tokio::task::spawn_blocking(work).await;
        let (piece, state) = made.map_err(io::Error::other)??;
        Ok(piece.map(|piece| (Bytes::from(piece), (None, state, turns))))
    });
    Body::from_stream(pieces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::Gate;
    use futures_util::{FutureExt as _, StreamExt as _};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Counts to five, or fails at a number.
    fn count((made, fails): &mut (Arc<AtomicUsize>, usize)) -> io::Result<Option<String>> {
        let number = made.fetch_add(1, Ordering::SeqCst) + 1;
        if number == *fails {
            return Err(io::Error::other("failed"));
        }
        Ok((number < 5).then(|| number.to_string()))
    }

    #[tokio::test]
    async fn a_piece_is_made_on_demand_and_a_failure_is_not_taken_for_the_end() {
        let made = Arc::new(AtomicUsize::new(0));
        let mut pieces = body("0".to_owned(), (Arc::clone(&made), 0), count, None).into_data_stream();
        assert_eq!(pieces.next().await.unwrap().unwrap(), "0");
        assert_eq!(made.load(Ordering::SeqCst), 0, "nobody wanted the next");
        assert_eq!(pieces.next().await.unwrap().unwrap(), "1");
        assert_eq!(made.load(Ordering::SeqCst), 1);
        let rest: Vec<_> = pieces.map(Result::unwrap).collect().await;
        assert_eq!(rest, ["2", "3", "4"]);
        let cut = body(String::new(), (Arc::default(), 3), count, None).into_data_stream();
        let pieces: Vec<_> = cut.collect().await;
        assert!(pieces.len() == 4 && pieces[3].is_err());
    }
    #[tokio::test]
    async fn each_piece_waits_for_a_slot_and_no_slot_is_held_between_pieces() {
        let (gate, made) = (Arc::<Gate>::default(), Arc::new(AtomicUsize::new(0)));
        let turns = Some(Turns::new(&gate, "a"));
        let mut pieces = body("0".to_owned(), (Arc::clone(&made), 0), count, turns).into_data_stream();
        let held = [gate.enter("a").await, gate.enter("a").await];
        assert_eq!(pieces.next().await.unwrap().unwrap(), "0");
        assert!(pieces.next().now_or_never().is_none(), "its network has its share");
        // By the end of this loop, any piece that was begun would be finished.
        for _ in 0..100 {
            tokio::task::spawn_blocking(|| ()).await.unwrap();
        }
        assert_eq!(made.load(Ordering::SeqCst), 0);
        drop(held);
        for number in 1..5 {
            assert_eq!(pieces.next().await.unwrap().unwrap(), number.to_string());
            let all = [gate.enter("a").now_or_never(), gate.enter("a").now_or_never()];
            assert!(all.iter().all(Option::is_some), "no slot is held while the reader takes piece {number}");
        }
        assert!(pieces.next().await.is_none());
    }
}
