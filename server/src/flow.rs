//! Answers that are long by nature, made piece by piece: the next piece is made when the reader has taken the one before, so that an answer of any length
//! holds a piece or two in memory, however slowly it is taken.
//!
//! What goes wrong behind the first piece ends the connection before the answer's end, which no client takes for the whole.

use axum::body::{Body, Bytes};
use futures_util::stream::try_unfold;
use std::io;

/// Makes the next piece; `None` behind the last.
pub(crate) type Next<S> = fn(&mut S) -> io::Result<Option<String>>;

/// A body of `first` and what `next` makes of `state`, on a thread for blocking work.
pub(crate) fn body<S: Send + 'static>(first: String, state: S, next: Next<S>) -> Body {
    let pieces = try_unfold((Some(first), state), move |(first, mut state)| async move {
        if let Some(first) = first {
            return Ok::<_, io::Error>(Some((Bytes::from(first), (None, state))));
        }
        let made = tokio::task::spawn_blocking(move || next(&mut state).map(|piece| (piece, state))).await;
        let (piece, state) = made.map_err(io::Error::other)??;
        Ok(piece.map(|piece| (Bytes::from(piece), (None, state))))
    });
    Body::from_stream(pieces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::StreamExt as _;
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
    async fn a_piece_is_made_when_it_is_wanted_and_a_failure_is_no_end() {
        let made = Arc::new(AtomicUsize::new(0));
        let mut pieces = body("0".to_owned(), (Arc::clone(&made), 0), count).into_data_stream();
        assert_eq!(pieces.next().await.unwrap().unwrap(), "0");
        assert_eq!(made.load(Ordering::SeqCst), 0, "nobody wanted the next");
        assert_eq!(pieces.next().await.unwrap().unwrap(), "1");
        assert_eq!(made.load(Ordering::SeqCst), 1);
        let rest: Vec<_> = pieces.map(Result::unwrap).collect().await;
        assert_eq!(rest, ["2", "3", "4"]);
        let cut = body(String::new(), (Arc::default(), 3), count).into_data_stream();
        let pieces: Vec<_> = cut.collect().await;
        assert!(pieces.len() == 4 && pieces[3].is_err());
    }
}
