//! Where a controller is: `tcp://HOST:PORT`.

use crate::failure::Failure;
use std::net::{SocketAddr, ToSocketAddrs};

/// The address of a controller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Name or number of the computer.
    pub host: String,
    /// Port.
    pub port: u16,
}

/// True when `--machine` means a controller somewhere else.
pub fn is_address(machine: &str) -> bool {
    machine.contains("://")
}

/// Reads what `--machine` says.
///
/// # Errors
/// It is no such address.
pub fn read(machine: &str) -> Result<Address, Failure> {
    let wrong = |why: &str| Failure::usage(format_args!("--machine {machine}: {why}; write it like tcp://127.0.0.1:7450"));
    let rest = machine.strip_prefix("tcp://").ok_or_else(|| wrong("only tcp:// is known"))?;
    let (host, port) = rest.rsplit_once(':').ok_or_else(|| wrong("the port is missing"))?;
    let port = port
        .parse()
        .ok()
        .filter(|port| *port > 0)
        .ok_or_else(|| wrong("the port is no number of 1 to 65535"))?;
    let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    if bare.is_empty() || bare.contains(['/', '@', ' ']) {
        return Err(wrong("the host is missing, or is no name of a host"));
    }
    Ok(Address {
        host: bare.to_owned(),
        port,
    })
}

impl Address {
    /// The addresses behind the name.
    ///
    /// # Errors
    /// There is no such host.
    pub fn resolve(&self) -> Result<Vec<SocketAddr>, Failure> {
        let unknown = |why: String| Failure::machine(format_args!("{}: {why}; check the name of the controller", self.host));
        let found: Vec<_> = (self.host.as_str(), self.port)
            .to_socket_addrs()
            .map_err(|e| unknown(e.to_string()))?
            .collect();
        if found.is_empty() {
            return Err(unknown("the name has no address".to_owned()));
        }
        Ok(found)
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.host.contains(':') {
            write!(f, "tcp://[{}]:{}", self.host, self.port)
        } else {
            write!(f, "tcp://{}:{}", self.host, self.port)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_read_and_anything_else_says_how_to_write_one() {
        assert_eq!(
            read("tcp://127.0.0.1:7450").expect("good").to_string(),
            "tcp://127.0.0.1:7450"
        );
        assert_eq!(read("tcp://[::1]:7450").expect("good").to_string(), "tcp://[::1]:7450");
        for (text, why) in [
            ("http://a:1", "only tcp://"),
            ("tcp://a", "the port is missing"),
            ("tcp://a:0", "no number of 1 to 65535"),
            ("tcp://a:70000", "no number of 1 to 65535"),
            ("tcp://:1", "the host is missing"),
            ("tcp://a/b:1", "the host is missing"),
        ] {
            let failure = read(text).expect_err(text);
            assert!(
                failure.message.contains(why) && failure.message.contains("tcp://127.0.0.1:7450"),
                "{}",
                failure.message
            );
        }
    }
}
