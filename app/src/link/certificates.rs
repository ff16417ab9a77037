//! Who may talk to whom over a network: both sides show a certificate that the shop's own authority has signed.
//!
//! The machine file names three PEM files: this side's certificate and key, and the authority's certificate. The same three keys serve a
//! controller and a computer that drives one. On a loopback address nothing of it is needed.

use crate::failure::Failure;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use rustls::server::WebPkiClientVerifier;
use rustls::{ClientConfig, ClientConnection, Connection, RootCertStore, ServerConfig, ServerConnection};
use std::net::IpAddr;
use std::path::Path;
use std::sync::Arc;
use store::machine_file::LinkFile;

/// Certificate, key and authority of one side, read.
struct Identity {
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
    authority: RootCertStore,
}

/// Makes the controller's end of encrypted connections.
pub struct Server(Arc<ServerConfig>);

/// Makes the other end.
#[derive(Clone)]
pub struct Client {
    config: Arc<ClientConfig>,
    name: ServerName<'static>,
}

/// The controller's side for an address to listen on; `None` where none is needed.
///
/// # Errors
/// It is no loopback address and the machine file names no certificates, or they cannot be used.
pub fn for_listening(address: IpAddr, link: &LinkFile) -> Result<Option<Server>, Failure> {
    if address.is_loopback() && link.certificate.is_none() {
        return Ok(None);
    }
    let Some(identity) = read(link)? else {
        return Err(Failure::usage(format_args!(
            "{address} can be reached from other computers, and whoever reaches it could move the machine: {ASKED}, or listen on 127.0.0.1"
        )));
    };
    let verifier = WebPkiClientVerifier::builder(Arc::new(identity.authority));
    let verifier = verifier.build().map_err(|e| unusable(link, &e))?;
    let config = ServerConfig::builder().with_client_cert_verifier(verifier);
    let config = config
        .with_single_cert(identity.chain, identity.key)
        .map_err(|e| unusable(link, &e))?;
    Ok(Some(Server(Arc::new(config))))
}

/// The driving side for a host; `None` where none is needed.
///
/// # Errors
/// As [`for_listening`].
pub fn for_connecting(host: &str, is_loopback: bool, link: &LinkFile) -> Result<Option<Client>, Failure> {
    if is_loopback && link.certificate.is_none() {
        return Ok(None);
    }
    let Some(identity) = read(link)? else {
        return Err(Failure::usage(format_args!(
            "{host} is another computer, and set-points go there encrypted only: {ASKED} (--machine-file)"
        )));
    };
    let config = ClientConfig::builder().with_root_certificates(identity.authority);
    let config = config
        .with_client_auth_cert(identity.chain, identity.key)
        .map_err(|e| unusable(link, &e))?;
    let name = ServerName::try_from(host.to_owned()).map_err(|e| Failure::usage(format_args!("{host}: {e}")))?;
    Ok(Some(Client {
        config: Arc::new(config),
        name,
    }))
}

const ASKED: &str = "give certificate, key and authority in [link] of the machine file";

impl Server {
    /// One connection.
    ///
    /// # Errors
    /// A fault of the library: the configuration was checked before.
    pub fn connection(&self) -> std::io::Result<Connection> {
        let made = ServerConnection::new(Arc::clone(&self.0)).map_err(std::io::Error::other)?;
        Ok(made.into())
    }
}

impl Client {
    /// One connection.
    ///
    /// # Errors
    /// A fault of the library: the configuration was checked before.
    pub fn connection(&self) -> std::io::Result<Connection> {
        let made = ClientConnection::new(Arc::clone(&self.config), self.name.clone()).map_err(std::io::Error::other)?;
        Ok(made.into())
    }
}

fn read(link: &LinkFile) -> Result<Option<Identity>, Failure> {
    let (certificate, key, authority) = match (&link.certificate, &link.key, &link.authority) {
        (None, None, None) => return Ok(None),
        (Some(certificate), Some(key), Some(authority)) => (certificate, key, authority),
        _ => {
            let message = "[link] of the machine file needs all three of certificate, key and authority, or none";
            return Err(Failure::unreadable(message));
        }
    };
    let wrong = |path: &Path, error: &dyn std::fmt::Display| Failure::unreadable(format_args!("{}: {error}", path.display()));
    let certificates = |path: &Path| -> Result<Vec<CertificateDer<'static>>, Failure> {
        let found = CertificateDer::pem_file_iter(path).map_err(|e| wrong(path, &e))?;
        let found: Vec<_> = found.collect::<Result<_, _>>().map_err(|e| wrong(path, &e))?;
        if found.is_empty() {
            return Err(wrong(path, &"a certificate in PEM form was expected, and there is none"));
        }
        Ok(found)
    };
    let mut roots = RootCertStore::empty();
    for one in certificates(authority)? {
        roots.add(one).map_err(|e| wrong(authority, &e))?;
    }
    Ok(Some(Identity {
        chain: certificates(certificate)?,
        key: PrivateKeyDer::from_pem_file(key).map_err(|e| wrong(key, &e))?,
        authority: roots,
    }))
}

fn unusable(link: &LinkFile, error: &dyn std::fmt::Display) -> Failure {
    let path = link
        .certificate
        .as_ref()
        .map(|path| path.display().to_string())
        .unwrap_or_default();
    Failure::unreadable(format_args!("{path} and its key cannot be used: {error}"))
}
