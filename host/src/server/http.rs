//! Requests in, answers out: HTTP on 127.0.0.1, with a bound on everything that a client can make grow.

use std::borrow::Cow;
use std::convert::Infallible;
use std::io;
use std::net::Ipv4Addr;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use http_body_util::{BodyExt, Full, LengthLimitError, Limited};
use hyper::body::{Body, Bytes, Incoming};
use hyper::header::{self, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::timeout;

use super::edit::Edit;
use super::guard::{self, Door, Way};
use super::planner;
use super::session::{Session, Wish};
use super::start::Start;
use crate::report::{self, Edition};
use weldpath_job::run::job::Job;

/// Connections at a time; more are closed at once. A page has two.
const MOST_CONNECTIONS: usize = 64;
/// An edit is a few hundred bytes; an order of all seams of a large part a few thousand.
const MOST_BODY_BYTES: usize = 64 << 10;
/// Lines before the body, together.
const MOST_HEAD_BYTES: usize = 16 << 10;
/// A client on the same machine says what it wants at once.
const HEAD_TIME: Duration = Duration::from_secs(5);
const BODY_TIME: Duration = Duration::from_secs(5);
/// A page that asks what is new is answered after this, though nothing is.
const NEWS_TIME: Duration = Duration::from_secs(20);
/// Longer than any request takes with its answer.
const CONNECTION_TIME: Duration = Duration::from_secs(60);
/// The server ends when no page has asked for news for this long.
const GRACE: Duration = Duration::from_secs(60);
/// How often that is looked at.
const TICK: Duration = Duration::from_secs(1);

/// An edit is drawn when none has followed for this long: a field that is held by its arrow, or an end that is moved by keys,
/// sends some twenty a second.
const QUIET_TIME: Duration = Duration::from_millis(120);

type Answer = Response<Full<Bytes>>;

/// A server that is bound to its port.
struct Server {
    /// What is open; nothing before something is chosen on the start page.
    session: OnceLock<Arc<Session>>,
    start: Option<Start>,
    door: Door,
    /// Pages that wait for news.
    waiting: AtomicUsize,
    /// When the last page has asked; none before the first.
    last_asked: std::sync::Mutex<Option<Instant>>,
}

/// What a page shows first.
pub(super) enum First {
    Session(Arc<Session>),
    Start(Start),
}

/// Answers requests at a port, with 0 at any, until no page is open any more; `announce` is told the address, and another that leads there once.
pub(super) fn serve(first: First, port: u16, announce: impl FnOnce(&str, &str)) -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).await?;
        let door = Door::new(listener.local_addr()?, guard::token()?, guard::token()?);
        announce(&door.address(), &door.ticket_address().unwrap_or_default());
        let (waiting, last_asked) = (AtomicUsize::new(0), std::sync::Mutex::new(None));
        let (session, start) = match first {
            First::Session(session) => (OnceLock::from(session), None),
            First::Start(start) => (OnceLock::new(), Some(start)),
        };
        let server = Arc::new(Server { session, start, door, waiting, last_asked });
        let seats = Arc::new(Semaphore::new(MOST_CONNECTIONS));
        while !server.is_left(Instant::now()) {
            let Ok(accepted) = timeout(TICK, listener.accept()).await else { continue };
            // Of a system that has no descriptors left, one asks again a moment later.
            let Ok((stream, _)) = accepted else {
                tokio::time::sleep(Duration::from_millis(50)).await;
                continue;
            };
            if let Ok(seat) = Arc::clone(&seats).try_acquire_owned() {
                let server = Arc::clone(&server);
                tokio::spawn(async move {
                    // Whatever ends a connection early is the client's own affair.
                    let _ = timeout(CONNECTION_TIME, connection(server, stream)).await;
                    drop(seat);
                });
            }
        }
        Ok(())
    })
}

async fn connection(server: Arc<Server>, stream: TcpStream) -> hyper::Result<()> {
    let service = service_fn(move |request| {
        let server = Arc::clone(&server);
        async move { Ok::<_, Infallible>(server.answer(request).await) }
    });
    http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIME)
        .max_buf_size(MOST_HEAD_BYTES)
        .keep_alive(false)
        .serve_connection(TokioIo::new(stream), service)
        .await
}

