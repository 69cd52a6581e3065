//! How a job is accepted: checked against all that it counts on, and written down, at once.

use rusqlite::{Connection, OptionalExtension, Transaction, params};

use super::job::{Key, NewJob, State, Submitted};
use super::jobs::{enter, get};
use super::models::has_model;
use super::{Error, Store, now_ms};

impl Store {
    /// What an earlier request with this key came to.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn by_key(&self, key: &Key) -> Result<Option<Submitted>, Error> {
        by_key(&self.lock(), key)
    }

    /// How many jobs wait.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn waiting(&self) -> Result<u32, Error> {
        waiting(&self.lock())
    }

    /// Accepts a job; it is on disk when this returns.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn submit(
        &self,
        new: &NewJob<'_>,
        key: Option<&Key>,
    ) -> Result<Submitted, Error> {
        self.write(|tx| {
            if let Some(seen) = key.map(|key| by_key(tx, key)).transpose()?.flatten() {
                return Ok(seen);
            }
            // A model that was deleted meanwhile is made again.
            let gone = new.makes_model && !has_model(tx, new.key)?;
            let result = new.result.filter(|_| !gone);
            let waiting = waiting(tx)?;
            if result.is_none() && waiting >= new.most_queued {
                return Ok(Submitted::Full(waiting));
            }
            if new.needs_dataset && !has_dataset(tx, new.bake)? {
                return Ok(Submitted::NoDataset);
            }
            if let Some(name) = missing_asset(tx, new.request)? {
                return Ok(Submitted::NoAsset(name));
            }
            insert(tx, new, result)?;
            let id = new.id;
            if let Some(Key { owner, key, body_sha256 }) = key {
                let sql = "INSERT INTO keys VALUES (?1, ?2, ?3, ?4, ?5)";
                tx.execute(sql, params![owner, key, body_sha256, id, now_ms()])?;
            }
            let job = get(tx, id)?.ok_or(rusqlite::Error::QueryReturnedNoRows)?;
            Ok(Submitted::New(Box::new(job)))
        })
    }
}

fn waiting(tx: &Connection) -> Result<u32, Error> {
    let sql = "SELECT COUNT(*) FROM jobs WHERE state = 'queued'";
    Ok(tx.query_row(sql, [], |row| row.get(0))?)
}

pub(super) fn has_dataset(tx: &Connection, bake: &str) -> Result<bool, Error> {
    let sql = "SELECT EXISTS (SELECT 1 FROM jobs WHERE bake = ?1)";
    Ok(tx.query_row(sql, [bake], |row| row.get(0))?)
}

/// The name of a file of the request whose asset is not there.
fn missing_asset(tx: &Connection, request: &str) -> Result<Option<String>, Error> {
    let sql = "SELECT file.key FROM json_each(?1, '$.assets') AS file
        WHERE NOT EXISTS (SELECT 1 FROM assets WHERE sha256 = file.value) LIMIT 1";
    Ok(tx.query_row(sql, [request], |row| row.get(0)).optional()?)
}

/// Writes a job down as queued, or as done at once.
fn insert(tx: &Transaction<'_>, new: &NewJob<'_>, result: Option<&str>) -> Result<(), Error> {
    let sql = "INSERT INTO jobs (id, state, priority, request, bake, fit, cached, result,
        created_ms, kind, memory_bytes) VALUES (?1, 'queued', ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)";
    let NewJob { id, kind, priority, request, bake, key, .. } = *new;
    let cached = result.is_some();
    let memory = i64::try_from(new.memory_bytes).unwrap_or(i64::MAX);
    let row = params![id, priority, request, bake, key, cached, result, now_ms(), kind, memory];
    tx.execute(sql, row)?;
    let seq = tx.last_insert_rowid();
    let sql = "INSERT OR IGNORE INTO uses SELECT file.value, ?1
        FROM json_each(?2, '$.assets') AS file";
    tx.execute(sql, params![seq, request])?;
    enter(tx, seq, State::Queued)?;
    if cached {
        enter(tx, seq, State::Succeeded)?;
    }
    Ok(())
}

fn by_key(tx: &Connection, key: &Key) -> Result<Option<Submitted>, Error> {
    let sql = "SELECT body_sha256, job FROM keys WHERE owner = ?1 AND key = ?2";
    let found: Option<(String, String)> = tx
        .query_row(sql, [&key.owner, &key.key], |row| Ok((row.get(0)?, row.get(1)?)))
        .optional()?;
    let Some((body, id)) = found else { return Ok(None) };
    if body != key.body_sha256 {
        return Ok(Some(Submitted::OtherBody));
    }
    Ok(get(tx, &id)?.map(|job| Submitted::Same(Box::new(job))))
}
