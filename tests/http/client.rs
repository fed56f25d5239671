//! As much of HTTP/1.1 as these tests need, over a socket that they hold themselves: nothing is corrected on the way.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpSocket, TcpStream};

pub(crate) struct Client {
    pub(crate) stream: TcpStream,
    read: Vec<u8>,
}

#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    /// A header's value, empty if it is missing.
    pub(crate) fn header(&self, name: &str) -> &str {
        let line =
            self.head.lines().filter_map(|line| line.split_once(':')).find(|(n, _)| n.eq_ignore_ascii_case(name));
        line.map(|(_, value)| value.trim()).unwrap_or_default()
    }
}

/// One of this machine's loopback addresses: as many clients as a test wants.
pub(crate) fn loopback(number: usize) -> Ipv4Addr {
    Ipv4Addr::new(127, 1, (number / 250) as u8, (number % 250) as u8 + 1)
}

impl Client {
    pub(crate) async fn connect(to: SocketAddr) -> io::Result<Self> {
        Self::connect_from(Ipv4Addr::LOCALHOST, to, None).await
    }

    /// From one of the loopback addresses, with a receive buffer of so many bytes.
    pub(crate) async fn connect_from(from: Ipv4Addr, to: SocketAddr, buffer: Option<u32>) -> io::Result<Self> {
        let socket = TcpSocket::new_v4()?;
        // Elsewhere than on Linux only 127.0.0.1 is there.
        if cfg!(target_os = "linux") {
            socket.bind((from, 0).into())?;
        }
        if let Some(bytes) = buffer {
            socket.set_recv_buffer_size(bytes)?;
        }
        Ok(Self { stream: socket.connect(to).await?, read: Vec::new() })
    }

    /// GET with further header lines, each with its line end.
    pub(crate) async fn get(&mut self, path: &str, headers: &str) -> io::Result<Answer> {
        self.ask("GET", path, headers).await
    }

    pub(crate) async fn ask(&mut self, method: &str, path: &str, headers: &str) -> io::Result<Answer> {
        self.send(format!("{method} {path} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n").as_bytes(), method == "HEAD")
            .await
    }

    /// Send bytes as they are and read one answer.
    pub(crate) async fn send(&mut self, request: &[u8], is_head: bool) -> io::Result<Answer> {
        self.stream.write_all(request).await?;
        self.answer(is_head).await
    }

    /// Read one answer. An answer without a length ends with the connection.
    pub(crate) async fn answer(&mut self, is_head: bool) -> io::Result<Answer> {
        let end = loop {
            if let Some(at) = self.read.windows(4).position(|w| w == b"\r\n\r\n") {
                break at + 4;
            }
            self.more().await?;
        };
        let head = String::from_utf8_lossy(&self.read[..end]).into_owned();
        self.read.drain(..end);
        let status = head.split(' ').nth(1).and_then(|s| s.parse().ok()).ok_or(io::ErrorKind::InvalidData)?;
        let mut answer = Answer { status, head, body: Vec::new() };
        if is_head || matches!(status, 204 | 304) {
            return Ok(answer);
        }
        if answer.header("transfer-encoding").eq_ignore_ascii_case("chunked") {
            answer.body = self.chunks().await?;
            return Ok(answer);
        }
        let length: usize = answer.header("content-length").parse().map_err(|_| io::ErrorKind::InvalidData)?;
        while self.read.len() < length {
            self.more().await?;
        }
        answer.body = self.read.drain(..length).collect();
        Ok(answer)
    }

    /// A body in chunks (RFC 9112, section 7.1) without trailers.
    async fn chunks(&mut self) -> io::Result<Vec<u8>> {
        let mut body = Vec::new();
        loop {
            let end = loop {
                if let Some(at) = self.read.windows(2).position(|w| w == b"\r\n") {
                    break at;
                }
                self.more().await?;
            };
            let line = String::from_utf8_lossy(&self.read[..end]).into_owned();
            let length = usize::from_str_radix(line.trim(), 16).map_err(|_| io::ErrorKind::InvalidData)?;
            while self.read.len() < end + 2 + length + 2 {
                self.more().await?;
            }
            body.extend_from_slice(&self.read[end + 2..end + 2 + length]);
            self.read.drain(..end + 2 + length + 2);
            if length == 0 {
                return Ok(body);
            }
        }
    }

    async fn more(&mut self) -> io::Result<()> {
        if self.stream.read_buf(&mut self.read).await? == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(())
    }
}