impl Server {
    /// Whether a page was open and none is, and nothing would be lost.
    fn is_left(&self, now: Instant) -> bool {
        let last = *self.last_asked.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let quiet = last.is_some_and(|last| now.saturating_duration_since(last) > GRACE);
        let is_at_rest = self.session.get().is_none_or(|session| session.is_at_rest());
        quiet && self.waiting.load(Ordering::SeqCst) == 0 && is_at_rest
    }

    async fn answer(&self, request: Request<Incoming>) -> Answer {
        let (head, body) = request.into_parts();
        let path = match self.door.admit(&head.method, head.uri.path(), &head.headers) {
            Ok(Way::Inside(path)) => path,
            Ok(Way::Ticket) => return onward(&self.door.address()),
            Err((status, words)) => return refusal(status, &words),
        };
        let query = head.uri.query().unwrap_or_default();
        let opened = self.session.get().map(|session| Opened { server: self, session });
        if head.method == Method::GET {
            return match (path.as_str(), opened) {
                ("", Some(opened)) => opened.page(),
                ("content", Some(opened)) => opened.content(),
                ("section", Some(opened)) => opened.section(query),
                ("file", Some(opened)) => opened.file(query),
                ("schema", Some(_)) => json(Job::schema()),
                ("state", Some(opened)) => opened.news(query).await,
                ("", None) => start_page(),
                ("state", None) => self.beginning(query).await,
                _ => refusal(StatusCode::NOT_FOUND, "there is nothing here"),
            };
        }
        match (read(body).await, opened) {
            (Ok(body), Some(opened)) => opened.act(&path, &body),
            (Ok(body), None) if path == "start" => self.begin(&body).await,
            (Ok(_), None) => refusal(StatusCode::NOT_FOUND, "there is nothing here"),
            (Err((status, words)), _) => refusal(status, &words),
        }
    }

    /// What the start page shows; one that knows it waits until something is open.
    async fn beginning(&self, query: &str) -> Answer {
        let _waiting = Waiting::new(self);
        if query.starts_with("known=") {
            let opened = async {
                while self.session.get().is_none() {
                    tokio::time::sleep(QUIET_TIME).await;
                }
            };
            let _ = timeout(NEWS_TIME, opened).await;
        }
        match (self.session.get(), &self.start) {
            (Some(session), _) => json(session.told()),
            (None, Some(start)) => json(start.told()),
            (None, None) => refusal(StatusCode::NOT_FOUND, "there is nothing here"),
        }
    }

    /// Opens what was chosen on the start page, and plans it.
    async fn begin(&self, body: &[u8]) -> Answer {
        let Some(start) = &self.start else {
            return refusal(StatusCode::NOT_FOUND, "there is nothing here");
        };
        let session = match start.open(body).await {
            Ok(session) => session,
            Err((status, words)) => return refusal(status, &words),
        };
        if let Err(error) = planner::start(&session, Wish::Whole) {
            return refusal(StatusCode::SERVICE_UNAVAILABLE, &error.to_string());
        }
        json(self.session.get_or_init(|| session).told())
    }
}

/// What is open, as it answers.
#[derive(Clone, Copy)]
struct Opened<'a> {
    server: &'a Server,
    session: &'a Arc<Session>,
}

