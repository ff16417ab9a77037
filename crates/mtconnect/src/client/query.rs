//! What to ask an agent, from an address as people write it: the agent's, a device's, or a whole sample query.

use std::time::Duration;

/// Where an agent is and what of it is wanted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Query {
    /// Host name or address; an IPv6 address without its brackets.
    pub host: String,
    /// Port.
    pub port: u16,
    /// What stands before `/sample`: empty, or `/` and the device's name as written.
    pub device: String,
    /// Which data items, as an XPath over the device model; everything when `None`.
    pub path: Option<String>,
    /// First sequence number wanted; the oldest the agent has when `None`.
    pub from: Option<u64>,
    /// Most observations in one document.
    pub count: Option<u64>,
    /// Least time between two documents.
    pub interval: Option<Duration>,
    /// Longest silence of the agent while there is nothing to tell.
    pub heartbeat: Option<Duration>,
}

/// Why an address cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadAddress(pub String);

impl std::fmt::Display for BadAddress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// The three requests of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// The device model.
    Probe,
    /// The newest observation of each data item.
    Current,
    /// Observations from a number on, as a stream.
    Sample {
        /// The number.
        from: u64,
        /// Most observations in one document.
        count: u64,
        /// Least time between two documents.
        interval: Duration,
        /// Longest silence.
        heartbeat: Duration,
    },
}

impl Query {
    /// Takes an address apart: `http://host:5000`, `http://host:5000/device`, or
    /// `http://host:5000/sample?from=123&count=1000&interval=1000&path=//DataItem[@type="PATH_POSITION"]`.
    ///
    /// A second `?` where `&` belongs and quotes with a backslash, as they stand in published examples, are understood.
    ///
    /// # Errors
    /// It is no address of an agent.
    pub fn parse(address: &str) -> Result<Query, BadAddress> {
        let address = address.trim();
        let rest = match address.split_once("://") {
            None => address,
            Some((scheme, rest)) if scheme.eq_ignore_ascii_case("http") => rest,
            Some((scheme, _)) if scheme.eq_ignore_ascii_case("https") => {
                return Err(BadAddress(format!(
                    "{address}: https is not supported yet; give the agent's http address"
                )));
            }
            Some((scheme, _)) => {
                return Err(BadAddress(format!(
                    "{address}: {scheme}:// is no agent's address; http:// was expected"
                )));
            }
        };
        let end = rest.find(['/', '?']).unwrap_or(rest.len());
        let (authority, rest) = rest.split_at(end);
        let (host, port) = host_and_port(authority).map_err(|why| BadAddress(format!("{address}: {why}")))?;
        let (folder, parameters) = rest.split_once('?').unwrap_or((rest, ""));
        let folder = folder.trim_end_matches('/');
        let device = ["/sample", "/current", "/probe"]
            .iter()
            .find_map(|request| folder.strip_suffix(request))
            .unwrap_or(folder);
        let mut query = Query {
            host,
            port,
            device: if device.is_empty() {
                String::new()
            } else {
                encoded(&decoded(device), b"/")
            },
            path: None,
            from: None,
            count: None,
            interval: None,
            heartbeat: None,
        };
        for parameter in parameters_of(parameters) {
            let (name, value) = parameter.split_once('=').unwrap_or((parameter, ""));
            query
                .set(name, &decoded(value))
                .map_err(|why| BadAddress(format!("{address}: {why}")))?;
        }
        Ok(query)
    }

    fn set(&mut self, name: &str, value: &str) -> Result<(), String> {
        let number = || {
            value
                .trim()
                .parse::<u64>()
                .map_err(|_| format!("{name}={value}: a whole number was expected"))
        };
        match name {
            "path" => self.path = Some(path_of(value)),
            "from" => self.from = Some(number()?),
            "count" => self.count = Some(number()?),
            "interval" | "frequency" => self.interval = Some(Duration::from_millis(number()?)),
            "heartbeat" => self.heartbeat = Some(Duration::from_millis(number()?)),
            "" => {}
            _ => {
                return Err(format!(
                    "the parameter '{name}' is not known here: path, from, count, interval and heartbeat are"
                ));
            }
        }
        Ok(())
    }

    /// The bytes of a request.
    pub fn request(&self, request: Request) -> Vec<u8> {
        let (what, mut parameters) = match request {
            Request::Probe => ("probe", String::new()),
            Request::Current => ("current", String::new()),
            Request::Sample {
                from,
                count,
                interval,
                heartbeat,
            } => (
                "sample",
                format!(
                    "from={from}&count={count}&interval={}&heartbeat={}",
                    interval.as_millis(),
                    heartbeat.as_millis()
                ),
            ),
        };
        if let (Some(path), false) = (&self.path, request == Request::Probe) {
            let separator = if parameters.is_empty() { "" } else { "&" };
            parameters = format!("path={}{separator}{parameters}", encoded(path, b"/@=:,()*'!"));
        }
        let mark = if parameters.is_empty() { "" } else { "?" };
        format!(
            "GET {}/{what}{mark}{parameters} HTTP/1.1\r\nHost: {}\r\nUser-Agent: toolmark\r\nAccept: application/xml, text/xml, multipart/x-mixed-replace, */*\r\n\r\n",
            self.device,
            self.authority(),
        )
        .into_bytes()
    }

    /// Host and port as they stand in an address.
    pub fn authority(&self) -> String {
        if self.host.contains(':') {
            format!("[{}]:{}", self.host, self.port)
        } else {
            format!("{}:{}", self.host, self.port)
        }
    }
}

