//! Whom a message may go to.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs};

/// Bytes of an address at most.
const MOST_BYTES: usize = 2000;

/// Addresses of one name that are tried.
const MOST_TRIED: usize = 4;

/// An `http` or `https` address, taken apart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::serve) struct Target {
    /// Whether it is spoken to by TLS.
    secure: bool,
    host: String,
    port: u16,
    /// Path and query.
    path: String,
}

impl Target {
    /// Takes an address apart.
    ///
    /// # Errors
    /// A sentence that says what is wrong.
    pub(in crate::serve) fn read(url: &str) -> Result<Self, String> {
        let printable = url.bytes().all(|byte| (0x21..0x7f).contains(&byte));
        if url.len() > MOST_BYTES || !printable {
            return Err(format!("an address has up to {MOST_BYTES} printable ASCII characters"));
        }
        let secure = url.starts_with("https://");
        let Some(rest) = url.strip_prefix("https://").or(url.strip_prefix("http://")) else {
            return Err("the address must begin with `https://` or `http://`".to_owned());
        };
        let cut = rest.find(['/', '?', '#']).unwrap_or(rest.len());
        let (authority, path) = rest.split_at(cut);
        if authority.contains('@') || path.contains('#') {
            return Err("an address here has neither user nor fragment".to_owned());
        }
        let (host, port) = match authority.rsplit_once(':') {
            Some((host, port)) if !port.ends_with(']') => {
                (host, port.parse().map_err(|_| format!("`{port}` is no port"))?)
            }
            _ => (authority, if secure { 443 } else { 80 }),
        };
        if host.is_empty() || port == 0 {
            return Err("the address names no host".to_owned());
        }
        let path = if path.starts_with('/') { path.to_owned() } else { format!("/{path}") };
        Ok(Self { secure, host: host.to_owned(), port, path })
    }

    pub(super) fn is_secure(&self) -> bool {
        self.secure
    }

    pub(super) fn host(&self) -> &str {
        &self.host
    }

    /// The host as certificates have it: an address of IPv6 without its brackets.
    pub(super) fn bare_host(&self) -> &str {
        let bare = self.host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
        bare.unwrap_or(&self.host)
    }

    /// The header `Host`.
    pub(super) fn authority(&self) -> String {
        format!("{}:{}", self.host, self.port)
    }

    pub(super) fn path(&self) -> &str {
        &self.path
    }

    /// The host where it is an address already.
    fn literal(&self) -> Option<IpAddr> {
        self.bare_host().parse().ok()
    }

    /// What can be said without a look-up: an address that is written out.
    ///
    /// # Errors
    /// A sentence that says what is wrong.
    pub(in crate::serve) fn check_literal(&self, private: bool) -> Result<(), String> {
        match self.literal() {
            Some(address) if !private && !is_public(address) => Err(refusal(&self.host)),
            _ => Ok(()),
        }
    }

    /// The addresses to connect to, one after another. Where one of a name's addresses is private,
    /// none is taken.
    ///
    /// # Errors
    /// A sentence that says what is wrong.
    pub(super) fn resolve(&self, private: bool) -> Result<Vec<SocketAddr>, String> {
        let mut addresses: Vec<SocketAddr> = match self.literal() {
            Some(address) => vec![SocketAddr::new(address, self.port)],
            None => (self.host.as_str(), self.port)
                .to_socket_addrs()
                .map_err(|error| format!("{}: {error}", self.host))?
                .collect(),
        };
        if !private && addresses.iter().any(|address| !is_public(address.ip())) {
            return Err(refusal(&self.host));
        }
        addresses.truncate(MOST_TRIED);
        match addresses.is_empty() {
            true => Err(format!("{} has no address", self.host)),
            false => Ok(addresses),
        }
    }
}

fn refusal(host: &str) -> String {
    format!("{host} is no public address; the service's setting `webhook-private` would allow it")
}

/// Whether an address is of the public network: none of the special blocks of RFC 6890 and its
/// successors, also where IPv6 only wraps an IPv4 address.
fn is_public(address: IpAddr) -> bool {
    match address {
        IpAddr::V4(address) => is_public_v4(address),
        IpAddr::V6(address) => is_public_v6(address),
    }
}

