//! A service in a temporary folder, and a client that writes HTTP by hand, so that it can also
//! write it wrongly.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use sha2::{Digest, Sha256};

/// Lower-case hexadecimal.
pub(crate) fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// An answer.
pub(crate) struct Answer {
    pub(crate) status: u16,
    headers: Vec<(String, String)>,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {}", self.text()))
    }

    pub(crate) fn header(&self, name: &str) -> Option<String> {
        self.headers.iter().find(|(known, _)| known == name).map(|(_, value)| value.clone())
    }
}

/// A running service; its folder goes with it.
pub(crate) struct Server {
    folder: tempfile::TempDir,
    flags: Vec<String>,
    child: Child,
    address: String,
    figure: String,
}

impl Server {
    /// Starts a service that knows the bundled character.
    pub(crate) fn start(flags: &[&str]) -> Self {
        Self::start_within(flags, "")
    }

    /// The same in a mount namespace of its own, where a command has prepared the folder `data`.
    pub(crate) fn start_within(flags: &[&str], mount: &str) -> Self {
        let mut server = Self::spawn_within(flags, mount);
        server.command(&["sample", "figure", "-o", "figure.glb"]);
        let bytes = fs::read(server.path("figure.glb")).expect("made");
        server.figure = sha256(&bytes);
        let path = format!("/v1/assets/{}?name=figure.glb", server.figure);
        let answer = server.put(&path, &bytes, &[]);
        assert_eq!(answer.status, 201, "{}", answer.text());
        server
    }

    /// A service that knows nothing yet.
    pub(crate) fn spawn_within(flags: &[&str], mount: &str) -> Self {
        let folder = tempfile::tempdir().expect("temporary folder");
        let flags: Vec<String> = flags.iter().map(|&flag| flag.to_owned()).collect();
        let (child, address) = spawn(&folder, &flags, mount);
        Self { folder, flags, child, address, figure: String::new() }
    }

    /// The character's asset.
    pub(crate) fn figure(&self) -> String {
        self.figure.clone()
    }

    /// Of the process.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs a command of ours in the server's folder.
    pub(crate) fn command(&self, words: &[&str]) -> Output {
        let output = Command::new(env!("CARGO_BIN_EXE_poselight"))
            .args(words)
            .current_dir(self.folder.path())
            .output()
            .expect("started");
        assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
        output
    }

    /// `kill -9`.
    pub(crate) fn kill(&mut self) {
        self.child.kill().expect("killed");
        self.child.wait().expect("ended");
    }

