//! The address of the server: a TCP port, or a socket in the file system.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr};
use std::os::unix::fs::{FileTypeExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, bail, ensure};
use tokio::net::{TcpListener, UnixListener, UnixStream};

use crate::client::UNIX;

/// The default port of a server.
const USUAL_PORT: u16 = 7070;

/// Number of ports that are tried after the default one.
const MORE_PORTS: u16 = 100;

/// An address to listen on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    Tcp(SocketAddr),
    /// A socket in the file system, which only the user of this process can open.
    Unix(PathBuf),
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(path) = text.strip_prefix(UNIX) {
            return match path {
                "" => Err("expected a file after unix:".to_owned()),
                path => Ok(Self::Unix(path.into())),
            };
        }
        let address = text.parse();
        address.map(Self::Tcp).map_err(|_| "expected ADDRESS:PORT or unix:PATH".to_owned())
    }
}

/// A listener, and its address for clients. A socket's file is deleted with it.
pub struct Bound {
    pub listener: api::Listener,
    pub url: String,
    pub file: Option<SocketFile>,
}

/// The file of a socket, which is deleted when this is dropped.
pub struct SocketFile(PathBuf);

impl Drop for SocketFile {
    fn drop(&mut self) {
        // Somebody may have deleted it already.
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Refuses an address that other machines can reach without a token. Anybody who reaches the port
/// could queue work and read results.
pub fn refuse_unguarded(asked: Option<&Address>, has_token: bool) -> anyhow::Result<()> {
    let Some(Address::Tcp(address)) = asked else { return Ok(()) };
    ensure!(
        address.ip().is_loopback() || has_token,
        "other machines can reach {address}, so the server needs a token: create one with `torqued \
         token create NAME --scope admin --directly`, set TORQUED_TOKEN, which must not be empty, \
         or listen on 127.0.0.1"
    );
    Ok(())
}

/// Listens on the given address. By default, listens on the usual port or the next free one.
pub async fn bind(asked: Option<&Address>) -> anyhow::Result<Bound> {
    let listener = match asked {
        Some(Address::Unix(path)) => return bind_socket(path).await,
        Some(Address::Tcp(address)) => TcpListener::bind(address)
            .await
            .with_context(|| format!("cannot listen on {address}"))?,
        None => bind_a_free_port().await?,
    };
    let address = listener.local_addr().context("cannot find the address of the listener")?;
    Ok(Bound { listener: listener.into(), url: format!("http://{address}"), file: None })
}

async fn bind_a_free_port() -> anyhow::Result<TcpListener> {
    let mut result = Err(ErrorKind::AddrInUse.into());
    for port in USUAL_PORT..=USUAL_PORT + MORE_PORTS {
        result = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).await;
        match &result {
            Err(error) if error.kind() == ErrorKind::AddrInUse => {}
            Ok(_) if port != USUAL_PORT => {
                eprintln!("port {USUAL_PORT} is taken, using {port}");
                break;
            }
            _ => break,
        }
    }
    result.with_context(|| {
        format!("cannot listen on 127.0.0.1, ports {USUAL_PORT} to {}", USUAL_PORT + MORE_PORTS)
    })
}

/// Listens on a socket that only this user can open. Replaces the file of a killed server.
async fn bind_socket(path: &Path) -> anyhow::Result<Bound> {
    let shown = path.display();
    match std::fs::symlink_metadata(path) {
        Ok(there) if !there.file_type().is_socket() => {
            bail!("cannot listen on unix:{shown}: the file exists and is not a socket")
        }
        Ok(_) if UnixStream::connect(path).await.is_ok() => {
            bail!("cannot listen on unix:{shown}: another server listens there")
        }
        _ => {}
    }
    let cannot = || format!("cannot listen on unix:{shown}");
    // Nobody finds the socket before its mode is set.
    let mut new = path.as_os_str().to_owned();
    new.push(".new");
    let new = PathBuf::from(new);
    let _ = std::fs::remove_file(&new);
    let listener = UnixListener::bind(&new).with_context(cannot)?;
    std::fs::set_permissions(&new, std::fs::Permissions::from_mode(0o600)).with_context(cannot)?;
    std::fs::rename(&new, path).with_context(cannot)?;
    let file = SocketFile(path.to_owned());
    let absolute = std::path::absolute(path).with_context(cannot)?;
    let url = format!("{UNIX}{}", absolute.display());
    Ok(Bound { listener: listener.into(), url, file: Some(file) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beyond_this_machine_a_token_is_needed() {
        let address = |text: &str| text.parse::<Address>().unwrap();
        let (open, local) = (address("0.0.0.0:7070"), address("127.0.0.1:7070"));
        assert!(refuse_unguarded(Some(&open), false).is_err());
        assert!(refuse_unguarded(Some(&open), true).is_ok());
        assert!(refuse_unguarded(Some(&local), false).is_ok());
        assert!(refuse_unguarded(Some(&address("unix:/run/torqued")), false).is_ok());
        assert!(refuse_unguarded(None, false).is_ok());
    }

    #[test]
    fn an_address_is_a_port_or_a_file() {
        assert_eq!("unix:/run/torqued".parse(), Ok(Address::Unix("/run/torqued".into())));
        assert!(matches!("[::1]:80".parse(), Ok(Address::Tcp(_))));
        for wrong in ["", "unix:", "7070", "localhost:7070", "/run/torqued"] {
            assert!(wrong.parse::<Address>().is_err(), "{wrong}");
        }
    }

    #[tokio::test]
    async fn a_socket_is_for_its_owner_and_takes_the_place_of_a_dead_one_only() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("torqued");
        // The file that a killed server leaves.
        drop(std::os::unix::net::UnixListener::bind(&path).unwrap());
        let address = Address::Unix(path.clone());
        let bound = bind(Some(&address)).await.unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
        let refused = bind(Some(&address)).await.err().unwrap().to_string();
        assert!(refused.ends_with("another server listens there"), "{refused}");
        drop(bound);
        assert!(!path.exists());
        std::fs::write(&path, "precious").unwrap();
        let refused = bind(Some(&address)).await.err().unwrap().to_string();
        assert!(refused.ends_with("the file exists and is not a socket"), "{refused}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
    }
}
