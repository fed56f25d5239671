//! No command prints or stores the password of an address.

use crate::support::{kilwa, text};
use std::io::{Read, Write};
use std::net::TcpListener;

const SECRET: &str = "s3cret-word";

/// Start a server that answers every request with 404. Returns its port.
fn nothing_there() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        for mut socket in listener.incoming().flatten() {
            let (mut head, mut byte) = (Vec::new(), [0]);
            while !head.ends_with(b"\r\n\r\n") && socket.read_exact(&mut byte).is_ok() {
                head.push(byte[0]);
            }
            let _ = socket.write_all(b"HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\nconnection: close\r\n\r\n");
        }
    });
    port
}

/// The output of a command, which must not contain the password.
fn printed(args: &[&str]) -> String {
    let output = kilwa(args);
    let both = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(!output.status.success(), "{args:?}: {both}");
    assert!(!both.contains(SECRET), "{args:?}: {both}");
    both
}

#[test]
fn no_command_prints_the_password_of_an_address() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.ply");
    let port = nothing_there();
    let pack = format!("http://me:{SECRET}@127.0.0.1:{port}/x.kilwa");
    let site = format!("http://me:{SECRET}@127.0.0.1:{port}/models/");
    // An unknown scheme, and a password whose slash ends the authority too early.
    let (odd, slash) = (format!("ftp://me:{SECRET}@127.0.0.1/x.kilwa"), format!("http://me:a/{SECRET}@127.0.0.1:1/"));
    for address in [&pack, &site, &odd] {
        for args in [&["verify", address][..], &["verify", address, "--json"]] {
            assert!(printed(args).contains("://me:***@127.0.0.1"), "{args:?}");
        }
    }
    for address in [&pack, &odd, &slash] {
        for args in [
            &["info", address][..],
            &["extract", address, "-o", text(&out)],
            &["measure", address, "area"],
            &["render", address, "-o", text(&out)],
            &["metadata", "check", address],
            &["metadata", "init", address],
            &["build", address, "-o", text(&out)],
            &["publish", "a.kilwa", "--metadata", "a.toml", "--to", address],
            &["serve", address],
            // Messages of the argument parser itself.
            &["verify", address, address],
            &["serve", "--threads", address],
        ] {
            printed(args);
        }
    }
}

#[test]
fn the_state_of_verify_has_no_password() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let address = format!("http://me:{SECRET}@127.0.0.1:{}/x.kilwa", nothing_there());
    let kept = || std::fs::read_to_string(&state).unwrap();
    printed(&["verify", &address, "--state", text(&state)]);
    assert!(!kept().contains(SECRET) && kept().contains("me:***@"), "{}", kept());
    // An earlier version stored it: the target is recognised, and the run removes the password.
    std::fs::write(&state, format!("{{\"kilwa-verify\":\"run\",\"target\":\"{address}\",\"at\":1}}\n")).unwrap();
    let output = printed(&["verify", &address, "--state", text(&state)]);
    assert!(!output.contains("belongs to"), "{output}");
    assert!(!kept().contains(SECRET), "{}", kept());
    // A state of another target is refused without naming its password.
    std::fs::write(&state, format!("{{\"kilwa-verify\":\"run\",\"target\":\"{address}\",\"at\":1}}\n")).unwrap();
    let output = printed(&["verify", "http://127.0.0.1:1/x.kilwa", "--state", text(&state)]);
    assert!(output.contains("belongs to http://me:***@"), "{output}");
}
