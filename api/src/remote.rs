//! The client of a request: the other end of its connection, or the client that a trusted proxy
//! names.

use std::net::{IpAddr, Ipv6Addr};
use std::str::FromStr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName};
use axum::middleware::Next;
use axum::response::Response;
use ipnet::IpNet;

use crate::connections::Peer;

/// Every proxy adds the address that it got the request from to the end of this list.
const FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");

/// The word for clients of the server's socket.
const SOCKET: &str = "unix";

/// A proxy that names its clients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrustedProxy {
    /// Every machine of a network.
    Network(IpNet),
    /// Everybody who may open the server's socket.
    Socket,
}

impl FromStr for TrustedProxy {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == SOCKET {
            return Ok(Self::Socket);
        }
        let network = text.parse().or_else(|_| text.parse::<IpAddr>().map(IpNet::from));
        network.map(Self::Network).map_err(|_| {
            "expected an address such as 10.0.0.7, a network such as 10.0.0.0/24, or unix"
                .to_owned()
        })
    }
}

/// The proxies that this server believes.
#[derive(Clone, Debug, Default)]
pub struct TrustedProxies(Arc<[TrustedProxy]>);

impl TrustedProxies {
    pub fn new(proxies: &[TrustedProxy]) -> Self {
        Self(proxies.into())
    }

    fn trust(&self, peer: Option<IpAddr>) -> bool {
        self.0.iter().any(|proxy| match (proxy, peer) {
            (TrustedProxy::Network(network), Some(address)) => network.contains(&address),
            (TrustedProxy::Socket, None) => true,
            (TrustedProxy::Network(_), None) | (TrustedProxy::Socket, Some(_)) => false,
        })
    }

    /// The network that a connection takes its place from. `None` if many clients have its address.
    pub fn network(&self, peer: Option<IpAddr>) -> Option<IpAddr> {
        let address = peer.filter(|address| !address.is_loopback());
        address.filter(|_| !self.trust(peer)).map(network)
    }
}

/// The client of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Remote {
    /// Its address; `None` if it came over the server's socket and no proxy names it.
    pub address: Option<IpAddr>,
    /// Whether many clients have this address: programs of this machine, or clients of a proxy that
    /// does not name them.
    is_many: bool,
}

impl Remote {
    fn new(peer: Option<IpAddr>, headers: &HeaderMap, proxies: &TrustedProxies) -> Self {
        let is_proxy = proxies.trust(peer);
        if let Some(address) = forwarded_for(headers, proxies).filter(|_| is_proxy) {
            return Self { address: Some(address), is_many: false };
        }
        let is_many = is_proxy || peer.is_none_or(|address| address.is_loopback());
        Self { address: peer, is_many }
    }

    /// The client of a request, as [`identify`] found it.
    pub fn of(request: &Request) -> Self {
        let known = request.extensions().get::<Self>().copied();
        known.unwrap_or(Self { address: None, is_many: true })
    }

    /// The network that has a share of the server's places. `None` if many clients have the
    /// address.
    pub fn network(&self) -> Option<IpAddr> {
        self.address.filter(|_| !self.is_many).map(network)
    }

    /// The address for people.
    pub fn name(&self) -> String {
        self.address.map_or("socket".to_owned(), |address| address.to_string())
    }
}

/// The last client in the list that is not itself a trusted proxy. Clients can write anything into
/// the entries before it.
fn forwarded_for(headers: &HeaderMap, proxies: &TrustedProxies) -> Option<IpAddr> {
    let lines = headers.get_all(FORWARDED_FOR).iter().rev();
    let entries = lines.flat_map(|line| line.to_str().unwrap_or_default().rsplit(','));
    for entry in entries {
        let address = address(entry.trim())?;
        if !proxies.trust(Some(address)) {
            return Some(address);
        }
    }
    None
}

/// An address, which some proxies write with a port or in brackets.
fn address(entry: &str) -> Option<IpAddr> {
    let with_port = || entry.parse().ok().map(|address: std::net::SocketAddr| address.ip());
    let in_brackets = || entry.strip_prefix('[')?.strip_suffix(']')?.parse().ok();
    let address = entry.parse().ok().or_else(with_port).or_else(in_brackets);
    address.map(|address: IpAddr| address.to_canonical())
}

