//! Messages to those who asked to be told of a job's end, over plain HTTP and over TLS with a
//! certificate authority of our own making.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit, Mac};
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use rustls::pki_types::{PrivateKeyDer, PrivatePkcs8KeyDer};
use rustls::{ServerConfig, ServerConnection, StreamOwned};
use serde_json::{Value, json};
use sha2::Sha256;

use super::client::{Answer, Server};
use super::{job, small};

/// In base64, without its prefix.
const SECRET: &str = "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

/// A file with the secret.
fn secret(folder: &Path) -> String {
    let file = folder.join("secret");
    fs::write(&file, format!("whsec_{SECRET}")).expect("written");
    file.to_str().expect("text").to_owned()
}

fn submit(server: &Server, url: &str) -> Answer {
    let mut request = job(server, &small());
    request["webhook"] = json!({ "url": url });
    server.post("/v1/jobs", &request, &[])
}

/// A job that ends at once, by being cancelled; its place.
fn ended(server: &Server, url: &str) -> String {
    let accepted = submit(server, url);
    assert_eq!(accepted.status, 202, "{}", accepted.text());
    let place = accepted.header("location").expect("a place");
    assert_eq!(server.post(&format!("{place}/cancel"), &json!({}), &[]).status, 202);
    place
}

fn log(server: &Server, place: &str) -> String {
    server.get(&format!("{place}/log"), &[]).text()
}

/// Reads one message to its end and answers it; nothing where the connection ends before.
fn take(stream: &mut (impl Read + Write), status: &str) -> Option<String> {
    let mut message = Vec::new();
    let mut buffer = [0; 4096];
    while !String::from_utf8_lossy(&message).contains("\"timestamp_ms\":") {
        let count = stream.read(&mut buffer).ok().filter(|&count| count > 0)?;
        message.extend_from_slice(&buffer[..count]);
    }
    stream.write_all(format!("HTTP/1.1 {status}\r\n\r\n").as_bytes()).ok()?;
    stream.flush().ok()?;
    Some(String::from_utf8_lossy(&message).into_owned())
}

/// The message as its headers and its body say it, signed as Standard Webhooks 1.0 has it.
fn check(message: &str, state: &str) -> String {
    assert!(message.starts_with("POST /hook?a=b HTTP/1.1\r\n"), "{message}");
    let (head, body) = message.split_once("\r\n\r\n").expect("a body");
    let header = |name: &str| {
        let line = head.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": "));
        line.expect(name).to_owned()
    };
    let told: Value = serde_json::from_str(body).expect("JSON");
    assert_eq!(told["type"], format!("job.{state}"), "{message}");
    let id = header("webhook-id");
    let key = STANDARD.decode(SECRET).expect("base64");
    let mut mac = Hmac::<Sha256>::new_from_slice(&key).expect("a key");
    mac.update(format!("{id}.{}.{body}", header("webhook-timestamp")).as_bytes());
    let expected = format!("v1,{}", STANDARD.encode(mac.finalize().into_bytes()));
    assert_eq!(header("webhook-signature"), expected);
    id
}

/// Someone who takes the messages that webhooks are sent; the first is refused.
fn receiver() -> (String, JoinHandle<Vec<String>>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("bound");
    let url = format!("http://{}/hook?a=b", listener.local_addr().expect("an address"));
    let taken = std::thread::spawn(move || {
        let answers = ["500 No", "204 Yes"].into_iter();
        let message = |status| take(&mut listener.accept().expect("accepted").0, status);
        answers.filter_map(message).collect()
    });
    (url, taken)
}

/// Who asked is told of a job's end, signed, again after a refusal and under the same id; without a
/// secret, or at a private address that is not allowed, the job is refused.
#[test]
fn webhooks_are_told() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let secret = secret(folder.path());
    let (url, taken) = receiver();
    let server = Server::start(&[]);
    assert_eq!(submit(&server, &url).json()["errors"][0]["pointer"], "#/webhook/url");
    let server = Server::start(&["--webhook-secret", &secret]);
    assert_eq!(submit(&server, &url).status, 422, "a private address is told");
    assert_eq!(submit(&server, "https://10.0.0.1/").status, 422, "TLS makes it no more public");
    assert_eq!(submit(&server, "ftp://a.example/").status, 422);
    let server = Server::start(&["--webhook-secret", &secret, "--webhook-private"]);
    let place = ended(&server, &url);
    let messages = taken.join().expect("a receiver");
    assert_eq!(messages.len(), 2);
    assert_eq!(check(&messages[0], "cancelled"), check(&messages[1], "cancelled"));
    let log = log(&server, &place);
    assert!(log.contains("the answer was 500; again in 5 s"), "{log}");
}

/// One receiver that takes a message and says nothing does not hold up another.
#[test]
fn a_silent_receiver_delays_nobody() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let server = Server::start(&["--webhook-secret", &secret(folder.path()), "--webhook-private"]);
    let silent = TcpListener::bind("127.0.0.1:0").expect("bound");
    let deaf = format!("http://{}/hook", silent.local_addr().expect("an address"));
    (0..9).for_each(|_| drop(ended(&server, &deaf)));
    let held = silent.accept().expect("accepted");
    let (url, taken) = receiver();
    let start = Instant::now();
    ended(&server, &url);
    assert_eq!(taken.join().expect("a receiver").len(), 2);
    // Each of the nine before it is given up after twenty seconds.
    assert!(start.elapsed() < Duration::from_secs(60), "it waited for the silent one");
    drop(held);
}

