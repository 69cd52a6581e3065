//! One message over one connection. The answer's status is all that is read of it.

use std::io::{Error, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::address::Target;

/// Time to connect, and for each read and write.
const PATIENCE: Duration = Duration::from_secs(10);

/// Bytes that are read in search of the status line's end.
const MOST_BYTES: usize = 4096;

/// Sends a body; the answer's status.
///
/// # Errors
/// What the network objects to; an answer that is not HTTP.
pub(super) fn post(
    target: &Target,
    address: SocketAddr,
    headers: &[(&str, String)],
    body: &[u8],
) -> Result<u16, Error> {
    let mut stream = TcpStream::connect_timeout(&address, PATIENCE)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut head = format!(
        "POST {} HTTP/1.1\r\nHost: {}\r\nUser-Agent: poselight/{}\r\nConnection: close\r\n\
         Content-Type: application/json\r\nContent-Length: {}\r\n",
        target.path(),
        target.authority(),
        env!("CARGO_PKG_VERSION"),
        body.len()
    );
    for (name, value) in headers {
        head += &format!("{name}: {value}\r\n");
    }
    head += "\r\n";
    stream.write_all(&[head.as_bytes(), body].concat())?;
    read_status(&mut stream, Instant::now() + PATIENCE)
}

/// A receiver that answers drop by drop is given up like one that does not answer.
fn read_status(stream: &mut impl Read, until: Instant) -> Result<u16, Error> {
    let mut line = Vec::new();
    let mut byte = [0];
    while line.len() < MOST_BYTES && !line.ends_with(b"\n") && stream.read(&mut byte)? == 1 {
        line.push(byte[0]);
        if Instant::now() > until {
            return Err(ErrorKind::TimedOut.into());
        }
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
        let read = |text: &str| read_status(&mut text.as_bytes(), Instant::now() + PATIENCE).ok();
        assert_eq!(read("HTTP/1.1 204 No Content\r\nX: y\r\n\r\n"), Some(204));
        assert_eq!(read("HTTP/1.0 500\r\n"), Some(500));
        for bad in ["", "SSH-2.0-x\r\n", "HTTP/1.1\r\n", "HTTP/1.1 abc\r\n", &"x".repeat(10_000)] {
            assert_eq!(read(bad), None);
        }
        assert!(read_status(&mut "HTTP/1.1 204\r\n".as_bytes(), Instant::now()).is_err());
    }
}