/// The address itself for version 4. For version 6 its network, because one machine has all
/// addresses of a network.
pub fn network(address: IpAddr) -> IpAddr {
    match address {
        IpAddr::V4(_) => address,
        IpAddr::V6(address) => {
            let [a, b, c, d, ..] = address.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
    }
}

/// Finds out who sent a request.
pub async fn identify(
    State(proxies): State<TrustedProxies>,
    mut request: Request,
    next: Next,
) -> Response {
    let peer = request.extensions().get::<Peer>().map(|Peer(address)| *address);
    let remote = Remote::new(peer, request.headers(), &proxies);
    request.extensions_mut().insert(remote);
    next.run(request).await
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    fn proxies(words: &[&str]) -> TrustedProxies {
        let proxies: Vec<_> = words.iter().map(|word| word.parse().unwrap()).collect();
        TrustedProxies::new(&proxies)
    }

    fn remote(peer: Option<&str>, forwarded: &[&str], proxies: &TrustedProxies) -> Remote {
        let headers = forwarded.iter().map(|line| (FORWARDED_FOR, line.parse().unwrap())).collect();
        Remote::new(peer.map(ip), &headers, proxies)
    }

    #[test]
    fn only_a_trusted_proxy_names_its_clients() {
        let (none, proxy) = (proxies(&[]), proxies(&["127.0.0.1", "10.1.0.0/16", "unix"]));
        assert_eq!(remote(Some("127.0.0.1"), &["203.0.113.7"], &none).network(), None);
        assert_eq!(
            remote(Some("192.0.2.1"), &["203.0.113.7"], &proxy).address,
            Some(ip("192.0.2.1"))
        );
        for peer in [Some("127.0.0.1"), Some("10.1.2.3"), None] {
            let named = remote(peer, &["203.0.113.7"], &proxy);
            assert_eq!(named.network(), Some(ip("203.0.113.7")), "{peer:?}");
            assert_eq!(remote(peer, &[], &proxy).network(), None, "{peer:?}");
        }
        assert_eq!(remote(None, &[], &none).name(), "socket");
    }

    #[test]
    fn the_last_entry_that_no_trusted_proxy_wrote_about_itself_is_the_client() {
        let proxies = proxies(&["127.0.0.1", "10.1.0.0/16"]);
        let of = |lines: &[&str]| remote(Some("127.0.0.1"), lines, &proxies).address;
        assert_eq!(of(&["1.1.1.1, 203.0.113.7"]), Some(ip("203.0.113.7")));
        assert_eq!(of(&["1.1.1.1, 203.0.113.7, 10.1.0.9"]), Some(ip("203.0.113.7")));
        assert_eq!(of(&["1.1.1.1", "203.0.113.7:4711"]), Some(ip("203.0.113.7")));
        assert_eq!(of(&["[2001:db8::7]"]), Some(ip("2001:db8::7")));
        assert_eq!(of(&["::ffff:203.0.113.7"]), Some(ip("203.0.113.7")));
        // An entry that is no address hides those before it, because nobody knows who wrote them.
        for unreadable in ["1.1.1.1, x", "1.1.1.1, ", ""] {
            assert_eq!(of(&[unreadable]), Some(ip("127.0.0.1")), "{unreadable}");
        }
    }

    #[test]
    fn an_address_has_a_share_unless_many_clients_have_it() {
        let proxies = proxies(&["10.1.0.0/16"]);
        let network = |peer: &str| proxies.network(Some(ip(peer)));
        assert_eq!(network("192.0.2.1"), Some(ip("192.0.2.1")));
        assert_eq!(network("10.1.2.3"), None);
        assert_eq!(network("127.0.0.1"), None);
        assert_eq!(proxies.network(None), None);
    }

    #[test]
    fn a_network_of_version_6_is_one_machine() {
        let of = |text: &str| network(ip(text));
        assert_eq!(of("2001:db8:1:2:3:4:5:6"), of("2001:db8:1:2::9"));
        assert_ne!(of("2001:db8:1:2::9"), of("2001:db8:1:3::9"));
        assert_ne!(of("10.0.0.1"), of("10.0.0.2"));
    }

    #[test]
    fn a_proxy_is_an_address_a_network_or_the_socket() {
        for word in ["127.0.0.1", "::1", "10.0.0.0/8", "2001:db8::/32", "unix"] {
            assert!(word.parse::<TrustedProxy>().is_ok(), "{word}");
        }
        for word in ["", "localhost", "10.0.0.0/33", "unix:/run/x", "*"] {
            assert!(word.parse::<TrustedProxy>().is_err(), "{word}");
        }
    }
}
