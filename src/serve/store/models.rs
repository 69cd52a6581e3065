//! Finished models.

use rusqlite::{OptionalExtension, Row, params};

use super::folder::remove;
use super::{Error, Store};

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

    /// Forgets a model and removes its files; whether there was one.
    ///
    /// # Errors
    /// What the database or the disk objects to.
    pub(in crate::serve) fn delete_model(&self, id: &str) -> Result<bool, Error> {
        let gone = self.write(|tx| Ok(tx.execute("DELETE FROM models WHERE id = ?1", [id])?))? > 0;
        if gone {
            remove(&self.folder.model(id))?;
        }
        Ok(gone)
    }
}
