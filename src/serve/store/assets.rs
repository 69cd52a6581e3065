//! Uploaded files, named by their bytes.

use rusqlite::{OptionalExtension, params};

use super::{Error, Store, now_ms, remove};

/// One uploaded file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::serve) struct Asset {
    /// Of its bytes, 64 lower-case hexadecimal digits.
    pub(in crate::serve) sha256: String,
    /// Its size.
    pub(in crate::serve) bytes: u64,
    /// `scene` where an import has succeeded, `file` else.
    pub(in crate::serve) kind: String,
    /// When it came.
    pub(in crate::serve) created_ms: i64,
}

impl Store {
    /// A known asset.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn asset(&self, sha256: &str) -> Result<Option<Asset>, Error> {
        let sql = "SELECT bytes, kind, created_ms FROM assets WHERE sha256 = ?1";
        let found = self.lock().query_row(sql, [sha256], |row| {
            Ok(Asset {
                sha256: sha256.to_owned(),
                bytes: row.get::<_, i64>(0)?.unsigned_abs(),
                kind: row.get(1)?,
                created_ms: row.get(2)?,
            })
        });
        Ok(found.optional()?)
    }

    /// Bytes of all assets.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn asset_bytes(&self) -> Result<u64, Error> {
        let sql = "SELECT COALESCE(SUM(bytes), 0) FROM assets";
        let sum: i64 = self.lock().query_row(sql, [], |row| row.get(0))?;
        Ok(sum.unsigned_abs())
    }

    /// Removes assets that came before a time and that no job names; how many.
    ///
    /// # Errors
    /// What database or disk object to.
    pub(in crate::serve) fn delete_unused_assets(&self, before_ms: i64) -> Result<usize, Error> {
        let unused: Vec<String> = self.write(|tx| {
            let sql = "DELETE FROM assets WHERE created_ms < ?1 AND NOT EXISTS
                (SELECT 1 FROM jobs WHERE instr(request, assets.sha256) > 0) RETURNING sha256";
            let mut statement = tx.prepare(sql)?;
            let rows = statement.query_map([before_ms], |row| row.get(0))?;
            Ok(rows.collect::<Result<_, _>>()?)
        })?;
        for sha256 in &unused {
            remove(&self.folder.asset(sha256))?;
        }
        Ok(unused.len())
    }

    /// Records an asset whose file is in place. The same bytes may come twice at once.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn add_asset(
        &self,
        sha256: &str,
        bytes: u64,
        kind: &str,
    ) -> Result<(), Error> {
        let sql = "INSERT INTO assets VALUES (?1, ?2, ?3, ?4)
            ON CONFLICT (sha256) DO UPDATE SET kind = MAX(kind, excluded.kind)";
        let bytes = i64::try_from(bytes).unwrap_or(i64::MAX);
        self.write(|tx| Ok(tx.execute(sql, params![sha256, bytes, kind, now_ms()]).map(drop)?))
    }
}