impl Opened<'_> {
    /// What the page does with the job.
    fn act(&self, path: &str, body: &[u8]) -> Answer {
        match path {
            "edit" => {
                let edit: Result<Edit, _> = serde_json::from_slice(body);
                let done = edit.map_err(|error| error.to_string()).and_then(|edit| self.session.edit(&edit));
                if let Err(words) = done {
                    return refusal(StatusCode::BAD_REQUEST, &words);
                }
                self.draw_soon();
            }
            "undo" => {
                self.session.undo();
                self.draw_soon();
            }
            "redo" => {
                self.session.redo();
                self.draw_soon();
            }
            "cancel" => self.session.cancel(),
            "plan" => {
                if let Err(error) = planner::start(self.session, Wish::Whole) {
                    return refusal(StatusCode::SERVICE_UNAVAILABLE, &error.to_string());
                }
            }
            _ => return refusal(StatusCode::NOT_FOUND, "there is nothing here"),
        }
        json(self.session.told())
    }

    /// Draws the last edit, if no other comes meanwhile.
    fn draw_soon(&self) {
        let (session, edits) = (Arc::clone(self.session), self.session.edits());
        tokio::spawn(async move {
            tokio::time::sleep(QUIET_TIME).await;
            if session.edits() == edits {
                // Without a thread the edit waits for the next plan, which says so.
                let _ = planner::start(&session, Wish::Kept);
            }
        });
    }

    /// The numbers of the last plan, for a page that has its cloud.
    fn content(&self) -> Answer {
        let numbers = self.session.shown().and_then(|shown| {
            let (Edition { plan, cloud }, content) = (shown.edition, report::numbers(&shown.html)?);
            Some(format!("{{\"plan\":{plan},\"cloud\":{cloud},\"content\":{content}}}"))
        });
        numbers.map_or_else(|| refusal(StatusCode::NOT_FOUND, "nothing is planned yet"), json)
    }

    /// The cross-section of a seam so far along it, as in `seam=2&at_mm=40.5`.
    fn section(&self, query: &str) -> Answer {
        let parts: Option<(&str, &str)> = query
            .split_once('&')
            .and_then(|(a, b)| Some((a.strip_prefix("seam=")?, b.strip_prefix("at_mm=")?)));
        let numbers = parts.and_then(|(seam, at_mm)| Some((seam.parse().ok()?, at_mm.parse::<f64>().ok()?)));
        let Some((seam, at_mm)) = numbers.filter(|(_, at_mm)| at_mm.is_finite()) else {
            return refusal(
                StatusCode::BAD_REQUEST,
                "a section is asked for as in section?seam=2&at_mm=40.5",
            );
        };
        let Some((shown, found)) =
            self.session.shown().and_then(|shown| shown.found.clone().map(|found| (shown, found)))
        else {
            return refusal(StatusCode::NOT_FOUND, "no seam is planned yet");
        };
        match report::section(&found.plan, &shown.paths, seam, at_mm) {
            // Finite numbers only: there is nothing serde_json could refuse.
            Ok(section) => json(serde_json::to_string(&section).unwrap_or_default()),
            Err(words) => refusal(StatusCode::NOT_FOUND, &words),
        }
    }

    /// A file of the last plan, as in `name=path.csv`, to be saved.
    fn file(&self, query: &str) -> Answer {
        let file = query.strip_prefix("name=").and_then(|name| Some((name, self.session.file(name)?)));
        let Some((name, bytes)) = file else {
            return refusal(StatusCode::NOT_FOUND, "the last plan wrote no file of this name");
        };
        let bytes = match bytes {
            Ok(bytes) => bytes,
            Err(error) => return refusal(StatusCode::NOT_FOUND, &format!("{name}: {error}; plan again")),
        };
        let mut answer = answer(StatusCode::OK, "application/octet-stream", bytes);
        if let Ok(saved) = HeaderValue::from_str(&format!("attachment; filename=\"{name}\"")) {
            answer.headers_mut().insert(header::CONTENT_DISPOSITION, saved);
        }
        answer
    }

    /// The report of the last plan with what edits it, or a page that waits for the first.
    fn page(&self) -> Answer {
        let Ok(nonce) = guard::token() else {
            return refusal(StatusCode::SERVICE_UNAVAILABLE, "the system has no randomness to give");
        };
        let page = match self.session.shown() {
            Some(shown) => report::editable(&shown.html, &nonce, shown.edition),
            None => Some(report::waiting(&nonce)),
        };
        let Some(page) = page else {
            return refusal(StatusCode::INTERNAL_SERVER_ERROR, "the report is not a page of weldpath");
        };
        html(page, &nonce)
    }

    /// The state of things, as soon as it is not that of the revision that the page knows.
    async fn news(&self, query: &str) -> Answer {
        let known: Option<u64> = query.strip_prefix("known=").and_then(|known| known.parse().ok());
        let _waiting = Waiting::new(self.server);
        let mut changes = self.session.changes();
        // After a while the page is answered all the same, and asks again: so it is known to be open.
        let _ = timeout(NEWS_TIME, changes.wait_for(|revision| Some(*revision) != known)).await;
        json(self.session.told())
    }
}