/// Whom a job tells is shown to who may submit jobs, and not to who may only look.
#[test]
fn readers_do_not_see_webhooks() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let secret = secret(folder.path());
    let mut server = Server::start(&["--webhook-secret", &secret, "--webhook-private"]);
    let token = |name: &str, scopes: &[&str]| {
        let words = ["token", "--data", "data", "create", name];
        let output = server.command(&[&words[..], scopes].concat());
        format!("Bearer {}", String::from_utf8(output.stdout).expect("text").trim())
    };
    let (reader, both) = (token("viewer", &["--scope", "read"]), token("maya", &[]));
    server.terminate();
    server.restart();
    let mut request = job(&server, &small());
    request["webhook"] = json!({ "url": "http://127.0.0.1:9/hook?key=hidden" });
    let own = [("Authorization", both.as_str())];
    let accepted = server.post("/v1/jobs", &request, &own);
    assert!(accepted.text().contains("hidden"), "{}", accepted.text());
    let place = accepted.header("location").expect("a place");
    for path in [place.as_str(), "/v1/jobs"] {
        let seen = server.get(path, &[("Authorization", &reader)]);
        assert_eq!(seen.status, 200, "{}", seen.text());
        assert!(!seen.text().contains("hidden"), "{path}: {}", seen.text());
        assert!(server.get(path, &own).text().contains("hidden"), "{path}");
    }
}

/// A name that leads to a private address is found out when it is looked up, and nothing is sent.
#[test]
fn a_name_of_a_private_address_is_not_told() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let listener = TcpListener::bind("127.0.0.1:0").expect("bound");
    listener.set_nonblocking(true).expect("set");
    let port = listener.local_addr().expect("an address").port();
    let server = Server::start(&["--webhook-secret", &secret(folder.path())]);
    for scheme in ["http", "https"] {
        let place = ended(&server, &format!("{scheme}://localhost:{port}/hook"));
        server.wait(&format!("{place}/log"), |log| {
            log.to_string().contains("localhost is no public address")
        });
    }
    let kind = listener.accept().expect_err("somebody connected").kind();
    assert_eq!(kind, std::io::ErrorKind::WouldBlock);
}

/// An authority of our own, and what it vouches for.
struct Authority {
    issuer: Issuer<'static, KeyPair>,
    pem: String,
}

impl Authority {
    fn new() -> Self {
        let mut params = CertificateParams::new(Vec::new()).expect("parameters");
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().expect("a key");
        let pem = params.self_signed(&key).expect("a certificate").pem();
        Self { issuer: Issuer::new(params, key), pem }
    }

    /// The authority's certificate in a file.
    fn file(&self, folder: &Path) -> PathBuf {
        let path = folder.join("authority.pem");
        fs::write(&path, &self.pem).expect("written");
        path
    }

    /// How a receiver of this name speaks TLS.
    fn vouch(&self, name: &str) -> Arc<ServerConfig> {
        let key = KeyPair::generate().expect("a key");
        let params = CertificateParams::new(vec![name.to_owned()]).expect("parameters");
        let certificate = params.signed_by(&key, &self.issuer).expect("a certificate");
        let key = PrivateKeyDer::Pkcs8(PrivatePkcs8KeyDer::from(key.serialize_der()));
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let builder = ServerConfig::builder_with_provider(provider);
        let builder = builder.with_safe_default_protocol_versions().expect("versions");
        let builder = builder.with_no_client_auth();
        let chain = vec![certificate.der().clone()];
        Arc::new(builder.with_single_cert(chain, key).expect("a certificate and its key"))
    }
}

/// Someone who speaks TLS with one client: the message, or nothing where the client went away.
fn secure_receiver(config: Arc<ServerConfig>) -> (u16, JoinHandle<Option<String>>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("bound");
    let port = listener.local_addr().expect("an address").port();
    let taken = std::thread::spawn(move || {
        let (stream, _) = listener.accept().expect("accepted");
        let connection = ServerConnection::new(config).expect("a connection");
        take(&mut StreamOwned::new(connection, stream), "204 Yes")
    });
    (port, taken)
}

/// Over TLS a receiver is told that an authority vouches for, by name or by address; one that a
/// stranger vouches for, that goes by another name, or that speaks no TLS is told nothing.
#[test]
fn receivers_are_told_by_tls() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let secret = secret(folder.path());
    let (own, stranger) = (Authority::new(), Authority::new());
    let file = own.file(folder.path());
    let trusted = ["--webhook-ca", file.to_str().expect("text")];
    let flags = ["--webhook-secret", &secret, "--webhook-private"];
    let server = Server::start(&[&flags[..], &trusted].concat());
    for host in ["localhost", "127.0.0.1"] {
        let (port, taken) = secure_receiver(own.vouch(host));
        let place = ended(&server, &format!("https://{host}:{port}/hook?a=b"));
        check(&taken.join().expect("a receiver").expect("a message"), "cancelled");
        server.wait(&format!("{place}/log"), |log| log.to_string().contains("took the message"));
    }
    let refused = |config: Arc<ServerConfig>, why: &str| {
        let (port, taken) = secure_receiver(config);
        let place = ended(&server, &format!("https://localhost:{port}/hook?a=b"));
        server.wait(&format!("{place}/log"), |log| log.to_string().contains(why));
        assert_eq!(taken.join().expect("a receiver"), None, "{why}");
    };
    refused(stranger.vouch("localhost"), "invalid peer certificate");
    refused(own.vouch("elsewhere.example"), "not valid for name");
    let (url, _taken) = receiver();
    let place = ended(&server, &url.replace("http://", "https://"));
    server.wait(&format!("{place}/log"), |log| log.to_string().contains("again in 5 s"));
}
