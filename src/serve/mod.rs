//! Rank 15. The service: assets, jobs, models and evaluation over HTTP, in one process with an
//! embedded store.
//!
//! The contract is `/openapi.json`. A request is checked whole before it is answered: what stops a
//! job from starting is refused at once. What is answered with 202 is on disk, and survives the
//! process. Jobs run on compute threads outside of tokio, and only by way of `pipeline/`.
//!
//! *Invariant:* a job accepted is known after any crash; its bake goes on from the last block that
//! was committed, and nothing half written is ever served.
//! *Invariant:* everything that comes from outside is bounded ([`Limits`]).

mod answer;
mod assets;
mod broken;
mod bundle;
mod connections;
mod disk;
mod docs;
mod evaluate;
mod events;
mod faults;
mod few;
mod files;
mod gloss;
mod grpc;
mod guard;
mod health;
mod held;
mod hot;
mod jobs;
mod lights;
mod memory;
mod metrics;
mod models;
mod origins;
mod page;
mod poses;
mod prepare;
mod priority;
mod problem;
mod rates;
mod recorder;
mod refined;
mod request;
mod results;
mod retention;
mod room;
mod router;
mod runner;
mod scenes;
mod stages;
mod stalled;
mod store;
mod trials;
mod values;
mod webhooks;
mod words;

use std::collections::BTreeSet;
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::sync::{Semaphore, watch};

pub use store::{Error as StoreError, NewToken, Store, Token};
pub use webhooks::{Authorities, BadAuthorities, BadSecret, Secret};

use held::Shared;
use hot::Hot;
use metrics::Metrics;
use rates::Rates;
use room::Room;
use runner::Runner;

/// How the service runs.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Where everything is kept.
    pub folder: PathBuf,
    /// Where to listen. Default 127.0.0.1:7878.
    pub address: SocketAddr,
    /// What is bounded.
    pub limits: Limits,
    /// How those are told who asked to be told of a job's end.
    pub webhooks: Webhooks,
    /// Origins, such as `https://tools.example`, whose pages may ask. Default none.
    pub origins: Vec<String>,
}

/// How those are told who asked to be told of a job's end.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Webhooks {
    /// What messages are signed with; without it none are sent.
    pub secret: Option<Secret>,
    /// Whether messages may go to addresses that are not public. Default false.
    pub private: bool,
    /// Who may vouch for receivers by `https` beside the public authorities. Default nobody.
    pub authorities: Authorities,
}

/// Upper bounds of what comes from outside. A request beyond one is refused with the limit's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of one asset. Default 512 MiB, which is what the importer reads.
    pub asset_bytes: u64,
    /// Bytes of all assets. Default 64 GiB.
    pub assets_bytes: u64,
    /// Bytes of a JSON body. Default 16 MiB.
    pub body_bytes: u64,
    /// Jobs that wait. Default 1000.
    pub queued_jobs: u32,
    /// Jobs that run at once; each uses all compute threads. Default 1.
    pub running_jobs: u32,
    /// Connections. Default 16384.
    pub connections: u32,
    /// Seconds for the head of a request. Default 10.
    pub head_s: u32,
    /// Seconds that an upload may pause, and that a client may take nothing; ten times that a
    /// connection of HTTP/2 may ask for nothing. Default 30.
    pub idle_s: u32,
    /// Seconds for a whole request; uploads, downloads and events have no such limit, nor has the
    /// import of a job's scene. Default 60.
    pub request_s: u32,
    /// Bytes of one evaluation's values as f32, which are held while the answer is written, part by
    /// part; of all at once four times that. Default 256 MiB.
    pub answer_bytes: u64,
    /// Bytes of models that are kept ready to be evaluated. Default 1 GiB.
    pub hot_bytes: u64,
    /// Bytes of memory that jobs may take together; what the machine has, where absent.
    pub memory_bytes: Option<u64>,
    /// Requests a second of each token; unbounded where absent.
    pub rate_hz: Option<u32>,
    /// Days that ended jobs and unused assets are kept; for ever where absent.
    pub keep_days: Option<u32>,
    /// Bytes of data sets that are kept, the latest; all where absent.
    pub keep_bytes: Option<u64>,
    /// Seconds without progress after which a running job is called stalled. Default 300.
    pub stalled_s: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            asset_bytes: 512 << 20,
            assets_bytes: 64 << 30,
            body_bytes: 16 << 20,
            queued_jobs: 1000,
            running_jobs: 1,
            connections: 16_384,
            head_s: 10,
            idle_s: 30,
            request_s: 60,
            answer_bytes: 256 << 20,
            hot_bytes: 1 << 30,
            memory_bytes: None,
            rate_hz: None,
            keep_days: None,
            keep_bytes: None,
            stalled_s: 300,
        }
    }
}