/// A page that waits for news; it is counted as long as this lives, and its connection.
struct Waiting<'a>(&'a Server);

impl<'a> Waiting<'a> {
    fn new(server: &'a Server) -> Self {
        server.waiting.fetch_add(1, Ordering::SeqCst);
        Self(server)
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        let mut last = self.0.last_asked.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        *last = Some(Instant::now());
        self.0.waiting.fetch_sub(1, Ordering::SeqCst);
    }
}

/// The whole body, if it is small and comes soon.
async fn read(body: Incoming) -> Result<Bytes, guard::Refusal> {
    let late = (StatusCode::REQUEST_TIMEOUT, Cow::Borrowed("the request is incomplete"));
    let broken = (StatusCode::BAD_REQUEST, Cow::Borrowed("the request broke off"));
    let large = (StatusCode::PAYLOAD_TOO_LARGE, Cow::Borrowed("the request is too large for an edit"));
    if body.size_hint().lower() > MOST_BODY_BYTES as u64 {
        return Err(large);
    }
    match timeout(BODY_TIME, Limited::new(body, MOST_BODY_BYTES).collect()).await {
        Ok(Ok(body)) => Ok(body.to_bytes()),
        Ok(Err(error)) if error.is::<LengthLimitError>() => Err(large),
        Ok(Err(_)) => Err(broken),
        Err(_) => Err(late),
    }
}

fn json(text: String) -> Answer {
    answer(StatusCode::OK, "application/json", text)
}

fn refusal(status: StatusCode, words: &str) -> Answer {
    answer(status, "text/plain; charset=utf-8", words.to_owned())
}

/// The page in which something to open is chosen.
fn start_page() -> Answer {
    match guard::token() {
        Ok(nonce) => html(report::start(&nonce), &nonce),
        Err(_) => refusal(StatusCode::SERVICE_UNAVAILABLE, "the system has no randomness to give"),
    }
}

/// A page whose scripts carry `nonce`.
fn html(page: String, nonce: &str) -> Answer {
    let policy = format!(
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    );
    let mut answer = answer(StatusCode::OK, "text/html; charset=utf-8", page);
    if let Ok(policy) = HeaderValue::from_str(&policy) {
        answer.headers_mut().insert(header::CONTENT_SECURITY_POLICY, policy);
    }
    answer
}

/// To the address that can be loaded again.
fn onward(address: &str) -> Answer {
    let mut answer = answer(StatusCode::SEE_OTHER, "text/plain; charset=utf-8", String::new());
    if let Ok(address) = HeaderValue::from_str(address) {
        answer.headers_mut().insert(header::LOCATION, address);
    }
    answer
}

fn answer(status: StatusCode, kind: &'static str, body: impl Into<Bytes>) -> Answer {
    let mut answer = Response::new(Full::new(body.into()));
    *answer.status_mut() = status;
    let headers = [
        (header::CONTENT_TYPE, kind),
        (header::CACHE_CONTROL, "no-store"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
        (header::HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    ];
    for (name, value) in headers {
        answer.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    answer
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::session::Workplace;

    #[test]
    fn the_server_ends_a_minute_after_the_last_page_and_never_before_the_first_or_amid_a_plan() {
        let session = Session::new(Job::default(), Workplace::default());
        let door = Door::new(([127, 0, 0, 1], 4000).into(), "a".into(), "b".into());
        let server = Server {
            session: OnceLock::from(Arc::clone(&session)),
            start: None,
            door,
            waiting: AtomicUsize::new(0),
            last_asked: std::sync::Mutex::new(None),
        };
        let later = |time: Duration| Instant::now() + time;
        assert!(!server.is_left(later(10 * GRACE)));
        let waiting = Waiting::new(&server);
        assert!(!server.is_left(later(10 * GRACE)));
        drop(waiting);
        assert!(!server.is_left(later(GRACE / 2)) && server.is_left(later(2 * GRACE)));
        let begun = session.begin(Wish::Whole);
        assert!(begun.is_some() && session.begin(Wish::Whole).is_none());
        assert!(!server.is_left(later(2 * GRACE)));
        session.ended(None);
        assert!(server.is_left(later(2 * GRACE)));
    }
}
