use std::net::{Ipv4Addr, SocketAddr};

use anyhow::{Context, ensure};
use tokio::net::TcpListener;

/// Where the server listens unless told.
const USUAL_PORT: u16 = 7070;

/// Ports tried after the usual one.
const MORE_PORTS: u16 = 100;

/// Anyone who reaches the port can queue work and read results, so beyond this machine a token is
/// a must.
pub fn refuse_unguarded(asked: Option<SocketAddr>, token: Option<&str>) -> anyhow::Result<()> {
    let Some(address) = asked else { return Ok(()) };
    ensure!(
        address.ip().is_loopback() || token.is_some(),
        "listening on {address}, which other machines can reach, needs a token: give --token or \
         TORQUED_TOKEN, or listen on 127.0.0.1"
    );
    Ok(())
}

/// Listens where asked; unless asked, on the usual port or the next free one.
pub async fn bind(asked: Option<SocketAddr>) -> anyhow::Result<TcpListener> {
    if let Some(address) = asked {
        return TcpListener::bind(address)
            .await
            .with_context(|| format!("cannot listen on {address}"));
    }
    let mut result = Err(std::io::ErrorKind::AddrInUse.into());
    for port in USUAL_PORT..=USUAL_PORT + MORE_PORTS {
        result = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).await;
        match &result {
            Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => {}
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beyond_this_machine_a_token_is_needed() {
        let open: SocketAddr = "0.0.0.0:7070".parse().unwrap();
        let local: SocketAddr = "127.0.0.1:7070".parse().unwrap();
        assert!(refuse_unguarded(Some(open), None).is_err());
        assert!(refuse_unguarded(Some(open), Some("secret")).is_ok());
        assert!(refuse_unguarded(Some(local), None).is_ok());
        assert!(refuse_unguarded(None, None).is_ok());
    }
}