/// Why the service does not run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Its store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The address.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// Which.
        address: SocketAddr,
        /// Why.
        source: std::io::Error,
    },
    /// Open to the network without any token.
    #[error(
        "{0} can be reached from other machines, and there is no token yet: make one with \
         `poselight token create`, or listen on 127.0.0.1"
    )]
    Open(SocketAddr),
    /// The runtime.
    #[error("could not start the service's threads: {0}")]
    Threads(std::io::Error),
}

/// Everything that a request may need.
#[derive(Debug)]
struct Service {
    settings: Settings,
    store: Store,
    runner: Runner,
    hot: Hot,
    metrics: Metrics,
    rates: Rates,
    /// Idempotency keys whose first request is being handled.
    keys: Mutex<BTreeSet<(String, String)>>,
    /// Scenes that are imported at once.
    imports: Arc<Semaphore>,
    /// Values of answers that are on their way.
    answers: Shared,
    /// Bodies that are being dealt with.
    bodies: Shared,
    /// Bytes of assets that are on their way.
    room: Arc<Room>,
    /// Turns true once, when the service is to end.
    stopping: watch::Receiver<bool>,
    /// Whether requests need a token.
    guarded: bool,
}

/// How long open connections may take to end.
const FAREWELL: Duration = Duration::from_secs(10);

/// How often the flag to stop is looked at.
const GLANCE: Duration = Duration::from_millis(50);

/// Scenes that are imported at once: an import may take gigabytes.
const IMPORTS: usize = 2;

/// Between two looks whether a disk that was broken is mended.
const MENDED: Duration = Duration::from_secs(2);

/// Lets this process open as many files as the system lets it: every connection is one.
fn raise_open_files() {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
        let raised = Rlimit { current: maximum, maximum };
        if let Err(error) = setrlimit(Resource::Nofile, raised) {
            tracing::debug!(%error, "the limit of open files stays");
        }
    }
}

/// Serves until `stop` is set. `ready` is told the address, which matters where port 0 was asked
/// for.
///
/// Streams of events end when the service does; a running job stops at its next block of work and
/// continues at the next start. Where disk or database do not let it work, the service lives, says
/// so, and begins when they do.
///
/// # Errors
/// [`Error`]: a folder that is served already, an address that is taken, no token on an open one.
pub fn serve(
    settings: Settings,
    stop: &'static AtomicBool,
    ready: impl FnOnce(SocketAddr),
) -> Result<(), Error> {
    let address = settings.address;
    let listen = |source| Error::Listen { address, source };
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(64)
        .enable_all()
        .build()
        .map_err(Error::Threads)?;
    raise_open_files();
    let first = open(&settings, Store::open)?;
    let listener = TcpListener::bind(address).map_err(listen)?;
    listener.set_nonblocking(true).map_err(listen)?;
    ready(listener.local_addr().map_err(listen)?);
    let store = match first {
        Ok(store) => store,
        Err(fault) => match broken::wait(&runtime, &listener, &settings, &fault, stop)? {
            Some(store) => store,
            None => return Ok(()),
        },
    };
    let listener = listener.try_clone().map_err(listen)?;
    store.listens_at(listener.local_addr().map_err(listen)?)?;
    run(settings, store, listener, &runtime, stop)?;
    runtime.shutdown_timeout(Duration::from_secs(1));
    tracing::info!("stopped");
    Ok(())
}

