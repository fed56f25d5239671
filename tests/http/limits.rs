//! Limits of requests and clients, and what happens beyond them.

use super::client::{Client, loopback};
use super::noise;
use super::process::Server;
use crate::eventually::eventually_async;

#[tokio::test]
async fn excessive_requests_are_refused_with_the_right_status() {
    let server = Server::start(&[("fort", &noise(1000, 1))], &[]);
    let many = "X-A: a\r\n".repeat(200);
    for (request, wanted) in [
        (format!("GET / HTTP/1.1\r\nHost: x\r\nX: {}\r\n\r\n", "a".repeat(20_000)), &[431][..]),
        (format!("GET / HTTP/1.1\r\nHost: x\r\n{many}\r\n"), &[431]),
        (format!("GET /{} HTTP/1.1\r\nHost: x\r\n\r\n", "a".repeat(70_000)), &[414, 431]),
        ("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 70000\r\n\r\n".to_owned(), &[413]),
        ("POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 18446744073709551616\r\n\r\n".to_owned(), &[400]),
        ("POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n".to_owned(), &[413]),
        (
            "GET / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\nContent-Length: 3\r\n\r\n".to_owned(),
            &[400, 413],
        ),
        ("GET / HTTP/1.1\r\n\r\n".to_owned(), &[400]),
        ("GET / HTTP/1.1\r\nHost: x\r\nHost: y\r\n\r\n".to_owned(), &[400]),
        ("GET / HTTP/1.1\r\nHost: x\r\nA b: c\r\n\r\n".to_owned(), &[400]),
        ("nonsense\r\n\r\n".to_owned(), &[400]),
        ("\u{16}\u{3}\u{1}\0\u{5}\u{1}\0\r\n\r\n".to_owned(), &[400]),
    ] {
        let mut client = Client::connect(server.address).await.unwrap();
        let answer = client.send(request.as_bytes(), false).await;
        let excerpt: String = request.chars().take(60).collect();
        let answer = answer.unwrap_or_else(|e| panic!("{excerpt:?}: {e}"));
        assert!(wanted.contains(&answer.status), "{excerpt:?}: {}", answer.head);
    }
    assert_eq!(Client::connect(server.address).await.unwrap().get("/healthz", "").await.unwrap().status, 200);
}

#[tokio::test]
async fn each_address_has_its_own_share() {
    if !cfg!(target_os = "linux") {
        println!("skipped: clients from several addresses, which only Linux gives without setting up");
        return;
    }
    let server = Server::start(&[("fort", &noise(1000, 1))], &["--connections-per-address", "5"]);
    let mut held = Vec::new();
    for _ in 0..5 {
        let mut client = Client::connect_from(loopback(1), server.address, None).await.unwrap();
        assert_eq!(client.get("/healthz", "").await.unwrap().status, 200);
        held.push(client);
    }
    let mut sixth = Client::connect_from(loopback(1), server.address, None).await.unwrap();
    let refused = sixth.answer(false).await.unwrap();
    assert_eq!((refused.status, refused.header("retry-after")), (503, "2"));
    let mut other = Client::connect_from(loopback(2), server.address, None).await.unwrap();
    assert_eq!(other.get("/healthz", "").await.unwrap().status, 200);
    drop(held);
    eventually_async("its share is given back", async || {
        let mut again = Client::connect_from(loopback(1), server.address, None).await.unwrap();
        again.get("/healthz", "").await.is_ok_and(|a| a.status == 200).then_some(())
    })
    .await;
}

#[tokio::test]
async fn idle_connections_are_closed_for_active_ones() {
    let server = Server::start(&[("fort", &noise(1000, 1))], &["--connections", "10"]);
    let mut idle = Vec::new();
    for _ in 0..10 {
        let mut client = Client::connect(server.address).await.unwrap();
        assert_eq!(client.get("/healthz", "").await.unwrap().status, 200);
        idle.push(client);
    }
    // Without making room these would wait for the ten to be closed as idle, after ten seconds each.
    for _ in 0..20 {
        let mut client = Client::connect(server.address).await.unwrap();
        assert_eq!(client.get("/healthz", "").await.unwrap().status, 200);
    }
    let closed = futures_closed(&mut idle).await;
    assert!(closed >= 1, "the one that waited longest was closed");
}

/// How many of these connections the server has closed.
async fn futures_closed(clients: &mut [Client]) -> usize {
    let mut closed = 0;
    for client in clients {
        closed += usize::from(client.get("/healthz", "").await.is_err());
    }
    closed
}
