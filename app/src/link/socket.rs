//! A connection of the set-point link: TCP, encrypted or not, that never makes anybody wait.

use rustls::Connection as Tls;
use std::io::{Error, ErrorKind, Read, Result, Write};
use std::net::TcpStream;

/// Bytes that wait for the network at most. A side that takes nothing for so long is given up; what it missed is told again when it is back.
const MOST_WAITING: usize = 8 << 20;

/// One connection. Reading and writing do what can be done now and come back.
pub struct Socket {
    stream: TcpStream,
    tls: Option<Box<Tls>>,
    /// To be written, without encryption.
    out: Vec<u8>,
}

impl Socket {
    /// A connection, encrypted when `tls` is given.
    ///
    /// # Errors
    /// The system refuses what it needs.
    pub fn new(stream: TcpStream, tls: Option<Tls>) -> Result<Socket> {
        stream.set_nonblocking(true)?;
        // A set-point that waits for others to fill a packet comes late.
        stream.set_nodelay(true)?;
        let tls = tls.map(|mut tls| {
            tls.set_buffer_limit(Some(MOST_WAITING));
            Box::new(tls)
        });
        Ok(Socket {
            stream,
            tls,
            out: Vec::new(),
        })
    }

    /// Appends what has come.
    ///
    /// # Errors
    /// The connection is over, or what came is not what it has to be.
    pub fn read(&mut self, into: &mut Vec<u8>) -> Result<()> {
        let Some(tls) = &mut self.tls else {
            return read_all(&mut self.stream, into);
        };
        loop {
            match tls.read_tls(&mut self.stream) {
                Ok(0) => return Err(over()),
                Ok(_) => {
                    tls.process_new_packets().map_err(|e| Error::new(ErrorKind::InvalidData, e))?;
                    match read_all(&mut tls.reader(), into) {
                        Err(error) if error.kind() != ErrorKind::UnexpectedEof => return Err(error),
                        Err(_) => return Err(over()),
                        Ok(()) => {}
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// Takes bytes, to be written by [`Socket::flush`].
    ///
    /// # Errors
    /// The other side takes nothing, and too much waits for it.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        match &mut self.tls {
            None if self.out.len() + bytes.len() > MOST_WAITING => {
                Err(Error::new(ErrorKind::TimedOut, "the other side takes nothing"))
            }
            None => {
                self.out.extend_from_slice(bytes);
                Ok(())
            }
            Some(tls) => tls.writer().write_all(bytes),
        }
    }

    /// Writes what the network takes now; true when nothing is left.
    ///
    /// # Errors
    /// The connection is over.
    pub fn flush(&mut self) -> Result<bool> {
        if let Some(tls) = &mut self.tls {
            while tls.wants_write() {
                match tls.write_tls(&mut self.stream) {
                    Ok(_) => {}
                    Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => return Err(error),
                }
            }
            return Ok(true);
        }
        let mut done = 0;
        while done < self.out.len() {
            match self.stream.write(&self.out[done..]) {
                Ok(0) => return Err(over()),
                Ok(count) => done += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        self.out.drain(..done);
        Ok(self.out.is_empty())
    }

    /// Says goodbye, as far as the network lets it.
    pub fn close(mut self) {
        if let Some(tls) = &mut self.tls {
            tls.send_close_notify();
        }
        let _ = self.flush();
        let _ = self.stream.shutdown(std::net::Shutdown::Both);
    }
}

fn read_all(from: &mut impl Read, into: &mut Vec<u8>) -> Result<()> {
    let mut window = [0; 16 * 1024];
    loop {
        match from.read(&mut window) {
            Ok(0) => return Err(over()),
            Ok(count) => into.extend_from_slice(&window[..count]),
            Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

fn over() -> Error {
    Error::new(ErrorKind::UnexpectedEof, "the other side closed the connection")
}
