//! What happened to a job, numbered, and bells for those who wait for more.

use std::collections::BTreeMap;
use std::sync::Mutex;

use rusqlite::{Transaction, params};
use tokio::sync::watch;

use super::{Error, Store, now_ms};

/// Events of one job that are kept; the oldest go first.
const MOST_KEPT: i64 = 1000;

/// One thing that happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::serve) struct Event {
    /// From 1, without gaps as long as nothing is dropped.
    pub(in crate::serve) id: i64,
    /// `state`, `progress` or `stalled`.
    pub(in crate::serve) kind: String,
    /// JSON.
    pub(in crate::serve) data: String,
}

/// A bell per job that somebody waits for.
#[derive(Debug, Default)]
pub(in crate::serve) struct Bells {
    by_job: Mutex<BTreeMap<i64, watch::Sender<()>>>,
}

impl Bells {
    /// Rings at every event of a job from now on.
    pub(in crate::serve) fn listen(&self, job: i64) -> watch::Receiver<()> {
        let mut by_job = self.by_job.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        by_job.retain(|_, bell| bell.receiver_count() > 0);
        by_job.entry(job).or_insert_with(|| watch::channel(()).0).subscribe()
    }

    pub(super) fn ring(&self, job: i64) {
        let by_job = self.by_job.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(bell) = by_job.get(&job) {
            bell.send_replace(());
        }
    }
}

/// Adds an event within a transaction; the caller rings when that is done.
pub(super) fn add(tx: &Transaction<'_>, job: i64, kind: &str, data: &str) -> Result<(), Error> {
    let sql = "INSERT INTO events SELECT ?1, COALESCE(MAX(id), 0) + 1, ?2, ?3, ?4
        FROM events WHERE job = ?1 RETURNING id";
    let id: i64 = tx.query_row(sql, params![job, now_ms(), kind, data], |row| row.get(0))?;
    let sql = "DELETE FROM events WHERE job = ?1 AND id <= ?2 AND kind = 'progress'";
    tx.execute(sql, params![job, id - MOST_KEPT])?;
    Ok(())
}

impl Store {
    /// The events of a job after one of them, in order, a bounded number at once.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn events(&self, job: i64, after: i64) -> Result<Vec<Event>, Error> {
        let connection = self.lock();
        let sql = "SELECT id, kind, data FROM events WHERE job = ?1 AND id > ?2
            ORDER BY id LIMIT 100";
        let mut statement = connection.prepare_cached(sql)?;
        let rows = statement.query_map(params![job, after], |row| {
            Ok(Event { id: row.get(0)?, kind: row.get(1)?, data: row.get(2)? })
        })?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    /// Adds an event to a job.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn tell(&self, job: i64, kind: &str, data: &str) -> Result<(), Error> {
        self.write(|tx| add(tx, job, kind, data))?;
        self.bells.ring(job);
        Ok(())
    }

    /// Records how far a running job is.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn progress(&self, job: i64, data: &str) -> Result<(), Error> {
        self.write(|tx| {
            tx.execute("UPDATE jobs SET progress = ?2 WHERE seq = ?1", params![job, data])?;
            add(tx, job, "progress", data)
        })?;
        self.bells.ring(job);
        Ok(())
    }
}
