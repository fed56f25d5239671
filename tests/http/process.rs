//! `kilwa serve` over a temporary folder, until it is dropped.

use super::client::Client;
use crate::eventually::{eventually, eventually_async};
use crate::support::serving;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

pub(crate) struct Server {
    child: Child,
    pub(crate) address: SocketAddr,
    dir: tempfile::TempDir,
}

impl Server {
    /// Serve these packs, with these options.
    pub(crate) fn start(packs: &[(&str, &[u8])], options: &[&str]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let (folder, www) = (dir.path().join("models"), dir.path().join("www"));
        std::fs::create_dir(&folder).unwrap();
        serving::page(&www);
        for (name, bytes) in packs {
            std::fs::write(folder.join(format!("{name}.kilwa")), bytes).unwrap();
        }
        let log = std::fs::File::create(dir.path().join("log")).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_kilwa"))
            .arg("serve")
            .arg(&folder)
            .args(["--listen", "127.0.0.1:0", "--www"])
            .arg(&www)
            .args(options)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(log)
            .spawn()
            .unwrap();
        let address = serving::address(&mut child);
        Self { child, address, dir }
    }

    pub(crate) fn folder(&self) -> PathBuf {
        self.dir.path().join("models")
    }

    /// A place for files of the test.
    pub(crate) fn scratch(&self) -> &Path {
        self.dir.path()
    }

    pub(crate) fn log(&self) -> String {
        std::fs::read_to_string(self.dir.path().join("log")).unwrap()
    }

    /// Resident memory, bytes; `None` if the system does not report it.
    pub(crate) fn memory(&self) -> Option<f64> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
        Some(line.split_whitespace().next()?.parse::<f64>().ok()? * 1024.0)
    }

    /// Open file descriptors.
    pub(crate) fn files(&self) -> Option<usize> {
        Some(std::fs::read_dir(format!("/proc/{}/fd", self.child.id())).ok()?.count())
    }

    /// Until the server has closed its side of every connection.
    pub(crate) async fn quiet(&self) {
        let last = eventually_async("no other connection", async || {
            let mut client = Client::connect(self.address).await.unwrap();
            let figures = String::from_utf8(client.get("/metrics", "").await.unwrap().body).unwrap();
            figures.lines().any(|line| line == "kilwa_connections 1").then_some(client)
        })
        .await;
        let Some(before) = self.files() else { return };
        drop(last);
        eventually_async("the last connection is closed", async || self.files().filter(|n| *n < before)).await;
    }

    /// Send SIGTERM, as a service manager does.
    pub(crate) fn terminate(&self) {
        let kill = Command::new("kill").arg("-TERM").arg(self.child.id().to_string()).status().unwrap();
        assert!(kill.success());
    }

    /// How it ended, and how long that took; a minute at most.
    pub(crate) fn ended(&mut self) -> (ExitStatus, Duration) {
        let began = Instant::now();
        let status = eventually("the end of kilwa serve after SIGTERM", || self.child.try_wait().unwrap());
        (status, began.elapsed())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}