/// Whether the service would start with these settings: folder, address and all. Nothing is served or
/// written, and a service of this folder that runs is not disturbed: its folder and address count as
/// found.
///
/// # Errors
/// As [`serve`]; a folder that cannot be written.
pub fn check(settings: &Settings) -> Result<(), Error> {
    if !Store::look(&settings.folder)? && !settings.address.ip().is_loopback() {
        return Err(Error::Open(settings.address));
    }
    let address = settings.address;
    match TcpListener::bind(address) {
        Err(source) if !is_own(settings, &source) => Err(Error::Listen { address, source }),
        _ => Ok(()),
    }
}

/// Whether an address is taken by the very service that would listen there.
fn is_own(settings: &Settings, error: &std::io::Error) -> bool {
    let port = settings.address.port();
    error.kind() == std::io::ErrorKind::AddrInUse
        && Store::served_at(&settings.folder).is_some_and(|address| address.port() == port)
}

/// The store, or why the disk does not let it be opened.
fn open(
    settings: &Settings,
    how: fn(&Path) -> Result<Store, StoreError>,
) -> Result<Result<Store, StoreError>, Error> {
    let store = match how(&settings.folder) {
        Ok(store) => store,
        Err(error) if error.is_of_the_disk() => return Ok(Err(error)),
        Err(error) => return Err(error.into()),
    };
    if !store.has_tokens()? && !settings.address.ip().is_loopback() {
        return Err(Error::Open(settings.address));
    }
    Ok(Ok(store))
}

/// Serves with a store that works.
fn run(
    settings: Settings,
    store: Store,
    listener: TcpListener,
    runtime: &tokio::runtime::Runtime,
    stop: &'static AtomicBool,
) -> Result<(), Error> {
    let (stopper, stopping) = watch::channel(false);
    let guarded = store.has_tokens()?;
    let answers = Shared::answers(settings.limits.answer_bytes);
    let bodies = Shared::bodies(settings.limits.body_bytes);
    let service = Arc::new(Service {
        hot: Hot::new(settings.limits.hot_bytes),
        settings,
        store,
        runner: Runner::default(),
        metrics: Metrics::default(),
        rates: Rates::default(),
        keys: Mutex::default(),
        imports: Arc::new(Semaphore::new(IMPORTS)),
        room: Arc::default(),
        answers,
        bodies,
        stopping,
        guarded,
    });
    let thread = |name: &str, work: fn(&Arc<Service>)| {
        let running = Arc::clone(&service);
        let builder = std::thread::Builder::new().name(name.to_owned());
        builder.spawn(move || work(&running)).map_err(Error::Threads)
    };
    priority::lower_compute_threads();
    let workers = [
        thread("jobs", runner::work)?,
        thread("webhooks", webhooks::work)?,
        thread("retention", retention::work)?,
    ];
    runtime.block_on(async {
        let waiting = async {
            while !stop.load(Ordering::Relaxed) {
                tokio::time::sleep(GLANCE).await;
            }
            tracing::info!("stopping");
            stopper.send_replace(true);
            service.runner.stop();
        };
        let app = router::router(&service);
        let limits = service.settings.limits;
        let open = service.metrics.connections();
        let stopping = service.stopping.clone();
        tokio::join!(connections::accept(listener, limits, app, open, stopping), waiting);
    });
    // The others leave nothing half done that the next start would not see.
    let [jobs, ..] = workers;
    if jobs.join().is_err() {
        tracing::error!("the thread that runs jobs had panicked");
    }
    Ok(())
}
