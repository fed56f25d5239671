//! `kilwa verify https://…` against a real TLS server whose certificate the test makes: what the certificate's authority vouches for is read, everything
//! else is refused with the reason. `SSL_CERT_FILE` names an authority that the system does not know.

use crate::support::{built_once, succeeds, text};
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, IsCa, KeyPair, date_time_ymd};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer};
use rustls::{ServerConfig, ServerConnection, StreamOwned};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Arc;

fn pack() -> Vec<u8> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("verify_tls");
    let write = |input: &Path| drop(succeeds(&["synth", "wall", "--triangles", "20000", "-o", text(input), "--force"]));
    std::fs::read(built_once(&folder, "wall", write, &[])).expect("read")
}

/// A certificate and its key.
type Identity = (CertificateDer<'static>, PrivateKeyDer<'static>);

/// An authority, and the file that names it.
struct Authority {
    issuer: CertifiedIssuer<'static, KeyPair>,
    file: PathBuf,
}

impl Authority {
    fn new(folder: &Path) -> Self {
        let mut params = CertificateParams::new(Vec::new()).expect("no names");
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let issuer = CertifiedIssuer::self_signed(params, KeyPair::generate().expect("a key")).expect("signed");
        let file = folder.join("authority.pem");
        std::fs::write(&file, issuer.pem()).expect("written");
        Self { issuer, file }
    }

    /// A certificate for a name, good until the end of a year.
    fn vouches(&self, name: &str, until: i32) -> Identity {
        let mut params = CertificateParams::new(vec![name.to_owned()]).expect("a name");
        params.not_before = date_time_ymd(2020, 1, 1);
        params.not_after = date_time_ymd(until, 12, 31);
        let key = KeyPair::generate().expect("a key");
        let certificate = params.signed_by(&key, &self.issuer).expect("signed");
        (certificate.der().clone(), PrivatePkcs8KeyDer::from(key.serialize_der()).into())
    }
}

/// Serve the pack with ranges as `https://localhost:PORT/wall.kilwa`; `/away.kilwa` leads to the same without encryption. The port.
fn serve(bytes: Vec<u8>, (certificate, key): Identity) -> u16 {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .expect("versions")
        .with_no_client_auth()
        .with_single_cert(vec![certificate], key)
        .expect("they belong together");
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("there").port();
    let (config, bytes) = (Arc::new(config), Arc::new(bytes));
    std::thread::spawn(move || {
        for socket in listener.incoming().flatten() {
            let (config, bytes) = (Arc::clone(&config), Arc::clone(&bytes));
            std::thread::spawn(move || {
                let Ok(connection) = ServerConnection::new(config) else { return };
                // A client that refuses the certificate hangs up.
                let _ = answer(StreamOwned::new(connection, socket), &bytes, port);
            });
        }
    });
    port
}

fn answer(mut stream: StreamOwned<ServerConnection, TcpStream>, bytes: &[u8], port: u16) -> std::io::Result<()> {
    let mut head = Vec::new();
    let mut byte = [0];
    while !head.ends_with(b"\r\n\r\n") {
        stream.read_exact(&mut byte)?;
        head.push(byte[0]);
    }
    let head = String::from_utf8_lossy(&head).to_ascii_lowercase();
    let range = head.lines().find_map(|l| l.strip_prefix("range: bytes=")).and_then(|r| {
        let (from, to) = r.split_once('-')?;
        Some((from.parse::<usize>().ok()?, to.parse::<usize>().ok()?.min(bytes.len() - 1)))
    });
    let (status, more, body) = if head.starts_with("get /away.kilwa") {
        ("302 Found", format!("location: http://localhost:{port}/wall.kilwa\r\n"), &bytes[..0])
    } else if let Some((from, to)) = range {
        let header = format!("content-range: bytes {from}-{to}/{}\r\n", bytes.len());
        ("206 Partial Content", header, &bytes[from..=to])
    } else {
        ("200 OK", String::new(), bytes)
    };
    write!(
        stream,
        "HTTP/1.1 {status}\r\netag: \"1\"\r\n{more}content-length: {}\r\nconnection: close\r\n\r\n",
        body.len()
    )?;
    stream.write_all(body)?;
    stream.conn.send_close_notify();
    stream.flush()
}

fn verify(url: &str, authority: Option<&Path>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
    command.args(["verify", url]).env_remove("SSL_CERT_FILE").env_remove("SSL_CERT_DIR");
    if let Some(file) = authority {
        command.env("SSL_CERT_FILE", file);
    }
    command.output().expect("it runs")
}

fn printed(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

#[test]
fn a_pack_over_https_is_verified_if_its_certificate_authority_is_known_and_damage_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let authority = Authority::new(folder.path());
    let bytes = pack();
    let port = serve(bytes.clone(), authority.vouches("localhost", 2099));
    let good = verify(&format!("https://localhost:{port}/wall.kilwa"), Some(&authority.file));
    assert!(good.status.success(), "{}", printed(&good));
    let mut bad = bytes;
    let middle = bad.len() / 2;
    bad[middle] ^= 4;
    let port = serve(bad, authority.vouches("localhost", 2099));
    let found = verify(&format!("https://localhost:{port}/wall.kilwa"), Some(&authority.file));
    assert_eq!(found.status.code(), Some(1));
    assert!(printed(&found).contains("chunk"), "{}", printed(&found));
}

#[test]
fn a_certificate_that_is_untrusted_expired_or_for_another_name_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let authority = Authority::new(folder.path());
    let other = tempfile::tempdir().expect("a folder");
    let other = Authority::new(other.path());
    let cases = [
        (authority.vouches("localhost", 2099), None, "certificate"),
        (other.vouches("localhost", 2099), Some(&authority.file), "certificate"),
        (authority.vouches("museum.example", 2099), Some(&authority.file), "certificate"),
        (authority.vouches("localhost", 2021), Some(&authority.file), "certificate"),
    ];
    for (number, (identity, file, reason)) in cases.into_iter().enumerate() {
        let port = serve(pack(), identity);
        let refused = verify(&format!("https://localhost:{port}/wall.kilwa"), file.map(PathBuf::as_path));
        assert_eq!(refused.status.code(), Some(1), "case {number}: {}", printed(&refused));
        assert!(!printed(&refused).contains("attempts"), "asking again changes nothing: {}", printed(&refused));
        assert!(printed(&refused).contains(reason), "case {number}: {}", printed(&refused));
    }
}

#[test]
fn redirects_from_https_to_http_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let authority = Authority::new(folder.path());
    let port = serve(pack(), authority.vouches("localhost", 2099));
    let refused = verify(&format!("https://localhost:{port}/away.kilwa"), Some(&authority.file));
    assert_eq!(refused.status.code(), Some(1), "{}", printed(&refused));
}