    /// Sends a signal.
    pub(crate) fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        Command::new("kill").args([&format!("-{name}"), &pid]).status().expect("signalled");
    }

    /// SIGTERM, and the end that it comes to.
    pub(crate) fn terminate(&mut self) -> ExitStatus {
        self.signal("TERM");
        self.child.wait().expect("ended")
    }

    pub(crate) fn restart(&mut self) {
        (self.child, self.address) = spawn(&self.folder, &self.flags, "");
    }

    /// The folder `data` as the service sees it, mounts of its own and all.
    pub(crate) fn data(&self) -> PathBuf {
        let own = PathBuf::from(format!("/proc/{}/root", self.child.id()));
        own.join(self.path("data").strip_prefix("/").expect("absolute"))
    }

    /// Another service cannot take the folder.
    pub(crate) fn second_process_is_refused(&self) {
        let output = Command::new(env!("CARGO_BIN_EXE_poselight"))
            .args(["serve", "--data", "data", "--listen", "127.0.0.1:0"])
            .current_dir(self.folder.path())
            .output()
            .expect("started");
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains("another process"), "{message}");
    }

    pub(crate) fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    pub(crate) fn connect(&self) -> TcpStream {
        TcpStream::connect(&self.address).expect("connected")
    }

    pub(crate) fn get(&self, path: &str, headers: &[(&str, &str)]) -> Answer {
        self.send("GET", path, b"", headers)
    }

    pub(crate) fn delete(&self, path: &str) -> Answer {
        self.send("DELETE", path, b"", &[])
    }

    pub(crate) fn put(&self, path: &str, body: &[u8], headers: &[(&str, &str)]) -> Answer {
        self.send("PUT", path, body, headers)
    }

    pub(crate) fn post(&self, path: &str, body: &Value, headers: &[(&str, &str)]) -> Answer {
        self.send("POST", path, body.to_string().as_bytes(), headers)
    }

    /// One request on a connection of its own.
    pub(crate) fn send(
        &self,
        method: &str,
        path: &str,
        body: &[u8],
        headers: &[(&str, &str)],
    ) -> Answer {
        let mut head = format!(
            "{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n",
            body.len()
        );
        if !headers.iter().any(|(name, _)| *name == "Host") {
            head += "Host: localhost\r\n";
        }
        for (name, value) in headers {
            head += &format!("{name}: {value}\r\n");
        }
        let mut stream = self.connect();
        stream.set_read_timeout(Some(Duration::from_secs(300))).expect("set");
        stream.write_all((head + "\r\n").as_bytes()).expect("sent");
        // A body that is refused by its length need not be read.
        let _ = stream.write_all(body);
        let mut answer = Vec::new();
        let read = stream.read_to_end(&mut answer);
        assert!(read.is_ok() || !answer.is_empty(), "{method} {path}: {read:?}");
        parse(&answer)
    }

    /// Asks for a job until it is as wanted; the answer that was.
    pub(crate) fn wait(&self, path: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let job = self.get(path, &[]).json();
            if wanted(&job) {
                return job;
            }
            assert!(start.elapsed() < Duration::from_secs(300), "not within five minutes: {job}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A service and its address, which it writes into its log. A command that mounts is run before it,
/// in a namespace of their own.
fn spawn(folder: &tempfile::TempDir, flags: &[String], mount: &str) -> (Child, String) {
    let log = folder.path().join("log");
    fs::create_dir_all(folder.path().join("data")).expect("made");
    let binary = env!("CARGO_BIN_EXE_poselight");
    let mut command = match mount {
        "" => Command::new(binary),
        mount => {
            let mut command = Command::new("unshare");
            command.args(["-rm", "sh", "-c", &format!("{mount} && exec \"$0\" \"$@\""), binary]);
            command
        }
    };
    let mut child = command
        .args(["serve", "--data", "data", "--listen", "127.0.0.1:0"])
        .args(flags)
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .stderr(File::create(&log).expect("a log"))
        .spawn()
        .expect("started");
    let start = Instant::now();
    loop {
        let text = fs::read_to_string(&log).unwrap_or_default();
        let address = text.split("address=").nth(1).and_then(|rest| rest.split_whitespace().next());
        if let Some(address) = address {
            return (child, address.to_owned());
        }
        let ended = child.try_wait().expect("asked");
        assert!(ended.is_none() && start.elapsed() < Duration::from_secs(60), "no service: {text}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn parse(bytes: &[u8]) -> Answer {
    let split = bytes.windows(4).position(|window| window == b"\r\n\r\n").expect("a head");
    let head = String::from_utf8_lossy(&bytes[..split]).into_owned();
    let mut lines = head.lines();
    let status = lines.next().and_then(|line| line.split(' ').nth(1)).expect("a status");
    let headers: Vec<(String, String)> = lines
        .filter_map(|line| line.split_once(": "))
        .map(|(name, value)| (name.to_lowercase(), value.to_owned()))
        .collect();
    let chunked =
        headers.iter().any(|(name, value)| name == "transfer-encoding" && value == "chunked");
    let body = &bytes[split + 4..];
    let body = if chunked { unchunk(body) } else { body.to_vec() };
    Answer { status: status.parse().expect("a number"), headers, body }
}

fn unchunk(mut bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    loop {
        let end = bytes.windows(2).position(|window| window == b"\r\n").expect("a chunk's size");
        let size = std::str::from_utf8(&bytes[..end]).expect("text");
        let size = usize::from_str_radix(size.trim(), 16).expect("hexadecimal");
        if size == 0 {
            return out;
        }
        out.extend_from_slice(&bytes[end + 2..end + 2 + size]);
        bytes = &bytes[end + 4 + size..];
    }
}
