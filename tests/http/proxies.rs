//! nginx and Caddy in front of the server, each with the configuration that docs/hosting recommends: responses are those of
//! `kilwa serve`.

use super::client::Client;
use super::process::Server;
use super::{check_none, noise};
use crate::eventually::eventually_async;
use fastrand::Rng;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::process::{Child, Command, Stdio};

const URL: &str = "/packs/fort.kilwa";
const DOCS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/hosting");

/// A program that is ended with the test.
struct Proxy(Child);

impl Drop for Proxy {
    fn drop(&mut self) {
        // nginx ends its workers only when it is asked; killed, it would leave them.
        drop(Command::new("kill").arg("-TERM").arg(self.0.id().to_string()).status());
        drop(self.0.wait());
    }
}

/// Whether a program is installed; else says what is skipped.
fn is_here(program: &str, argument: &str) -> bool {
    let found =
        Command::new(program).arg(argument).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
    if found.is_err() {
        println!("skipped: {program} before the server ({program} is not installed)");
    }
    found.is_ok()
}

fn free_port() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

fn start() -> (Server, Vec<u8>) {
    let bytes = noise(3_000_000, 23);
    (Server::start(&[("fort", &bytes)], &["--behind-proxy", "--access-log"]), bytes)
}

async fn check(name: &str, server: &Server, proxy: SocketAddr, bytes: &[u8]) {
    let mut client = eventually_async(&format!("an answer of {name}"), async || {
        let mut client = Client::connect(proxy).await.ok()?;
        let answer = client.get("/healthz", "").await.ok()?;
        (answer.status == 200).then_some(client)
    })
    .await;
    let packed = "Accept-Encoding: gzip, br\r\n";
    let whole = client.get(URL, packed).await.unwrap();
    assert_eq!((whole.status, whole.header("content-encoding")), (200, ""), "{}", whole.head);
    assert!(whole.body == bytes, "{} bytes: {}", whole.body.len(), whole.head);
    let tag = whole.header("etag").to_owned();
    assert!(tag.starts_with('"') && tag.len() == 66, "the tag stays strong: {tag}");
    let mut wrong = Vec::new();
    let length = bytes.len();
    let rows = [
        ("Range: bytes=1-9\r\n".to_owned(), 206, &bytes[1..10]),
        ("Range: bytes=-9\r\n".to_owned(), 206, &bytes[length - 9..]),
        (format!("Range: bytes={}-\r\n", length - 3), 206, &bytes[length - 3..]),
        (format!("Range: bytes=1-9\r\nIf-Range: {tag}\r\n"), 206, &bytes[1..10]),
        ("Range: bytes=1-9\r\nIf-Range: \"x\"\r\n".to_owned(), 200, bytes),
        (format!("If-None-Match: {tag}\r\n"), 304, &[]),
        ("Range: bytes=1-9\r\nAccept-Encoding: gzip\r\n".to_owned(), 206, &bytes[1..10]),
    ];
    for (lines, status, body) in &rows {
        let a = client.get(URL, lines).await.unwrap();
        if a.status != *status || a.body != *body || a.header("etag") != tag {
            wrong.push(format!("{lines:?}: {}", a.head));
        }
    }
    let beyond = client.get(URL, &format!("Range: bytes={length}-\r\n")).await.unwrap();
    assert_eq!((beyond.status, beyond.header("content-range")), (416, &format!("bytes */{length}")[..]));
    let head = client.ask("HEAD", URL, "").await.unwrap();
    assert_eq!((head.status, head.header("content-length")), (200, &length.to_string()[..]));
    let mut dice = Rng::with_seed(5);
    for _ in 0..200 {
        let from = dice.u64(..length as u64) as usize;
        let to = from + dice.u64(..(length - from).min(70_000) as u64) as usize;
        let a = client.get(URL, &format!("Range: bytes={from}-{to}\r\n")).await.unwrap();
        if a.status != 206 || a.body != bytes[from..=to] {
            wrong.push(format!("{from}-{to}: {}", a.head));
        }
    }
    let several = client.get(&format!("{URL}/2000000-2000999,5-9,70000-170000"), packed).await.unwrap();
    let parts = [&bytes[2_000_000..2_001_000], &bytes[5..10], &bytes[70_000..170_001]].concat();
    if several.status != 200
        || several.body != parts
        || several.header("etag") != tag
        || head.header("kilwa-ranges") != "64"
    {
        wrong.push(format!("several ranges: {}{}", head.head, several.head));
    }
    check_none(&format!("answers through {name} that are not the server's"), rows.len() + 201, &wrong);
    assert!(whole.header("access-control-expose-headers").contains("Content-Range"));
    let page = client.get("/", packed).await.unwrap();
    assert!(page.status == 200 && page.header("content-security-policy").contains("frame-ancestors"));
    assert_eq!(client.get("/metrics", "").await.unwrap().status, 404, "figures are not for everyone");
    // A forged client address is ignored.
    client.get("/models.json", "X-Forwarded-For: 203.0.113.77\r\n").await.unwrap();
    let line = || Some(server.log()).filter(|log| log.contains("/models.json"));
    let log = eventually_async("the line of this request in the log", async || line()).await;
    assert!(log.contains("127.0.0.1") && !log.contains("203.0.113.77"), "{log}");
}

