//! Clients of HTTP/2 that take nothing, by hand, for no library is so rude; those that only wait are not
//! taken for such.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::json;

use super::client::{Server, sha256};
use super::hostile::open_connections;
use super::{job, small};

const DATA: u8 = 0;
const HEADERS: u8 = 1;
const SETTINGS: u8 = 4;
const PING: u8 = 6;
const ACK: u8 = 1;

/// A frame of RFC 9113, §4.1.
fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let length = (payload.len() as u32).to_be_bytes();
    let head = [&length[1..], &[kind, flags], &stream.to_be_bytes()].concat();
    [&head, payload].concat()
}

/// A connection that lets each answer have so many bytes before it takes any.
fn begin(server: &Server, window: u32) -> TcpStream {
    let mut stream = server.connect();
    let settings = [&[0, 4][..], &window.to_be_bytes()].concat();
    let start = [b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", &frame(SETTINGS, 0, 0, &settings)[..]];
    stream.write_all(&start.concat()).expect("sent");
    stream
}

/// Asks for a path: GET and http by the static table of RFC 7541, the rest in plain text.
fn ask(stream: &mut TcpStream, path: &str) {
    let text = |text: &str| [&[text.len() as u8], text.as_bytes()].concat();
    let head = [&[0x82, 0x86, 0x04][..], &text(path), &[0x01], &text("localhost")].concat();
    stream.write_all(&frame(HEADERS, 5, 1, &head)).expect("sent");
}

/// Listens for so long, answers what keeps a connection alive, and takes nothing: whether the service
/// has closed the connection, and the bytes of bodies that came.
fn listen(stream: &mut TcpStream, patience: Duration) -> (bool, usize) {
    let (start, mut data) = (Instant::now(), 0);
    let mut bytes = Vec::new();
    let mut buffer = [0; 1 << 16];
    stream.set_read_timeout(Some(Duration::from_millis(100))).expect("set");
    while start.elapsed() < patience {
        match stream.read(&mut buffer) {
            Ok(0) => return (true, data),
            Ok(count) => bytes.extend_from_slice(&buffer[..count]),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return (true, data),
        }
        while bytes.len() >= 9 {
            let length = u32::from_be_bytes([0, bytes[0], bytes[1], bytes[2]]) as usize;
            if bytes.len() < 9 + length {
                break;
            }
            let (kind, flags) = (bytes[3], bytes[4]);
            data += if kind == DATA { length } else { 0 };
            if [SETTINGS, PING].contains(&kind) && flags & ACK == 0 {
                let echo = if kind == PING { &bytes[9..9 + length] } else { &[] };
                let _ = stream.write_all(&frame(kind, ACK, 0, echo));
            }
            bytes.drain(..9 + length);
        }
    }
    (false, data)
}

/// Who leaves no room for an answer, takes only the start of it, or asks for nothing at all, is let go
/// however alive the connection is; who waits for events that do not come is not.
#[test]
fn clients_of_http2_that_take_nothing_are_let_go() {
    let server = Server::start(&["--idle-timeout", "1"]);
    let large: Vec<u8> = (0..1_u32 << 20).map(|i| (i >> 8) as u8).collect();
    let asset = format!("/v1/assets/{}", sha256(&large));
    assert_eq!(server.put(&asset, &large, &[]).status, 201);
    let mut recipe = small();
    recipe["bake"]["rays"] = json!(50_000);
    let accepted = server.post("/v1/jobs", &job(&server, &recipe), &[]);
    let events = format!("{}/events", accepted.header("location").expect("a place"));
    let patience = Duration::from_secs(40);
    std::thread::scope(|scope| {
        let rude = |window: u32, path: &'static str| {
            let mut stream = begin(&server, window);
            if !path.is_empty() {
                ask(&mut stream, path);
            }
            scope.spawn(move || listen(&mut stream, patience))
        };
        let (closed, nothing, idle) = (rude(0, "/docs"), rude(100, "/docs"), rude(65_535, ""));
        let mut half = begin(&server, 65_535);
        ask(&mut half, &asset);
        let half = scope.spawn(move || listen(&mut half, patience));
        let mut waits = begin(&server, 65_535);
        ask(&mut waits, &events);
        let (gone, told) = listen(&mut waits, Duration::from_secs(5));
        assert!(!gone && told > 0, "who listens is let go");
        assert_eq!(closed.join().expect("an end"), (true, 0), "no room: it may stay for ever");
        assert_eq!(nothing.join().expect("an end"), (true, 100), "it may stay for ever");
        assert_eq!(half.join().expect("an end"), (true, 65_535), "half: it may stay for ever");
        assert_eq!(idle.join().expect("an end"), (true, 0), "it may ask for nothing for ever");
    });
    let start = Instant::now();
    while open_connections(&server) > 1 {
        assert!(start.elapsed() < patience, "connections stay");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// No more connections are served at once than are allowed; who comes then is served as soon as one
/// ends.
#[test]
fn connections_are_counted() {
    let server = Server::start(&["--max-connections", "3", "--head-timeout", "60"]);
    let held: Vec<TcpStream> = (0..3).map(|_| server.connect()).collect();
    let mut waits = server.connect();
    let head = b"GET /health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    waits.write_all(head).expect("sent");
    waits.set_read_timeout(Some(Duration::from_secs(2))).expect("set");
    let mut answer = Vec::new();
    let early = waits.read_to_end(&mut answer);
    assert!(early.is_err() && answer.is_empty(), "a fourth is served beside three");
    drop(held);
    waits.set_read_timeout(Some(Duration::from_secs(30))).expect("set");
    waits.read_to_end(&mut answer).expect("an answer");
    assert!(answer.starts_with(b"HTTP/1.1 200"), "it is never served");
}

/// A job that tells nothing for longer than the limit is called stalled, in its log, its progress and
/// its events, and is left to go on.
#[test]
fn a_stalled_job_says_so() {
    let server = Server::start(&["--stalled", "1"]);
    let mut recipe = small();
    recipe["bake"]["rays"] = json!(1_000_000);
    let accepted = server.post("/v1/jobs", &job(&server, &recipe), &[]);
    assert_eq!(accepted.status, 202, "{}", accepted.text());
    let place = accepted.header("location").expect("a place");
    server.wait(&format!("{place}/log"), |log| log.to_string().contains("nothing was heard of it"));
    let mut listener =
        super::hostile::begin(&server, &format!("GET {place}/events HTTP/1.1"), 0, b"");
    let mut heard = Vec::new();
    let mut buffer = [0; 4096];
    while !String::from_utf8_lossy(&heard).contains("event: stalled") {
        let count = listener.read(&mut buffer).expect("events");
        assert!(count > 0, "the stream ends: {}", String::from_utf8_lossy(&heard));
        heard.extend_from_slice(&buffer[..count]);
    }
    assert_eq!(server.get(&place, &[]).json()["state"], "running");
}
