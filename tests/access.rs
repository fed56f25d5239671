//! `kilwa access`: accounts are created and changed, and the only secret ever shown is a new token, once.

#[cfg(unix)]
use crate::support::make_pipe;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn kilwa(args: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_kilwa"))
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    // A program that reads no input may have ended already.
    child.stdin.take().expect("piped").write_all(input.as_bytes()).ok();
    child.wait_with_output().expect("ends")
}

fn done(args: &[&str], input: &str) -> String {
    let output = kilwa(args, input);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

fn refused(args: &[&str], input: &str) -> String {
    let output = kilwa(args, input);
    assert_eq!(output.status.code(), Some(1), "{args:?}");
    String::from_utf8(output.stderr).expect("UTF-8")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

#[test]
fn users_and_tokens_are_added_listed_and_removed() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("access.json");
    let file = text(&path);
    done(&["access", "init", file], "");
    assert!(done(&["access", "list", file], "").contains("No users yet"));
    let output =
        done(&["access", "user", file, "amina", "--object", "gereza", "--object", "husuni"], "a long sentence\n");
    assert!(output.contains("amina is added") && output.contains("gereza, husuni"), "{output}");
    done(&["access", "user", file, "robot", "--all", "--no-password"], "");
    let token = done(&["access", "token", file, "robot", "--for", "publish", "--days", "30"], "");
    assert!(token.starts_with("kilwa-") && token.trim().len() == 70, "{token}");

    let listed = done(&["access", "list", file], "");
    assert!(listed.contains("amina: sees gereza, husuni") && listed.contains("for publish"), "{listed}");
    let json: serde_json::Value = serde_json::from_str(&done(&["access", "list", file, "--json"], "")).expect("JSON");
    let id = json["users"][1]["tokens"][0]["id"].as_str().expect("a name");
    for shown in [&listed, &json.to_string(), &std::fs::read_to_string(&path).expect("reads")] {
        assert!(!shown.contains(token.trim()) && !shown.contains("long sentence"), "{shown}");
    }
    assert!(!listed.contains("argon2") && !json.to_string().contains("argon2"));

    assert!(done(&["access", "revoke", file, id], "").contains("no longer works"));
    assert!(done(&["access", "remove", file, "amina"], "").contains("removed"));
    assert_eq!(done(&["access", "list", file], "").trim(), "robot: sees everything that is not withdrawn; no password");
}

#[test]
fn an_impossible_change_is_refused_with_the_reason_and_changes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("access.json");
    let file = text(&path);
    assert!(refused(&["access", "list", file], "").contains("access.json"));
    done(&["access", "init", file], "");
    let before = std::fs::read(&path).expect("reads");
    for (args, input, why) in [
        (vec!["access", "init", file], "", "already exists"),
        (vec!["access", "user", file, "amina"], "short\n", "8 characters"),
        (vec!["access", "user", file, "amina"], "", "no password on standard input"),
        (vec!["access", "user", file, "Not A Name", "--no-password"], "", "cannot be a name"),
        (vec!["access", "user", file, "amina", "--no-password", "--object", "../etc"], "", "for example"),
        (vec!["access", "token", file, "nobody"], "", "no users yet"),
        (vec!["access", "revoke", file, "123"], "", "no token 123"),
    ] {
        let message = refused(&args, input);
        assert!(message.contains(why), "{args:?}: {message}");
        assert_eq!(std::fs::read(&path).expect("reads"), before, "{args:?}");
    }
    std::fs::write(&path, "{ half").expect("writes");
    assert!(refused(&["access", "user", file, "amina", "--no-password"], "").contains("kilwa access init"));
}

/// Users, tokens and revocations by `workers` at once; each command that exits 0 must be found in the file afterwards.
#[test]
fn parallel_changes_are_all_kept() {
    const CALLS: usize = 200;
    const WORKERS: usize = 16;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("access.json");
    let file = text(&path);
    done(&["access", "init", file], "");
    done(&["access", "user", file, "robot", "--all", "--no-password"], "");
    let ids = || -> Vec<String> {
        let json: serde_json::Value =
            serde_json::from_str(&done(&["access", "list", file, "--json"], "")).expect("JSON");
        let users = json["users"].as_array().expect("users").iter();
        let tokens = users.flat_map(|u| u["tokens"].as_array().expect("tokens").clone());
        tokens.map(|t| t["id"].as_str().expect("an id").to_owned()).collect()
    };
    for _ in 0..CALLS / 4 {
        done(&["access", "token", file, "robot"], "");
    }
    let (to_revoke, next) = (ids(), std::sync::atomic::AtomicUsize::new(0));
    let tokens = std::sync::Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..WORKERS {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    match i % 4 {
                        _ if i >= CALLS => return,
                        0 => {
                            done(&["access", "revoke", file, &to_revoke[i / 4]], "");
                        }
                        1 => {
                            done(&["access", "user", file, &format!("user-{i}"), "--no-password"], "");
                        }
                        _ => {
                            let token = done(&["access", "token", file, "robot"], "");
                            tokens.lock().expect("whole").push(token.trim().to_owned());
                        }
                    }
                }
            });
        }
    });
    let accounts = kilwa_server::access::Accounts::read(&path).expect("reads");
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("after 1970").as_secs();
    let tokens = tokens.into_inner().expect("whole");
    let lost_tokens = tokens.iter().filter(|t| accounts.of_token(t, now).is_none()).count();
    let left = ids();
    let undone = to_revoke.iter().filter(|id| left.contains(id)).count();
    let lost_users = (0..CALLS).filter(|i| i % 4 == 1 && accounts.user(&format!("user-{i}")).is_none()).count();
    assert_eq!((tokens.len(), lost_tokens, undone, lost_users), (CALLS / 2, 0, 0, 0), "of {CALLS} calls");
    assert_eq!(std::fs::read_dir(folder.path()).expect("lists").count(), 1, "no temporary file is left");
}

#[cfg(unix)]
#[test]
fn a_change_keeps_links_and_permissions() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = tempfile::tempdir().expect("a folder");
    let (path, link) = (folder.path().join("access.json"), folder.path().join("link.json"));
    done(&["access", "init", text(&path)], "");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o640)).expect("sets");
    symlink(&path, &link).expect("links");
    done(&["access", "user", text(&link), "robot", "--no-password"], "");
    assert!(link.is_symlink() && done(&["access", "list", text(&path)], "").contains("robot"));
    assert_eq!(std::fs::metadata(&path).expect("there").permissions().mode() & 0o777, 0o640);
}

#[cfg(unix)]
#[test]
fn a_pipe_in_place_of_the_file_is_refused_without_blocking() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("access.json");
    make_pipe(&path);
    let file = text(&path);
    for args in [
        vec!["access", "list", file],
        vec!["access", "token", file, "robot"],
        vec!["access", "user", file, "robot", "--no-password"],
        vec!["access", "revoke", file, "123"],
        vec!["access", "remove", file, "robot"],
        vec!["access", "sign-out", file, "robot"],
    ] {
        let message = refused(&args, "");
        assert!(message.contains("access.json") && message.contains("pipe"), "{args:?}: {message}");
    }
}

/// Only regular files are read: devices and pipes have no end.
#[cfg(unix)]
#[test]
fn devices_and_pipes_are_refused_as_input() {
    let folder = tempfile::tempdir().expect("a folder");
    let pipe = folder.path().join("pipe");
    make_pipe(&pipe);
    for file in ["/dev/zero", text(&pipe)] {
        let message = refused(&["metadata", "check", file], "");
        assert!(message.contains(file) && message.contains("device"), "{message}");
    }
}