#[tokio::test]
async fn responses_are_unchanged_behind_nginx_as_documented() {
    if !is_here("nginx", "-v") {
        return;
    }
    let (server, bytes) = start();
    let port = free_port();
    let site = std::fs::read_to_string(Path::new(DOCS).join("nginx.conf")).unwrap();
    let site: String = site
        .lines()
        .filter(|line| !line.trim_start().starts_with("ssl_"))
        .map(|line| {
            line.replace("listen 443 ssl", &format!("listen {port}"))
                .replace("127.0.0.1:8080", &server.address.to_string())
                + "\n"
        })
        .collect();
    let dir = server.scratch().join("nginx");
    std::fs::create_dir(&dir).unwrap();
    let temporary: String = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
        .map(|kind| format!("{kind}_temp_path {}/{kind};\n", dir.display()))
        .concat();
    let wrapped = format!("events {{}}\nhttp {{\naccess_log off;\n{temporary}{site}}}\n");
    let file = dir.join("nginx.conf");
    std::fs::write(&file, wrapped).unwrap();
    let directives = format!("daemon off; pid {0}/pid; error_log {0}/error.log;", dir.display());
    let mut nginx = Command::new("nginx");
    nginx.arg("-p").arg(&dir).arg("-e").arg(dir.join("early.log")).arg("-c").arg(&file).args(["-g", &directives]);
    let _proxy = Proxy(nginx.stdin(Stdio::null()).spawn().unwrap());
    check("nginx", &server, port, &bytes).await;
}

#[tokio::test]
async fn responses_are_unchanged_behind_caddy_as_documented() {
    if !is_here("caddy", "version") {
        return;
    }
    let (server, bytes) = start();
    let port = free_port();
    let site = std::fs::read_to_string(Path::new(DOCS).join("Caddyfile")).unwrap();
    let site = site
        .replace("museum.example {", &format!("http://:{} {{\n\tbind 127.0.0.1", port.port()))
        .replace("reverse_proxy 127.0.0.1:8080", &format!("reverse_proxy {}", server.address));
    let dir = server.scratch().join("caddy");
    std::fs::create_dir(&dir).unwrap();
    let file = dir.join("Caddyfile");
    std::fs::write(&file, format!("{{\n\tadmin off\n\tauto_https off\n}}\n{site}")).unwrap();
    let mut caddy = Command::new("caddy");
    caddy.args(["run", "--adapter", "caddyfile", "--config"]).arg(&file);
    caddy.env("HOME", &dir).env("XDG_DATA_HOME", &dir).env("XDG_CONFIG_HOME", &dir);
    let quiet = caddy.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let _proxy = Proxy(quiet.spawn().unwrap());
    check("Caddy", &server, port, &bytes).await;
}
