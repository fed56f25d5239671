//! Files at an address: http and https, by range where the server knows ranges, through a temporary file where it does not.
//!
//! Bounded everywhere: time to connect, to the first byte and between two bytes; redirects (five, never from https to http); attempts (five, with
//! growing waits; `Retry-After` up to half a minute is kept). What arrives is compared with what was asked for: a file that changes in
//! between is an error, not damage.

use super::place::{Bytes, Place};
use crate::distrust::{is_distrusted, system_certificates};
use crate::secrets::without_user;
use crate::source::FileSource;
use kilwa_pack::Source;
use kilwa_pack::plural::counted;
use std::fmt::Write as _;
use std::io::{self, Read, Seek, Write};
use std::sync::{Mutex, PoisonError};
use std::thread::sleep;
use std::time::Duration;
use ureq::Agent;
use ureq::http::{Response, StatusCode};

/// Minimum number of bytes of one request. They are kept, so that small files need no second request.
const BLOCK: u64 = 1 << 20;
const ATTEMPTS: u32 = 5;
const FIRST_WAIT: Duration = Duration::from_millis(500);
const LONGEST_WAIT: Duration = Duration::from_secs(30);
const REDIRECTS: u32 = 5;

/// A folder at an address.
pub(crate) struct Web {
    agent: Agent,
    /// Ends with `/`.
    base: String,
}

/// Whether a text is an address that can be asked.
pub(crate) fn is_address(text: &str) -> bool {
    let start = text.get(..8).unwrap_or(text).to_ascii_lowercase();
    start.starts_with("http://") || start.starts_with("https://")
}

impl Web {
    /// The folder that an address names, and the rest of the address: the name of a file, or nothing.
    pub(crate) fn split(address: &str) -> (Self, String) {
        // So no message of the library can contain a password. It would not send one anyway.
        let address = without_user(address);
        let plain = address.split(['?', '#']).next().unwrap_or_default();
        let host_end = plain.find("://").map_or(0, |at| at + 3);
        let (base, name) = match plain.get(host_end..).and_then(|path| path.rfind('/')) {
            Some(at) => plain.split_at(host_end + at + 1),
            None => (plain, ""),
        };
        // A last part without an extension is a folder whose slash was left out.
        let (base, name) = if name.contains('.') { (base, name) } else { (plain, "") };
        let base = if base.ends_with('/') { base.to_owned() } else { format!("{base}/") };
        let agent = Agent::config_builder()
            .http_status_as_error(false)
            .https_only(base.to_ascii_lowercase().starts_with("https:"))
            .max_redirects(REDIRECTS)
            .timeout_connect(Some(Duration::from_secs(15)))
            .timeout_recv_response(Some(Duration::from_secs(30)))
            .timeout_per_read(Some(Duration::from_secs(30)))
            .user_agent(concat!("kilwa-verify/", env!("CARGO_PKG_VERSION")))
            .tls_config(system_certificates())
            .build();
        (Self { agent: agent.into(), base }, name.to_owned())
    }

    fn url(&self, path: &str) -> String {
        let mut url = self.base.clone();
        for byte in path.bytes() {
            if byte.is_ascii_alphanumeric() || b"-._~/!$&'()*+,;=@".contains(&byte) {
                url.push(char::from(byte));
            } else {
                let _ = write!(url, "%{byte:02X}");
            }
        }
        url
    }
}

impl Place for Web {
    fn name(&self, path: &str) -> String {
        self.url(path)
    }

    fn open(&self, path: &str) -> io::Result<Option<Bytes>> {
        let (agent, url) = (self.agent.clone(), self.url(path));
        let Some(first) = ask(&agent, &url, 0, BLOCK)? else { return Ok(None) };
        Ok(Some(match first {
            Answer::Part { bytes, total, tag } => {
                Box::new(WebFile { agent, url, length: total, tag, held: Mutex::new((0, bytes)) })
            }
            Answer::Whole(source) => source,
        }))
    }

    fn stamp(&self, _path: &str) -> Option<String> {
        // Only the server can know.
        None
    }

    fn list(&self, _folder: &str) -> io::Result<Option<Vec<(String, u64)>>> {
        Ok(None)
    }

    fn below(&self, folder: &str) -> Box<dyn Place> {
        Box::new(Self { agent: self.agent.clone(), base: format!("{}/", self.url(folder.trim_end_matches('/'))) })
    }
}

/// What came.
enum Answer {
    /// The bytes asked for, the length of the file, its tag.
    Part { bytes: Vec<u8>, total: u64, tag: Option<String> },
    /// The server does not know ranges: all of it, in a temporary file.
    Whole(Bytes),
}

/// What an attempt ended with.
enum Outcome {
    Came(Option<Answer>),
    /// Trying again may help, after so long at least.
    Passing(String, Option<Duration>),
}

