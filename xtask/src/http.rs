//! The one thing that the demo's check needs of HTTP/1.1: a GET of a local address, whole or a range, with a time limit.
//!
//! Failures: no connection, no answer in time, an answer that is not HTTP, or one longer than the caller allows.

use anyhow::{Context, Result, bail};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// Longest silence of the server that is still taken for work.
const PATIENCE: Duration = Duration::from_secs(20);

/// An answer: status code and body.
#[derive(Debug)]
pub(crate) struct Answer {
    /// For example 200, or 206 to a range.
    pub(crate) status: u16,
    /// As sent; the request asks for no compression.
    pub(crate) body: Vec<u8>,
}

/// Fetches `path` from `address`; `range` is first and last byte, both included.
///
/// # Errors
/// See the module; the message names the address and the path.
pub(crate) fn get(address: SocketAddr, path: &str, range: Option<(u64, u64)>, limit: u64) -> Result<Answer> {
    fetch(address, path, range, limit).with_context(|| format!("GET http://{address}{path}"))
}

fn fetch(address: SocketAddr, path: &str, range: Option<(u64, u64)>, limit: u64) -> Result<Answer> {
    let mut stream = TcpStream::connect_timeout(&address, PATIENCE)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    let range = range.map_or_else(String::new, |(first, last)| format!("Range: bytes={first}-{last}\r\n"));
    // HTTP/1.0 keeps the body free of chunked framing.
    write!(stream, "GET {path} HTTP/1.0\r\nHost: {address}\r\n{range}Connection: close\r\n\r\n")?;
    let mut bytes = Vec::new();
    stream.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        bail!("the answer is longer than {limit} bytes");
    }
    parse(&bytes)
}

fn parse(bytes: &[u8]) -> Result<Answer> {
    let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").context("the answer has no end of its header")?;
    let (header, body) = (String::from_utf8_lossy(&bytes[..end]).into_owned(), bytes[end + 4..].to_vec());
    let status = header
        .strip_prefix("HTTP/1.")
        .and_then(|rest| rest.split(' ').nth(1))
        .and_then(|code| code.parse().ok())
        .with_context(|| {
            format!("the answer does not start like HTTP: {:?}", header.lines().next().unwrap_or_default())
        })?;
    Ok(Answer { status, body })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_and_body_are_separated() {
        let answer = parse(b"HTTP/1.0 206 Partial Content\r\nA: b\r\n\r\nx\r\n\r\ny").unwrap();
        assert_eq!((answer.status, answer.body.as_slice()), (206, &b"x\r\n\r\ny"[..]));
    }

    #[test]
    fn a_response_that_is_not_http_is_reported_as_such() {
        assert!(parse(b"SSH-2.0-OpenSSH\r\n\r\n").unwrap_err().to_string().contains("SSH-2.0"));
        assert!(parse(b"HTTP/1.0 200 OK\r\n").is_err());
    }
}
