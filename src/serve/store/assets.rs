//! Uploaded files, named by their bytes.

use std::path::Path;

use rusqlite::{OptionalExtension, params};

use super::{Error, Store, now_ms, settle};

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

    /// Takes note that somebody has asked for an asset and so counts on it for a while.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn renew_asset(&self, sha256: &str) -> Result<(), Error> {
        let now = now_ms();
        let sql = "UPDATE assets SET asked_ms = ?2 WHERE sha256 = ?1";
        // Once an hour is enough for what is kept for days, and costs the others less.
        let known = "SELECT MAX(created_ms, asked_ms) > ?2 - 3600000 FROM assets WHERE sha256 = ?1";
        let recent: Option<bool> =
            self.lock().query_row(known, params![sha256, now], |row| row.get(0)).optional()?;
        match recent {
            Some(false) => self.write(|tx| Ok(tx.execute(sql, params![sha256, now]).map(drop)?)),
            _ => Ok(()),
        }
    }

    /// Puts a whole file into its place as an asset and records it, so that nobody who removes one of
    /// that name comes between. The same bytes may come twice at once.
    ///
    /// # Errors
    /// What the database or the disk objects to.
    pub(in crate::serve) fn add_asset(
        &self,
        sha256: &str,
        bytes: u64,
        kind: &str,
        from: &Path,
    ) -> Result<(), Error> {
        let sql = "INSERT INTO assets (sha256, bytes, kind, created_ms) VALUES (?1, ?2, ?3, ?4)
            ON CONFLICT (sha256) DO UPDATE SET kind = MAX(kind, excluded.kind)";
        let bytes = i64::try_from(bytes).unwrap_or(i64::MAX);
        self.write(|tx| {
            tx.execute(sql, params![sha256, bytes, kind, now_ms()])?;
            settle(from, &self.folder.asset(sha256))
        })
    }
}