fn is_public_v4(address: Ipv4Addr) -> bool {
    let [a, b, c, _] = address.octets();
    let shared = a == 100 && (64..128).contains(&b);
    let protocols = a == 192 && b == 0 && c == 0;
    let benchmarks = a == 198 && (b == 18 || b == 19);
    let relays = a == 192 && b == 88 && c == 99;
    !(a == 0
        || a >= 224
        || shared
        || protocols
        || benchmarks
        || relays
        || address.is_private()
        || address.is_loopback()
        || address.is_link_local()
        || address.is_documentation())
}

fn is_public_v6(address: Ipv6Addr) -> bool {
    let segments = address.segments();
    let v4 = |high: u16, low: u16| Ipv4Addr::from((u32::from(high) << 16) | u32::from(low));
    if let Some(mapped) = address.to_ipv4_mapped() {
        return is_public_v4(mapped);
    }
    match segments {
        // NAT64 and 6to4.
        [0x64, 0xff9b, 0, 0, 0, 0, high, low] => is_public_v4(v4(high, low)),
        [0x2002, high, low, ..] => is_public_v4(v4(high, low)),
        // Teredo, benchmarks and other protocols; documentation.
        [0x2001, second, ..] if second < 0x200 || second == 0xdb8 => false,
        [0x3fff, second, ..] if second < 0x1000 => false,
        // All that is given out is 2000::/3.
        [first, ..] => first & 0xe000 == 0x2000,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Addresses of machines behind the service's own door are told from public ones, in all their
    /// disguises.
    #[test]
    fn private_addresses_are_known() {
        for public in
            ["8.8.8.8", "93.184.215.14", "100.128.0.1", "2606:4700::1111", "64:ff9b::808:808"]
        {
            assert!(is_public(public.parse().unwrap()), "{public}");
        }
        for private in [
            "127.0.0.1",
            "10.1.2.3",
            "172.16.0.1",
            "192.168.1.1",
            "169.254.169.254",
            "0.0.0.0",
            "100.64.0.1",
            "198.18.0.1",
            "192.0.0.8",
            "224.0.0.1",
            "255.255.255.255",
            "240.0.0.1",
            "::1",
            "::",
            "fe80::1",
            "fc00::1",
            "fd12::1",
            "ff02::1",
            "::ffff:127.0.0.1",
            "::ffff:10.0.0.1",
            "64:ff9b::7f00:1",
            "2002:7f00:1::",
            "2001:db8::1",
            "2001::1",
        ] {
            assert!(!is_public(private.parse().unwrap()), "{private}");
        }
    }

    /// Addresses are taken apart; what could be read in two ways is refused.
    #[test]
    fn targets_are_read() {
        let read = |url: &str| Target::read(url).map(|t| (t.host, t.port, t.path));
        let secure = Target::read("https://[2001:db8::1]/x").expect("sound");
        assert!(secure.is_secure() && secure.port == 443 && secure.bare_host() == "2001:db8::1");
        assert!(Target::read("https://a:8443").is_ok_and(|t| t.port == 8443));
        assert_eq!(read("http://a.example"), Ok(("a.example".into(), 80, "/".into())));
        assert_eq!(read("http://a:81/x?y=1"), Ok(("a".into(), 81, "/x?y=1".into())));
        assert_eq!(read("http://[::1]:5?q"), Ok(("[::1]".into(), 5, "/?q".into())));
        for bad in [
            "https://",
            "https://u@a.example/",
            "HTTPS://a.example/",
            "ftp://a",
            "http://",
            "http://a:b/",
            "http://a:0/",
            "http://:80/",
            "http://u@a/",
            "http://a/#f",
            "http://a/\r\nX: y",
            "http://a b/",
            "http://a:99999/",
            "",
        ] {
            assert!(Target::read(bad).is_err(), "{bad}");
        }
    }

    /// A private address is refused where it is written, and where a name leads to it.
    #[test]
    fn private_targets_are_refused() {
        for url in ["http://127.0.0.1:1/", "http://[::ffff:10.0.0.1]/"] {
            let target = Target::read(url).unwrap();
            assert!(target.check_literal(false).is_err() && target.check_literal(true).is_ok());
            assert!(target.resolve(false).is_err() && target.resolve(true).is_ok());
        }
        let local = Target::read("http://localhost:7/").unwrap();
        assert!(local.check_literal(false).is_ok(), "a name is looked up only when it is needed");
        assert!(local.resolve(false).is_err());
        // Forms that only some parsers read as an address are looked up as names, and refused then.
        for odd in ["http://0x7f000001/", "http://2130706433/", "http://127.1/"] {
            assert!(Target::read(odd).unwrap().resolve(false).is_err(), "{odd}");
        }
    }
}
