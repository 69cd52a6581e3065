//! Finished models.

use rusqlite::{Connection, OptionalExtension, Row, Transaction, params};

use super::folder::{Folder, remove, settle};
use super::job::{Job, NewModel};
use super::{Error, Store, now_ms};

/// A finished model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::serve) struct StoredModel {
    /// Grows with every model; what pages are cut by.
    pub(in crate::serve) seq: i64,
    /// The hash of the fit that made it: equal ids, equal bytes.
    pub(in crate::serve) id: String,
    /// Of the blob.
    pub(in crate::serve) sha256: String,
    /// Of the blob.
    pub(in crate::serve) bytes: u64,
    /// The job that made it.
    pub(in crate::serve) job: String,
    /// When.
    pub(in crate::serve) created_ms: i64,
}

const COLUMNS: &str = "SELECT seq, id, sha256, bytes, job, created_ms FROM models";

fn model(row: &Row<'_>) -> rusqlite::Result<StoredModel> {
    Ok(StoredModel {
        seq: row.get(0)?,
        id: row.get(1)?,
        sha256: row.get(2)?,
        bytes: row.get::<_, i64>(3)?.unsigned_abs(),
        job: row.get(4)?,
        created_ms: row.get(5)?,
    })
}

impl Store {
    /// A finished model.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn model(&self, id: &str) -> Result<Option<StoredModel>, Error> {
        let sql = format!("{COLUMNS} WHERE id = ?1");
        Ok(self.lock().query_row(&sql, [id], model).optional()?)
    }

    /// Models before one of them, the latest first.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn models(
        &self,
        before: i64,
        count: u32,
    ) -> Result<Vec<StoredModel>, Error> {
        let connection = self.lock();
        let sql = format!("{COLUMNS} WHERE seq < ?1 ORDER BY seq DESC LIMIT ?2");
        let mut statement = connection.prepare_cached(&sql)?;
        let rows = statement.query_map(params![before, count], model)?;
        Ok(rows.collect::<Result<_, _>>()?)
    }
}

pub(super) fn has_model(tx: &Connection, id: &str) -> Result<bool, Error> {
    let sql = "SELECT EXISTS (SELECT 1 FROM models WHERE id = ?1)";
    Ok(tx.query_row(sql, [id], |row| row.get(0))?)
}

/// Makes a job's model known and moves it to its place, unless the same is there already, with its
/// files. Again, after a transaction that failed, it does what is left to do.
pub(super) fn add(
    tx: &Transaction<'_>,
    folder: &Folder,
    job: &Job,
    model: &NewModel<'_>,
) -> Result<(), Error> {
    let sql = "INSERT INTO models (id, sha256, bytes, job, created_ms)
        VALUES (?1, ?2, ?3, ?4, ?5) ON CONFLICT (id) DO NOTHING";
    let bytes = i64::try_from(model.bytes).unwrap_or(i64::MAX);
    let new = tx.execute(sql, params![job.key, model.sha256, bytes, job.id, now_ms()])? > 0;
    let place = folder.model(&job.key);
    if (new || !place.is_dir()) && model.folder.is_dir() {
        // Of a process that ended before it had deleted it.
        remove(&place)?;
        settle(model.folder, &place)?;
    }
    Ok(())
}
