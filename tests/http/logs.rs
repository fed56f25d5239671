//! The log: a line for each request, with its id, and no secrets.

use super::client::Client;
use super::noise;
use super::process::Server;
use crate::eventually::eventually_async;
use serde_json::Value;

/// The log, when it has a line for each of three requests.
async fn three_lines(server: &Server) -> String {
    let log = async || Some(server.log()).filter(|log| log.lines().count() >= 3);
    eventually_async("three lines in the log", log).await
}

#[tokio::test]
async fn the_access_log_names_requests_and_contains_no_secrets() {
    let server = Server::start(&[("fort", &noise(5000, 1))], &["--access-log", "--log", "json"]);
    let mut client = Client::connect(server.address).await.unwrap();
    let secrets = "Authorization: Bearer hunter2\r\nCookie: session=hunter2\r\nReferer: http://x/?token=hunter2\r\n";
    let range = format!("Range: bytes=0-99\r\n{secrets}");
    let answer = client.get("/packs/fort.kilwa?token=hunter2", &range).await.unwrap();
    assert_eq!(answer.status, 206);
    let id = answer.header("x-request-id").to_owned();
    client.get("/nothing%0a%1b[31mFAKE", "X-Request-Id: <b>bad name</b>\r\n").await.unwrap();
    client.get("/healthz", "X-Request-Id: 0123456789abcdef\r\n").await.unwrap();
    let log = three_lines(&server).await;
    assert!(!log.contains("hunter2"), "{log}");
    let lines: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    let line = lines.iter().find(|line| line["id"] == id.as_str()).unwrap_or_else(|| panic!("{id}: {log}"));
    assert_eq!(line["path"], "/packs/fort.kilwa");
    assert_eq!((line["status"].as_u64(), line["bytes"].as_u64()), (Some(206), Some(100)));
    assert_eq!((line["client"].as_str(), line["method"].as_str()), (Some("127.0.0.1"), Some("GET")));
    assert_eq!(line["cut"], false);
    assert!(line["ms"].as_f64().is_some() && line["timestamp"].as_str().is_some());
    assert!(lines.iter().any(|line| line["path"] == "/nothing%0a%1b[31mFAKE"), "{log}");
    assert!(lines.iter().any(|line| line["id"] == "0123456789abcdef") && !log.contains("bad name"), "{log}");
}

#[tokio::test]
async fn behind_a_proxy_the_client_address_is_the_forwarded_one() {
    let options = ["--access-log", "--log", "json", "--behind-proxy"];
    let server = Server::start(&[("fort", &noise(10, 1))], &options);
    let mut client = Client::connect(server.address).await.unwrap();
    client.get("/healthz", "X-Forwarded-For: 198.51.100.1, 203.0.113.9\r\n").await.unwrap();
    assert_eq!(client.get("/metrics", "X-Forwarded-For: 203.0.113.9\r\n").await.unwrap().status, 404);
    assert_eq!(client.get("/metrics", "").await.unwrap().status, 200);
    let log = three_lines(&server).await;
    assert!(log.contains("\"client\":\"203.0.113.9\"") && !log.contains("198.51.100.1"), "{log}");
}