/// Ask for `length` bytes from `from` on, or up to the end; `None` where there is no such file.
fn ask(agent: &Agent, url: &str, from: u64, length: u64) -> io::Result<Option<Answer>> {
    let mut wait = FIRST_WAIT;
    let mut attempt = 1;
    loop {
        let (why, at_least) = match attempt_once(agent, url, from, length)? {
            Outcome::Came(answer) => return Ok(answer),
            Outcome::Passing(why, at_least) => (why, at_least),
        };
        if attempt == ATTEMPTS {
            return Err(io::Error::other(format!("{why} ({ATTEMPTS} attempts)")));
        }
        sleep(wait.max(at_least.unwrap_or_default()).min(LONGEST_WAIT));
        (attempt, wait) = (attempt + 1, wait * 2);
    }
}

fn attempt_once(agent: &Agent, url: &str, from: u64, length: u64) -> io::Result<Outcome> {
    let last = from.saturating_add(length).saturating_sub(1);
    let request = agent.get(url).header("Range", format!("bytes={from}-{last}")).header("Accept-Encoding", "identity");
    let mut response = match request.call() {
        Ok(response) => response,
        Err(
            e @ (ureq::Error::TooManyRedirects
            | ureq::Error::RedirectFailed
            | ureq::Error::BadUri(_)
            | ureq::Error::RequireHttpsOnly(_)
            | ureq::Error::Tls(_)),
        ) => return Err(io::Error::other(e.to_string())),
        Err(e) if is_distrusted(&e) => {
            let hint = "the server's certificate does not match its address, or its certificate authority is unknown here; SSL_CERT_FILE can name a file with further authorities";
            return Err(io::Error::other(format!("{e}: {hint}")));
        }
        Err(e) => return Ok(Outcome::Passing(e.to_string(), None)),
    };
    let status = response.status();
    match status.as_u16() {
        206 => take_part(&mut response, from, last),
        200 => take_whole(response),
        404 | 410 => Ok(Outcome::Came(None)),
        416 if header(&response, "content-range") == Some("bytes */0".to_owned()) => {
            Ok(Outcome::Came(Some(Answer::Whole(Box::new(kilwa_pack::SliceSource(Vec::new()))))))
        }
        408 | 425 | 429 | 500..=599 => {
            let after = header(&response, "retry-after").and_then(|s| s.parse().ok()).map(Duration::from_secs);
            Ok(Outcome::Passing(refusal(status), after))
        }
        _ => Err(io::Error::other(refusal(status))),
    }
}

fn refusal(status: StatusCode) -> String {
    format!("the server answered {status}")
}

fn header<T>(response: &Response<T>, name: &str) -> Option<String> {
    response.headers().get(name)?.to_str().ok().map(str::to_owned)
}

fn take_part(response: &mut Response<ureq::Body>, from: u64, last: u64) -> io::Result<Outcome> {
    let wrong = || io::Error::other("the server sent another part of the file than the one requested");
    let range = header(response, "content-range").ok_or_else(wrong)?;
    let (part, total) = range.strip_prefix("bytes ").and_then(|r| r.split_once('/')).ok_or_else(wrong)?;
    let (begin, end) = part.split_once('-').ok_or_else(wrong)?;
    let number = |text: &str| text.trim().parse::<u64>().map_err(|_| wrong());
    let (begin, end, total) = (number(begin)?, number(end)?, number(total)?);
    if total == 0 || begin != from || end != last.min(total - 1) {
        return Err(wrong());
    }
    let count = end - begin + 1;
    let mut bytes = Vec::new();
    match response.body_mut().as_reader().take(count).read_to_end(&mut bytes) {
        Ok(_) if bytes.len() as u64 == count => {}
        Ok(n) => return Ok(Outcome::Passing(format!("only {n} of {} arrived", counted(count, "byte", "bytes")), None)),
        Err(e) => return Ok(Outcome::Passing(e.to_string(), None)),
    }
    Ok(Outcome::Came(Some(Answer::Part { bytes, total, tag: header(response, "etag") })))
}

fn take_whole(mut response: Response<ureq::Body>) -> io::Result<Outcome> {
    let announced: Option<u64> = header(&response, "content-length").and_then(|l| l.parse().ok());
    // A nameless file, so that nothing is left however the program ends.
    let mut file = tempfile::tempfile()?;
    let mut body = response.body_mut().as_reader();
    let mut buffer = vec![0; 1 << 18];
    let mut came = 0;
    loop {
        match body.read(&mut buffer) {
            Ok(0) => break,
            Ok(n) => {
                file.write_all(buffer.get(..n).unwrap_or_default()).map_err(|e| {
                    let why = "the server does not send parts of files, so this one is kept in the temporary folder while it is checked";
                    io::Error::new(e.kind(), format!("{why}: {e}"))
                })?;
                came += n as u64;
            }
            Err(e) => return Ok(Outcome::Passing(e.to_string(), None)),
        }
    }
    if announced.is_some_and(|announced| announced != came) {
        return Ok(Outcome::Passing(
            format!("only {came} of {} arrived", counted(announced.unwrap_or(0), "byte", "bytes")),
            None,
        ));
    }
    file.rewind()?;
    Ok(Outcome::Came(Some(Answer::Whole(Box::new(FileSource::of(file))))))
}

