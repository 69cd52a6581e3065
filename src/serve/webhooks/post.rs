//! One message over one connection, by TLS where the address says so. The answer's status is all that
//! is read of it.

use std::io::{Error, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustls::{ClientConfig, ClientConnection, StreamOwned};

use super::address::Target;
use super::tls;

/// Time to connect to one address.
const CONNECT: Duration = Duration::from_secs(10);

/// Time for all that follows: greeting, message and answer.
const PATIENCE: Duration = Duration::from_secs(20);

/// Bytes that are read in search of the status line's end.
const MOST_BYTES: usize = 4096;

/// A connection that ends at a time, however busy it looks: a receiver that speaks drop by drop is
/// given up like one that is silent.
struct Timed {
    stream: TcpStream,
    until: Instant,
}

impl Timed {
    fn left(&self) -> Result<Duration, Error> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(left) }
    }
}

impl Read for Timed {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Error> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        self.stream.read(buffer)
    }
}

impl Write for Timed {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.stream.flush()
    }
}

/// Sends a body to the first of some addresses that takes a connection; the answer's status.
///
/// # Errors
/// What the network or the receiver's certificate objects to; an answer that is not HTTP.
pub(super) fn post(
    target: &Target,
    addresses: &[SocketAddr],
    trust: &Arc<ClientConfig>,
    headers: &[(&str, String)],
    body: &[u8],
) -> Result<u16, Error> {
    let mut stream = Timed { stream: connect(addresses)?, until: Instant::now() + PATIENCE };
    let message = [head(target, headers, body.len()).as_bytes(), body].concat();
    if !target.is_secure() {
        return exchange(&mut stream, &message);
    }
    let name = tls::name(target.bare_host())?;
    let connection = ClientConnection::new(Arc::clone(trust), name).map_err(Error::other)?;
    exchange(&mut StreamOwned::new(connection, stream), &message)
}

fn connect(addresses: &[SocketAddr]) -> Result<TcpStream, Error> {
    let mut last = ErrorKind::AddrNotAvailable.into();
    for address in addresses {
        match TcpStream::connect_timeout(address, CONNECT) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn head(target: &Target, headers: &[(&str, String)], length: usize) -> String {
    let mut head = format!(
        "POST {} HTTP/1.1\r\nHost: {}\r\nUser-Agent: poselight/{}\r\nConnection: close\r\n\
         Content-Type: application/json\r\nContent-Length: {length}\r\n",
        target.path(),
        target.authority(),
        env!("CARGO_PKG_VERSION"),
    );
    for (name, value) in headers {
        head += &format!("{name}: {value}\r\n");
    }
    head + "\r\n"
}

fn exchange(stream: &mut (impl Read + Write), message: &[u8]) -> Result<u16, Error> {
    stream.write_all(message)?;
    stream.flush()?;
    read_status(stream)
}

fn read_status(stream: &mut impl Read) -> Result<u16, Error> {
    let mut line = Vec::new();
    let mut byte = [0];
    while line.len() < MOST_BYTES && !line.ends_with(b"\n") && stream.read(&mut byte)? == 1 {
        line.push(byte[0]);
    }
    let text = String::from_utf8_lossy(&line);
    let mut words = text.split(' ');
    let status = words.next().filter(|word| word.starts_with("HTTP/1.")).and(words.next());
    let status = status.and_then(|word| word.trim().parse().ok());
    status.ok_or_else(|| Error::new(ErrorKind::InvalidData, "the answer is not HTTP"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The status is read from the first line; what is no answer is an error, however long.
    #[test]
    fn only_the_status_is_read() {
        let read = |text: &str| read_status(&mut text.as_bytes()).ok();
        assert_eq!(read("HTTP/1.1 204 No Content\r\nX: y\r\n\r\n"), Some(204));
        assert_eq!(read("HTTP/1.0 500\r\n"), Some(500));
        for bad in ["", "SSH-2.0-x\r\n", "HTTP/1.1\r\n", "HTTP/1.1 abc\r\n", &"x".repeat(10_000)] {
            assert_eq!(read(bad), None);
        }
    }

    /// A receiver that goes on speaking is cut at its time, and the second address is tried where
    /// the first takes no connection.
    #[test]
    fn a_connection_ends_at_its_time() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("bound");
        let address = listener.local_addr().expect("an address");
        let closed = {
            let gone = std::net::TcpListener::bind("127.0.0.1:0").expect("bound");
            gone.local_addr().expect("an address")
        };
        let stream = connect(&[closed, address]).expect("the second address");
        let (mut other, _) = listener.accept().expect("accepted");
        other.write_all(b"HTTP").expect("sent");
        let mut timed = Timed { stream, until: Instant::now() + Duration::from_millis(50) };
        let fault = read_status(&mut timed).expect_err("there is no more");
        assert!(matches!(fault.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock), "{fault}");
        let over = timed.read(&mut [0]).expect_err("its time is over");
        assert_eq!(over.kind(), ErrorKind::TimedOut);
    }
}
