//! A response body that reports, once, how it ended: sent to its last byte, or abandoned before.

use axum::body::{Body, Bytes};
use axum::http::Response;
use http_body::{Body as _, Frame, SizeHint};
use std::pin::Pin;
use std::task::{Context, Poll, ready};

/// How a response ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct End {
    /// Bytes handed over.
    pub(crate) bytes: u64,
    /// All of them.
    pub(crate) complete: bool,
}

/// The report to be made; it is also made if no response is ever wrapped.
pub(crate) struct Ending<F: FnOnce(End)> {
    report: Option<F>,
    end: End,
}

impl<F: FnOnce(End) + Send + Unpin + 'static> Ending<F> {
    pub(crate) fn new(report: F) -> Self {
        Self { report: Some(report), end: End { bytes: 0, complete: false } }
    }

    /// Tell when this response's body has ended.
    pub(crate) fn wrap(self, response: Response<Body>) -> Response<Body> {
        response.map(|body| Body::new(EndingBody { ending: self, body }))
    }
}

impl<F: FnOnce(End)> Drop for Ending<F> {
    fn drop(&mut self) {
        if let Some(report) = self.report.take() {
            report(self.end);
        }
    }
}

struct EndingBody<F: FnOnce(End)> {
    ending: Ending<F>,
    body: Body,
}

impl<F: FnOnce(End)> Drop for EndingBody<F> {
    fn drop(&mut self) {
        // Nobody asks for the end of a body that says by itself that it has come.
        self.ending.end.complete |= self.body.is_end_stream();
    }
}

impl<F: FnOnce(End) + Unpin> http_body::Body for EndingBody<F> {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = ready!(Pin::new(&mut self.body).poll_frame(cx));
        match &frame {
            Some(Ok(frame)) => self.ending.end.bytes += frame.data_ref().map_or(0, |data| data.len() as u64),
            Some(Err(_)) => {}
            None => self.ending.end.complete = true,
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    #[tokio::test]
    async fn the_end_of_a_response_is_reported_once_and_correctly() {
        let (send, ended) = mpsc::channel();
        let wrap = |body: Body| {
            let send = send.clone();
            Ending::new(move |end| send.send(end).unwrap()).wrap(Response::new(body))
        };
        let whole = wrap(Body::from("12345"));
        axum::body::to_bytes(whole.into_body(), 10).await.unwrap();
        assert_eq!(ended.try_recv(), Ok(End { bytes: 5, complete: true }));
        drop(wrap(Body::from("12345")));
        assert_eq!(ended.try_recv(), Ok(End { bytes: 0, complete: false }));
        drop(wrap(Body::empty()));
        assert_eq!(ended.try_recv(), Ok(End { bytes: 0, complete: true }));
        let again = send.clone();
        drop(Ending::new(move |end| again.send(end).unwrap()));
        assert_eq!(ended.try_recv(), Ok(End { bytes: 0, complete: false }), "no answer at all");
        assert!(ended.try_recv().is_err());
    }
}