/// The XPath of a parameter: without backslashes before quotes, and without the last quote when that has no partner.
fn path_of(written: &str) -> String {
    let path = written.replace("\\\"", "\"");
    match path.strip_suffix('"') {
        Some(rest) if path.matches('"').count() % 2 == 1 => rest.to_owned(),
        _ => path,
    }
}

fn host_and_port(authority: &str) -> Result<(String, u16), String> {
    if authority.contains('@') {
        return Err("a name and password in the address are not supported: agents do not ask for them".to_owned());
    }
    let (host, port) = match authority.strip_prefix('[') {
        Some(rest) => {
            let (host, rest) = rest.split_once(']').ok_or("the address in brackets has no end")?;
            (host, rest.strip_prefix(':'))
        }
        None => match authority.split_once(':') {
            Some((host, port)) => (host, Some(port)),
            None => (authority, None),
        },
    };
    if host.is_empty() || host.contains(|c: char| c.is_whitespace() || c.is_control()) {
        return Err("the name of a host was expected, as in http://host:5000".to_owned());
    }
    match port.filter(|p| !p.is_empty()) {
        None => Ok((host.to_owned(), 80)),
        Some(port) => match port.parse() {
            Ok(port) if port > 0 => Ok((host.to_owned(), port)),
            _ => Err(format!("'{port}' is no port: 1 to 65535 was expected")),
        },
    }
}

/// Parts a query at `&`, and at `?` before a known name.
fn parameters_of(query: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    for part in query.split('&') {
        let mut rest = part;
        while let Some(at) = ["from=", "count=", "interval=", "frequency=", "path=", "heartbeat="]
            .iter()
            .filter_map(|name| rest.find(&format!("?{name}")))
            .min()
        {
            parts.push(&rest[..at]);
            rest = &rest[at + 1..];
        }
        parts.push(rest);
    }
    parts
}

/// `%22` is a quote. A lone percent sign stays.
fn decoded(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let hex = bytes.get(at + 1..at + 3).and_then(|d| std::str::from_utf8(d).ok());
        match (bytes[at], hex.and_then(|d| u8::from_str_radix(d, 16).ok())) {
            (b'%', Some(byte)) => {
                out.push(byte);
                at += 3;
            }
            (byte, _) => {
                out.push(byte);
                at += 1;
            }
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// Everything but letters, digits, `-._~` and `plain` becomes `%XX` (RFC 3986 section 2).
fn encoded(text: &str, plain: &[u8]) -> String {
    let mut out = String::new();
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) || plain.contains(&byte) {
            out.push(char::from(byte));
        } else {
            out.push_str(&format!("%{byte:02X}"));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_published_sample_query_with_its_slips_is_understood() {
        let written = r#"http://okuma-matata:5000/sample?from=123?count=1000&interval=1000&path=//Path/DataItems/DataItem[@type=\"PATH_POSITION\"]""#;
        let query = Query::parse(written).expect("an address");
        assert_eq!(
            (query.host.as_str(), query.port, query.device.as_str()),
            ("okuma-matata", 5000, "")
        );
        assert_eq!(
            (query.from, query.count, query.interval),
            (Some(123), Some(1000), Some(Duration::from_secs(1)))
        );
        assert_eq!(
            query.path.as_deref(),
            Some("//Path/DataItems/DataItem[@type=\"PATH_POSITION\"]")
        );
    }

    #[test]
    fn an_address_alone_a_device_and_an_encoded_path_are_understood() {
        for (address, host, port, device, path) in [
            ("agent", "agent", 80, "", None),
            ("http://10.0.0.5:5000/", "10.0.0.5", 5000, "", None),
            ("HTTP://[::1]:5000/VMC-3Axis/current", "::1", 5000, "/VMC-3Axis", None),
            (
                "agent:7878/a%20b/sample?path=//DataItem%5B@id=%22x%22%5D",
                "agent",
                7878,
                "/a%20b",
                Some("//DataItem[@id=\"x\"]"),
            ),
        ] {
            let query = Query::parse(address).expect("an address");
            assert_eq!(
                (query.host.as_str(), query.port, query.device.as_str(), query.path.as_deref()),
                (host, port, device, path)
            );
        }
    }

    #[test]
    fn what_is_no_address_is_said() {
        for (address, word) in [
            ("https://agent", "https is not supported yet"),
            ("ftp://agent", "ftp"),
            ("http://", "host"),
            ("http://agent:0", "port"),
            ("http://agent:99999", "port"),
            ("http://agent/sample?from=x", "whole number"),
            ("http://agent/sample?form=1", "'form'"),
            ("http://[::1", "brackets"),
            ("http://me:secret@agent", "password"),
        ] {
            let error = Query::parse(address).expect_err(address);
            assert!(error.0.contains(word), "{error}");
        }
    }

    #[test]
    fn requests_are_written_as_agents_read_them() {
        let query = Query::parse("agent:5000/VMC/sample?path=//DataItem[@type=\"PATH_POSITION\" and @subType='ACTUAL']")
            .expect("an address");
        let sample = Request::Sample {
            from: 7,
            count: 100,
            interval: Duration::from_millis(50),
            heartbeat: Duration::from_secs(10),
        };
        let text = String::from_utf8(query.request(sample)).expect("ASCII");
        assert!(text.starts_with("GET /VMC/sample?path=//DataItem%5B@type=%22PATH_POSITION%22%20and%20@subType='ACTUAL'%5D&from=7&count=100&interval=50&heartbeat=10000 HTTP/1.1\r\nHost: agent:5000\r\n"), "{text}");
        assert!(text.ends_with("\r\n\r\n"));
        assert!(
            String::from_utf8(query.request(Request::Probe))
                .expect("ASCII")
                .starts_with("GET /VMC/probe HTTP/1.1\r\n")
        );
    }
}