/// A file on a server that knows ranges.
struct WebFile {
    agent: Agent,
    url: String,
    length: u64,
    tag: Option<String>,
    /// The last block: where it begins, and its bytes.
    held: Mutex<(u64, Vec<u8>)>,
}

impl Source for WebFile {
    fn len(&self) -> io::Result<u64> {
        Ok(self.length)
    }

    fn read_at(&self, offset: u64, length: usize) -> io::Result<Vec<u8>> {
        let end = offset.checked_add(length as u64).filter(|end| *end <= self.length);
        let end = end.ok_or_else(|| io::Error::from(io::ErrorKind::UnexpectedEof))?;
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        // What is held of it, from its first byte on.
        let at = offset.checked_sub(held.0).and_then(|at| usize::try_from(at).ok());
        let mut wanted = at.and_then(|at| held.1.get(at..)).unwrap_or_default().to_vec();
        wanted.truncate(length);
        let from = offset + wanted.len() as u64;
        if from == end {
            return Ok(wanted);
        }
        let count = (end - from).max(BLOCK).min(self.length - from);
        let changed = || io::Error::other("the file changed on the server while it was read; check it again");
        match ask(&self.agent, &self.url, from, count)? {
            Some(Answer::Part { bytes, total, tag }) => {
                if total != self.length || tag != self.tag {
                    return Err(changed());
                }
                let missing = length - wanted.len();
                wanted.extend(bytes.get(..missing).ok_or(io::ErrorKind::UnexpectedEof)?);
                if count <= BLOCK {
                    *held = (from, bytes);
                }
                Ok(wanted)
            }
            _ => Err(changed()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::BufRead;
    use std::net::TcpListener;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Answers requests of parts of `body`; the address, and how many bytes were sent.
    fn server(body: Vec<u8>) -> (String, Arc<AtomicUsize>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}/a.bin", listener.local_addr().unwrap());
        let sent = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&sent);
        std::thread::spawn(move || {
            for mut stream in listener.incoming().flatten() {
                let lines = io::BufReader::new(&stream).lines().map_while(Result::ok).take_while(|l| !l.is_empty());
                let range =
                    lines.filter_map(|l| l.to_ascii_lowercase().strip_prefix("range: bytes=").map(str::to_owned));
                let range = range.last().unwrap();
                let (from, last) = range.split_once('-').unwrap();
                let (from, last) = (from.parse::<usize>().unwrap(), last.parse::<usize>().unwrap());
                let part = &body[from..body.len().min(last + 1)];
                counter.fetch_add(part.len(), Ordering::SeqCst);
                let head = format!(
                    "HTTP/1.1 206 Partial Content\r\nConnection: close\r\nContent-Length: {}\r\nContent-Range: bytes {from}-{}/{}\r\n\r\n",
                    part.len(),
                    from + part.len() - 1,
                    body.len()
                );
                stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(part)).unwrap();
            }
        });
        (address, sent)
    }

    #[test]
    fn no_byte_is_requested_twice_when_a_file_is_read_from_first_to_last() {
        let body: Vec<u8> = (0..5_000_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let (address, sent) = server(body.clone());
        let (web, name) = Web::split(&address);
        for piece in [4 << 20, 1 << 20, 700_001, 5_000_000] {
            let before = sent.load(Ordering::SeqCst);
            let file = web.open(&name).unwrap().unwrap();
            let mut read = Vec::new();
            while read.len() < body.len() {
                let count = piece.min(body.len() - read.len());
                read.extend(file.read_at(read.len() as u64, count).unwrap());
            }
            assert!(read == body, "pieces of {piece}");
            assert_eq!(sent.load(Ordering::SeqCst) - before, body.len(), "pieces of {piece}");
            assert_eq!(file.read_at(12, 7).unwrap(), body[12..19]);
            assert!(file.read_at(5_000_000, 1).is_err() && file.read_at(5_000_000, 0).unwrap().is_empty());
        }
    }

    #[test]
    fn an_address_is_divided_into_folder_and_file() {
        for (address, base, name) in [
            ("https://a.example/", "https://a.example/", ""),
            ("https://a.example", "https://a.example/", ""),
            ("http://a.example/x", "http://a.example/x/", ""),
            ("http://a.example/x/manifest.json?v=1#p", "http://a.example/x/", "manifest.json"),
            ("http://a.example/x.kilwa", "http://a.example/", "x.kilwa"),
            ("http://me:secret@a.example/x.kilwa", "http://a.example/", "x.kilwa"),
        ] {
            let (web, file) = Web::split(address);
            assert_eq!((web.base.as_str(), file.as_str()), (base, name), "{address}");
        }
        let (web, _) = Web::split("http://a/b/");
        assert_eq!(web.url("v1/plan 1:100.png"), "http://a/b/v1/plan%201%3A100.png");
        assert!(is_address("HTTPS://x") && !is_address("ftp://x") && !is_address("http"));
    }
}
