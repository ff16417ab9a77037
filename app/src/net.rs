//! Connections: plain TCP with an end to every wait.

use std::io::{Error, ErrorKind, Read, Result, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

/// How long one address is tried.
const CONNECT: Duration = Duration::from_secs(5);
/// How long the other side may take to take what is sent.
const SEND: Duration = Duration::from_secs(10);

/// A connection.
#[derive(Debug)]
pub struct Connection {
    stream: TcpStream,
}

impl Connection {
    /// Connects to the first address of a host that answers.
    ///
    /// # Errors
    /// The name is unknown, or nobody answers.
    pub fn open(host: &str, port: u16) -> Result<Connection> {
        let mut last = Error::new(ErrorKind::NotFound, "the name has no address");
        for address in (host, port).to_socket_addrs()? {
            match TcpStream::connect_timeout(&address, CONNECT) {
                Ok(stream) => {
                    stream.set_nodelay(true)?;
                    stream.set_write_timeout(Some(SEND))?;
                    return Ok(Connection { stream });
                }
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    /// Sends all of it.
    ///
    /// # Errors
    /// The connection is gone, or the other side takes nothing.
    pub fn send(&mut self, bytes: &[u8]) -> Result<()> {
        self.stream.write_all(bytes)
    }

    /// Waits for bytes, for so long at most; `None` when none came.
    ///
    /// # Errors
    /// The connection has ended.
    pub fn receive(&mut self, buffer: &mut [u8], longest: Duration) -> Result<Option<usize>> {
        // A wait of 0 would be no end at all.
        self.stream.set_read_timeout(Some(longest.max(Duration::from_millis(1))))?;
        match self.stream.read(buffer) {
            Ok(0) => Err(Error::new(ErrorKind::UnexpectedEof, "the agent closed the connection")),
            Ok(count) => Ok(Some(count)),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }
}
