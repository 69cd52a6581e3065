//! What the service knows, on disk: one SQLite database, and files named by hashes beside it.
//!
//! *Invariant:* nothing is promised to a client before its transaction is synchronously on disk.
//! *Invariant:* one process at a time writes as the service; a fence in every transaction stops
//! one that has lost the folder.

mod assets;
mod delete;
mod deliveries;
mod error;
mod events;
mod folder;
mod job;
mod jobs;
mod logs;
mod models;
mod submit;
mod tokens;

use std::fs::File;
use std::io::{Seek, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rusqlite::{Connection, OpenFlags, OptionalExtension, Transaction, TransactionBehavior};

pub(super) use assets::Asset;
pub(super) use deliveries::Delivery;
pub use error::Error;
pub(super) use events::{Bells, Event};
pub(super) use folder::{Folder, Incoming, create, list, remove, settle};
pub(super) use job::{
    Cancelled, Claim, Deleted, Done, Forgotten, Job, Key, NewJob, NewModel, State, Submitted,
};
pub(super) use logs::{Level, Line};
pub(super) use models::StoredModel;
pub(super) use tokens::hash_of;
pub use tokens::{NewToken, Token};

/// The database's file.
const DATABASE: &str = "poselight.db";

/// The version of the tables.
const SCHEMA: i64 = MIGRATIONS.len() as i64;

/// What leads from each version of the tables to the next. Times are milliseconds since 1970 and
/// only shown; order is by `seq`.
const MIGRATIONS: [&str; 3] = [TABLES, KINDS, USES];

/// How often the service has ended while it ran a job since its bake had last come further, and how
/// many whole files that was; which asset is whose; when an asset was last asked for; where a
/// message goes.
const USES: &str = "
ALTER TABLE jobs ADD COLUMN ends INTEGER NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN whole INTEGER NOT NULL DEFAULT 0;
ALTER TABLE assets ADD COLUMN asked_ms INTEGER NOT NULL DEFAULT 0;
ALTER TABLE deliveries ADD COLUMN host TEXT NOT NULL DEFAULT '';
CREATE TABLE uses (
    asset TEXT NOT NULL, job INTEGER NOT NULL, PRIMARY KEY (asset, job)
) WITHOUT ROWID;
CREATE INDEX uses_by_job ON uses (job);
INSERT OR IGNORE INTO uses SELECT file.value, jobs.seq
    FROM jobs, json_each(jobs.request, '$.assets') AS file;
";

/// Jobs of several kinds: the column `fit` names the result of each. Logs of jobs, and messages to
/// those who wait for their end.
const KINDS: &str = "
ALTER TABLE jobs ADD COLUMN kind TEXT NOT NULL DEFAULT 'run';
ALTER TABLE jobs ADD COLUMN memory_bytes INTEGER NOT NULL DEFAULT 0;
CREATE INDEX jobs_by_result ON jobs (fit, kind);
CREATE INDEX jobs_by_state_and_number ON jobs (state, seq);
CREATE INDEX jobs_by_kind_and_number ON jobs (kind, seq);
CREATE TABLE logs (
    job INTEGER NOT NULL, id INTEGER NOT NULL, at_ms INTEGER NOT NULL, level TEXT NOT NULL,
    text TEXT NOT NULL, PRIMARY KEY (job, id)
) WITHOUT ROWID;
CREATE TABLE deliveries (
    seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL, job INTEGER NOT NULL,
    url TEXT NOT NULL, body TEXT NOT NULL, attempts INTEGER NOT NULL, due_ms INTEGER NOT NULL
);
CREATE INDEX deliveries_by_time ON deliveries (due_ms, seq);
";

/// The first tables.
const TABLES: &str = "
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS assets (
    sha256 TEXT PRIMARY KEY, bytes INTEGER NOT NULL, kind TEXT NOT NULL, created_ms INTEGER NOT NULL
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS jobs (
    seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, state TEXT NOT NULL,
    priority INTEGER NOT NULL, request TEXT NOT NULL, bake TEXT NOT NULL, fit TEXT NOT NULL,
    cached INTEGER NOT NULL, attempts INTEGER NOT NULL DEFAULT 0, created_ms INTEGER NOT NULL,
    started_ms INTEGER, finished_ms INTEGER, progress TEXT, result TEXT, error TEXT
);
CREATE INDEX IF NOT EXISTS jobs_by_state ON jobs (state, priority DESC, seq);
CREATE INDEX IF NOT EXISTS jobs_by_bake ON jobs (bake);
CREATE TABLE IF NOT EXISTS events (
    job INTEGER NOT NULL, id INTEGER NOT NULL, at_ms INTEGER NOT NULL, kind TEXT NOT NULL,
    data TEXT NOT NULL, PRIMARY KEY (job, id)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS keys (
    owner TEXT NOT NULL, key TEXT NOT NULL, body_sha256 TEXT NOT NULL, job TEXT NOT NULL,
    created_ms INTEGER NOT NULL, PRIMARY KEY (owner, key)
) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS models (
    seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, sha256 TEXT NOT NULL,
    bytes INTEGER NOT NULL, job TEXT NOT NULL, created_ms INTEGER NOT NULL
);
CREATE TABLE IF NOT EXISTS tokens (
    hash TEXT PRIMARY KEY, name TEXT NOT NULL UNIQUE, scopes TEXT NOT NULL,
    created_ms INTEGER NOT NULL, expires_ms INTEGER NOT NULL
) WITHOUT ROWID;
";

/// Database and files of one service.
#[derive(Debug)]
pub struct Store {
    connection: Mutex<Connection>,
    /// Which of the folder's owners this is; `None` for a visitor that only manages tokens.
    epoch: Option<i64>,
    folder: Folder,
    bells: Bells,
    /// Locked as long as the service lives; the system lets go of it however the process ends.
    lease: Option<File>,
}

impl Store {
    /// Takes a folder into service, making it where there is none.
    ///
    /// # Errors
    /// [`Error::Taken`] where another process serves it; what disk and database object to.
    pub fn open(path: &Path) -> Result<Self, Error> {
        if !path.join(DATABASE).exists() && folder::is_filled(path) {
            tracing::warn!("there is no poselight.db: what was done here before is not known");
        }
        Self::take(path, OpenFlags::default())
    }

    fn take(path: &Path, flags: OpenFlags) -> Result<Self, Error> {
        let folder = Folder::create(path)?;
        let lease = folder.lease()?;
        let mut store = Self::connect(folder, flags)?;
        let sql = "INSERT INTO meta VALUES ('epoch', 1)
            ON CONFLICT (key) DO UPDATE SET value = value + 1 RETURNING value";
        let epoch = store.lock().query_row(sql, [], |row| row.get(0))?;
        store.epoch = Some(epoch);
        store.lease = Some(lease);
        store.folder.sweep(&store.job_ids()?, &store.bakes()?)?;
        store.recover()?;
        Ok(store)
    }

    /// As [`Self::open`], of a folder whose database was broken a moment ago: an empty one does not take
    /// its place by itself, for its journal would win over a copy that is put there.
    ///
    /// # Errors
    /// As [`Self::open`]; [`Error::Gone`].
    pub(super) fn reopen(path: &Path) -> Result<Self, Error> {
        let database = path.join(DATABASE);
        // A copy that has just begun has no bytes yet.
        let is_there = database.metadata().is_ok_and(|file| file.len() > 0);
        if !is_there && !folder::is_filled(path) {
            return Self::open(path);
        }
        if !is_there {
            return Err(Error::Gone(path.to_path_buf()));
        }
        // One that is still being copied is not whole, and is only looked at.
        Self::look(path)?;
        Self::take(path, OpenFlags::default() & !OpenFlags::SQLITE_OPEN_CREATE)
    }

    /// Says in the folder where its service listens.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(super) fn listens_at(&self, address: SocketAddr) -> Result<(), Error> {
        let Some(mut lock) = self.lease.as_ref() else { return Ok(()) };
        let path = self.folder.root().join("lock");
        let written = lock.set_len(0).and_then(|()| lock.rewind());
        let written = written.and_then(|()| write!(lock, "{address}"));
        written.map_err(|source| Error::Io { action: "write", path, source })
    }

    /// Where the service of a folder listens, if there is one that runs.
    #[must_use]
    pub fn served_at(path: &Path) -> Option<SocketAddr> {
        folder::served_at(path)
    }

    /// Looks into a folder beside the process that serves it, to manage tokens; makes it where there is
    /// none.
    ///
    /// # Errors
    /// What disk and database object to.
    pub fn visit(path: &Path) -> Result<Self, Error> {
        // A service that waits for a copy of its database would take an empty one for it.
        if !path.join(DATABASE).exists() && folder::is_filled(path) {
            return Err(Error::Gone(path.to_path_buf()));
        }
        Self::connect(Folder::create(path)?, OpenFlags::default())
    }

    /// As [`Self::visit`], of a folder that is there.
    ///
    /// # Errors
    /// [`Error::NoService`]; what disk and database object to.
    pub fn visit_known(path: &Path) -> Result<Self, Error> {
        if path.join(DATABASE).exists() {
            return Self::visit(path);
        }
        Err(Error::NoService(path.to_path_buf()))
    }

    /// Whether a service would begin in a folder, and has tokens there; nothing is written.
    ///
    /// # Errors
    /// What disk and database object to.
    pub fn look(path: &Path) -> Result<bool, Error> {
        folder::check_writable(path)?;
        let database = path.join(DATABASE);
        if !database.exists() {
            return Ok(false);
        }
        let connection = Connection::open_with_flags(database, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        connection.busy_timeout(Duration::from_secs(10))?;
        check(&connection)?;
        let found: i64 = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
        if found > SCHEMA {
            return Err(Error::Newer { found });
        }
        // The first tables have the tokens; before them there were none.
        if found == 0 { Ok(false) } else { tokens::any(&connection) }
    }

    fn connect(folder: Folder, flags: OpenFlags) -> Result<Self, Error> {
        let mut connection = Connection::open_with_flags(folder.database(), flags)?;
        connection.busy_timeout(Duration::from_secs(10))?;
        connection.pragma_update(None, "journal_mode", "WAL")?;
        connection.pragma_update(None, "synchronous", "FULL")?;
        connection.pragma_update(None, "foreign_keys", "ON")?;
        check(&connection)?;
        migrate(&mut connection)?;
        let connection = Mutex::new(connection);
        Ok(Self { connection, epoch: None, folder, bells: Bells::default(), lease: None })
    }

    /// Where the files are.
    pub(super) fn folder(&self) -> &Folder {
        &self.folder
    }

    /// Who listens to which job.
    pub(super) fn bells(&self) -> &Bells {
        &self.bells
    }

    /// Whether the database takes a write: what `/ready` asks.
    ///
    /// # Errors
    /// What the database objects to.
    pub(super) fn touch(&self) -> Result<(), Error> {
        let sql = "INSERT INTO meta VALUES ('touched', 1)
            ON CONFLICT (key) DO UPDATE SET value = value + 1";
        self.write(|tx| Ok(tx.execute(sql, []).map(drop)?))
    }

    /// A panic elsewhere leaves the connection as sound as its last transaction.
    fn lock(&self) -> MutexGuard<'_, Connection> {
        self.connection.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    /// One transaction of the folder's owner, on disk when this returns.
    fn write<T>(
        &self,
        work: impl FnOnce(&Transaction<'_>) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let mut connection = self.lock();
        let tx = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        if let Some(own) = self.epoch {
            let sql = "SELECT value FROM meta WHERE key = 'epoch'";
            let owner: Option<i64> = tx.query_row(sql, [], |row| row.get(0)).optional()?;
            if owner != Some(own) {
                return Err(Error::Fenced);
            }
        }
        let value = work(&tx)?;
        tx.commit()?;
        Ok(value)
    }
}

/// Whether the database is whole: damage is found at the start, not in the middle of a job.
fn check(connection: &Connection) -> Result<(), Error> {
    let said: String = connection.query_row("PRAGMA quick_check(1)", [], |row| row.get(0))?;
    if said == "ok" { Ok(()) } else { Err(Error::Damaged { said }) }
}

/// Brings the tables to this build's version, all or nothing.
fn migrate(connection: &mut Connection) -> Result<(), Error> {
    let version = |tx: &Connection| tx.pragma_query_value(None, "user_version", |row| row.get(0));
    let tx = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    let found: i64 = version(&tx)?;
    if found > SCHEMA {
        return Err(Error::Newer { found });
    }
    for step in MIGRATIONS.iter().skip(found.unsigned_abs() as usize) {
        tx.execute_batch(step)?;
    }
    tx.pragma_update(None, "user_version", SCHEMA)?;
    Ok(tx.commit()?)
}

/// Milliseconds since 1970, for people to read.
pub(super) fn now_ms() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

/// 32 hexadecimal digits that nobody can guess.
///
/// # Errors
/// Where the system has no random numbers.
pub(super) fn random_id() -> Result<String, Error> {
    use std::io::Read;
    let path = PathBuf::from("/dev/urandom");
    let mut bytes = [0_u8; 16];
    File::open(&path)
        .and_then(|mut file| file.read_exact(&mut bytes))
        .map_err(|source| Error::Io { action: "read", path, source })?;
    Ok(hexadecimal(&bytes))
}

/// Lower-case hexadecimal.
pub(super) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests;
