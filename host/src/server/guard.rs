//! Who may talk to the server: whoever knows the token, and among web pages only the server's own.
//!
//! Another page in the same browser can send requests to 127.0.0.1, too. It does not know the token; a browser names the
//! page's origin with each request that changes something; and a name of its own that it lets lead to 127.0.0.1 (DNS
//! rebinding) stands in `Host`.

use std::borrow::Cow;
use std::net::SocketAddr;

use hyper::header::{CONTENT_TYPE, HOST, HeaderMap, HeaderName, ORIGIN};
use hyper::{Method, StatusCode};

/// Bytes of the token, from the system's source of randomness.
const TOKEN_BYTES: usize = 16;

/// A random word of hexadecimal digits, for addresses and for scripts.
///
/// # Errors
/// If the system has no randomness to give.
pub(super) fn token() -> std::io::Result<String> {
    let mut bytes = [0_u8; TOKEN_BYTES];
    getrandom::fill(&mut bytes).map_err(std::io::Error::other)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Why a request is not answered.
pub(super) type Refusal = (StatusCode, Cow<'static, str>);

/// The door of one server.
#[derive(Debug)]
pub(super) struct Door {
    hosts: [String; 2],
    token: String,
    /// Lets in once, and then no more: it stands in the arguments of the browser, which other users of the machine can read.
    ticket: std::sync::Mutex<Option<String>>,
}

/// Where a request that is let in leads.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Way {
    /// What stands behind the token, without parameters.
    Inside(String),
    /// The ticket was shown: on to the token.
    Ticket,
}

impl Door {
    pub(super) fn new(address: SocketAddr, token: String, ticket: String) -> Self {
        let hosts = [address.to_string(), format!("localhost:{}", address.port())];
        Self { hosts, token, ticket: std::sync::Mutex::new(Some(ticket)) }
    }

    /// The address of what is behind the door.
    pub(super) fn address(&self) -> String {
        format!("http://{}/{}/", self.hosts[0], self.token)
    }

    /// The address that leads there once.
    pub(super) fn ticket_address(&self) -> Option<String> {
        let ticket = self.ticket.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        ticket.as_ref().map(|ticket| format!("http://{}/{ticket}/", self.hosts[0]))
    }

    /// Whether a request may come in, and where to.
    pub(super) fn admit(&self, method: &Method, path: &str, headers: &HeaderMap) -> Result<Way, Refusal> {
        let named = |name: HeaderName| headers.get(name).and_then(|value| value.to_str().ok());
        let host = named(HOST).filter(|host| self.hosts.iter().any(|own| own == host));
        let Some(host) = host else {
            return Err((StatusCode::MISDIRECTED_REQUEST, self.elsewhere().into()));
        };
        let own = format!("http://{host}");
        let foreign = headers.contains_key(ORIGIN) && named(ORIGIN) != Some(&own);
        let site = named(HeaderName::from_static("sec-fetch-site"));
        if foreign || site.is_some_and(|site| method != Method::GET && site != "same-origin") {
            return Err((StatusCode::FORBIDDEN, "another page may not talk to this server".into()));
        }
        let way = self.way(path)?;
        match *method {
            Method::GET => Ok(way),
            Method::POST if named(ORIGIN) != Some(&own) => {
                Err((StatusCode::FORBIDDEN, "only the page itself may change anything".into()))
            }
            Method::POST if named(CONTENT_TYPE) != Some("application/json") => {
                Err((StatusCode::UNSUPPORTED_MEDIA_TYPE, "an edit is JSON".into()))
            }
            Method::POST => Ok(way),
            _ => Err((StatusCode::METHOD_NOT_ALLOWED, "GET or POST".into())),
        }
    }

    fn way(&self, path: &str) -> Result<Way, Refusal> {
        let no_token = || {
            let words = "the address lacks its token: take the one that the command has printed";
            (StatusCode::FORBIDDEN, words.into())
        };
        let (token, rest) =
            path.strip_prefix('/').and_then(|path| path.split_once('/')).ok_or_else(no_token)?;
        if same(token, &self.token) {
            return Ok(Way::Inside(rest.to_owned()));
        }
        let mut ticket = self.ticket.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if ticket.as_ref().is_some_and(|ticket| same(token, ticket)) {
            *ticket = None;
            return Ok(Way::Ticket);
        }
        Err(no_token())
    }

    /// For who asks by another name or another port, as through a tunnel of SSH.
    fn elsewhere(&self) -> String {
        let own = &self.hosts[0];
        let port = own.rsplit(':').next().unwrap_or_default();
        format!(
            "this server is {own} and nothing else: through SSH, forward the same port (ssh -L {port}:{own} and the machine's \
             name), and open the address that the command has printed"
        )
    }
}

/// Whether two words are the same, in a time that does not tell how far they agree.
fn same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "0123456789abcdef0123456789abcdef";

    fn door() -> Door {
        Door::new("127.0.0.1:4000".parse().unwrap(), TOKEN.into(), "f".repeat(32))
    }

    fn headers(given: &[(&'static str, &str)]) -> HeaderMap {
        given.iter().map(|(name, value)| (HeaderName::from_static(name), value.parse().unwrap())).collect()
    }

    fn get(path: &str, given: &[(&'static str, &str)]) -> Result<Way, StatusCode> {
        door().admit(&Method::GET, path, &headers(given)).map_err(|(status, _)| status)
    }

    fn post(given: &[(&'static str, &str)]) -> Result<Way, StatusCode> {
        door().admit(&Method::POST, &format!("/{TOKEN}/edit"), &headers(given)).map_err(|(status, _)| status)
    }

    const HERE: (&str, &str) = ("host", "127.0.0.1:4000");
    const OWN: (&str, &str) = ("origin", "http://127.0.0.1:4000");
    const JSON: (&str, &str) = ("content-type", "application/json");

    #[test]
    fn the_token_lets_in_and_nothing_like_it_does() {
        let inside = Way::Inside("state".into());
        assert_eq!(get(&format!("/{TOKEN}/state"), &[HERE]), Ok(inside));
        assert_eq!(
            get(&format!("/{TOKEN}/state"), &[("host", "localhost:4000")]),
            Ok(Way::Inside("state".into()))
        );
        let (short, upper) = (&TOKEN[..31], TOKEN.to_uppercase());
        for path in
            ["/", "", "//", "/state", &format!("/{short}/state"), &format!("/{upper}/"), &format!("/{TOKEN}")]
        {
            assert_eq!(get(path, &[HERE]), Err(StatusCode::FORBIDDEN), "{path}");
        }
    }

    #[test]
    fn another_host_is_refused_whatever_it_knows() {
        let path = format!("/{TOKEN}/");
        for host in ["evil.example:4000", "127.0.0.1", "127.0.0.1:4001", "localhost.evil.example:4000", ""] {
            assert_eq!(get(&path, &[("host", host)]), Err(StatusCode::MISDIRECTED_REQUEST), "{host}");
        }
        assert_eq!(get(&path, &[]), Err(StatusCode::MISDIRECTED_REQUEST));
        let tunnelled = door().admit(&Method::GET, &path, &headers(&[("host", "localhost:9999")]));
        let words = tunnelled.map_err(|(_, words)| words).unwrap_err();
        assert!(words.contains("ssh -L 4000:127.0.0.1:4000"), "{words}");
    }

    #[test]
    fn only_the_own_page_changes_anything() {
        assert_eq!(post(&[HERE, OWN, JSON]), Ok(Way::Inside("edit".into())));
        assert_eq!(post(&[HERE, JSON]), Err(StatusCode::FORBIDDEN));
        for origin in ["null", "http://evil.example", "https://127.0.0.1:4000", "http://localhost:4000"] {
            assert_eq!(post(&[HERE, JSON, ("origin", origin)]), Err(StatusCode::FORBIDDEN), "{origin}");
            assert_eq!(
                get(&format!("/{TOKEN}/"), &[HERE, ("origin", origin)]),
                Err(StatusCode::FORBIDDEN),
                "{origin}"
            );
        }
        assert_eq!(post(&[HERE, OWN, JSON, ("sec-fetch-site", "cross-site")]), Err(StatusCode::FORBIDDEN));
        assert_eq!(
            post(&[HERE, OWN, ("content-type", "text/plain")]),
            Err(StatusCode::UNSUPPORTED_MEDIA_TYPE)
        );
        let put = door().admit(&Method::PUT, &format!("/{TOKEN}/edit"), &headers(&[HERE, OWN, JSON]));
        assert_eq!(put.map_err(|(status, _)| status), Err(StatusCode::METHOD_NOT_ALLOWED));
    }

    #[test]
    fn a_ticket_lets_in_once() {
        let (door, path) = (door(), format!("/{}/", "f".repeat(32)));
        let show = || door.admit(&Method::GET, &path, &headers(&[HERE])).map_err(|(status, _)| status);
        assert_eq!((show(), show()), (Ok(Way::Ticket), Err(StatusCode::FORBIDDEN)));
        assert_eq!(door.ticket_address(), None);
        assert!(door.address().ends_with(&format!("/{TOKEN}/")));
    }

    #[test]
    fn tokens_differ_and_are_long() {
        let (a, b) = (token().unwrap(), token().unwrap());
        assert!(a != b && a.len() == 32 && a.bytes().all(|byte| byte.is_ascii_hexdigit()));
    }
}
