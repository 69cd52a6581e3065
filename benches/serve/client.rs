//! The service's own binary on a folder that holds a model and many jobs, and connections that stay
//! open.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rusqlite::params;
use serde_json::Value;
use sha2::{Digest, Sha256};

/// Lower-case hexadecimal.
pub(crate) fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// An answer.
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).expect("JSON")
    }
}

/// A connection that is used again and again.
pub(crate) struct Connection(BufReader<TcpStream>);

impl Connection {
    pub(crate) fn send(&mut self, method: &str, path: &str, body: &[u8], headers: &str) -> Answer {
        let head = format!(
            "{method} {path} HTTP/1.1\r\nHost: localhost\r\n{headers}Content-Length: {}\r\n\r\n",
            body.len()
        );
        if body.len() < 1 << 16 {
            self.0.get_mut().write_all(&[head.as_bytes(), body].concat()).expect("sent");
        } else {
            self.0.get_mut().write_all(head.as_bytes()).expect("sent");
            self.0.get_mut().write_all(body).expect("sent");
        }
        let (status, length) = self.head();
        let mut body = vec![0; length];
        self.0.read_exact(&mut body).expect("a body");
        Answer { status, body }
    }

    /// Downloads and forgets; how many bytes there were.
    pub(crate) fn drain(&mut self, path: &str) -> usize {
        let head = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n");
        self.0.get_mut().write_all(head.as_bytes()).expect("sent");
        let (status, length) = self.head();
        assert_eq!(status, 200);
        let mut buffer = vec![0; 1 << 20];
        let mut left = length;
        while left > 0 {
            let most = left.min(buffer.len());
            let count = self.0.read(&mut buffer[..most]).expect("a body");
            assert!(count > 0, "the download ended early");
            left -= count;
        }
        length
    }

    fn head(&mut self) -> (u16, usize) {
        let (mut status, mut length) = (0, 0);
        let mut line = String::new();
        loop {
            line.clear();
            self.0.read_line(&mut line).expect("a line");
            let text = line.trim_end();
            if let Some(rest) = text.strip_prefix("HTTP/1.1 ") {
                status = rest[..3].parse().expect("a status");
            } else if let Some(rest) = text.to_ascii_lowercase().strip_prefix("content-length:") {
                length = rest.trim().parse().expect("a length");
            } else if text.is_empty() {
                return (status, length);
            }
        }
    }
}

/// A running service.
pub(crate) struct Server {
    _folder: tempfile::TempDir,
    child: Child,
    address: String,
    figure: String,
    model: String,
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Server {
    /// A service that has this model and so many jobs behind it.
    pub(crate) fn start(blob: &[u8], jobs: usize) -> Self {
        more_descriptors();
        let folder = tempfile::tempdir().expect("a temporary folder");
        let binary = env!("CARGO_BIN_EXE_poselight");
        let sample = folder.path().join("figure.glb");
        let made = Command::new(binary).args(["sample", "figure", "-o"]).arg(&sample).output();
        assert!(made.is_ok_and(|output| output.status.success()));
        // The tables are the service's own.
        drop(spawn(binary, folder.path()));
        let model = fill(&folder.path().join("data"), blob, jobs).expect("filled");
        let (child, address) = spawn(binary, folder.path()).release();
        let mut server = Self { _folder: folder, child, address, figure: String::new(), model };
        let bytes = fs::read(&sample).expect("made");
        server.figure = sha256(&bytes);
        let path = format!("/v1/assets/{}?name=figure.glb", server.figure);
        let answer = server.connect().send("PUT", &path, &bytes, "");
        assert_eq!(answer.status, 201, "{}", answer.text());
        server
    }

    pub(crate) fn figure(&self) -> &str {
        &self.figure
    }

    pub(crate) fn model(&self) -> &str {
        &self.model
    }

    pub(crate) fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    pub(crate) fn connect(&self) -> Connection {
        let stream = TcpStream::connect(&self.address).expect("connected");
        stream.set_nodelay(true).expect("set");
        Connection(BufReader::with_capacity(1 << 16, stream))
    }

    /// A stream of events whose head has come; none where there are no more descriptors.
    pub(crate) fn listen(&self, path: &str) -> Option<TcpStream> {
        let mut stream = TcpStream::connect(&self.address).ok()?;
        let head = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n");
        stream.write_all(head.as_bytes()).ok()?;
        let mut buffer = [0; 4096];
        (stream.read(&mut buffer).ok()? > 0).then_some(stream)
    }

    /// Memory of the process that is in use.
    pub(crate) fn resident_bytes(&self) -> u64 {
        let status =
            fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        kib.unwrap_or(0) * 1024
    }
}

/// As many descriptors as this process may have; the service inherits that.
fn more_descriptors() {
    use rustix::process::{Resource, getrlimit, setrlimit};
    let mut limit = getrlimit(Resource::Nofile);
    limit.current = limit.maximum;
    if setrlimit(Resource::Nofile, limit).is_err() {
        println!("the limit of open files stays as it is");
    }
}

/// A child that is stopped unless it is released.
struct Running(Option<(Child, String)>);

impl Running {
    fn release(mut self) -> (Child, String) {
        self.0.take().expect("released once")
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some((child, _)) = &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn spawn(binary: &str, folder: &Path) -> Running {
    let log = folder.join("log");
    let child = Command::new(binary)
        .args(["serve", "--data", "data", "--listen", "127.0.0.1:0"])
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(fs::File::create(&log).expect("a log"))
        .spawn()
        .expect("started");
    let mut running = Running(Some((child, String::new())));
    for _ in 0..6000 {
        let text = fs::read_to_string(&log).unwrap_or_default();
        let address = text.split("address=").nth(1).and_then(|rest| rest.split_whitespace().next());
        if let (Some(address), Some((_, own))) = (address, &mut running.0) {
            address.clone_into(own);
            return running;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("the service does not start");
}

/// Puts a model and finished jobs into the service's folder; the model's id.
fn fill(data: &Path, blob: &[u8], jobs: usize) -> Result<String, rusqlite::Error> {
    let id = sha256(b"the model of the benchmark");
    let folder = data.join("models").join(&id);
    fs::create_dir_all(&folder).expect("made");
    fs::write(folder.join("model.safetensors"), blob).expect("written");
    let mut database = rusqlite::Connection::open(data.join("poselight.db"))?;
    let tx = database.transaction()?;
    let sql = "INSERT INTO models (id, sha256, bytes, job, created_ms) VALUES (?1, ?2, ?3, '', 0)";
    tx.execute(sql, params![id, sha256(blob), blob.len()])?;
    let sql = "INSERT INTO jobs (id, state, priority, request, bake, fit, cached, created_ms, kind)
        VALUES (?1, ?2, 0, ?3, ?4, ?4, 0, 0, ?5)";
    let request =
        format!(r#"{{"kind":"run","assets":{{"hero.glb":"{id}"}},"recipe":{{"version":1}}}}"#);
    for number in 0..jobs {
        let state = if number % 1000 == 7 { "failed" } else { "succeeded" };
        let kind = if number % 2000 == 9 { "measure" } else { "run" };
        tx.execute(
            sql,
            params![format!("{number:032x}"), state, request, sha256(&number.to_le_bytes()), kind],
        )?;
    }
    tx.commit()?;
    Ok(id)
}
