//! What goes from the database goes from the disk.
//!
//! *Invariant:* the row goes first, then the files, and those only while nobody can make a new row
//! for them: a process that is killed in between leaves files that nothing names, never a row
//! without its files.

use std::fs;
use std::path::Path;

use rusqlite::{Connection, OptionalExtension, Transaction, params};

use super::folder::remove;
use super::job::{Deleted, Forgotten};
use super::jobs::get;
use super::models::has_model;
use super::submit::has_dataset;
use super::{Error, Store};

/// Assets that are looked at in one transaction: uploads wait for no more than that.
const BATCH: i64 = 1000;

impl Store {
    /// Forgets a job that has ended, with its scene, and with its data set where no other job has
    /// the same. Its model stays.
    ///
    /// # Errors
    /// What the database or the disk objects to.
    pub(in crate::serve) fn delete_job(&self, id: &str) -> Result<Deleted, Error> {
        let mut bake = String::new();
        let outcome = self.write(|tx| {
            let Some(job) = get(tx, id)? else { return Ok(Deleted::Unknown) };
            if !job.state.is_final() {
                return Ok(Deleted::Active(job.state));
            }
            for table in ["events", "logs", "uses"] {
                tx.execute(&format!("DELETE FROM {table} WHERE job = ?1"), [job.seq])?;
            }
            tx.execute("DELETE FROM keys WHERE job = ?1", [id])?;
            tx.execute("DELETE FROM jobs WHERE seq = ?1", [job.seq])?;
            bake = job.bake;
            Ok(Deleted::Yes)
        })?;
        if matches!(outcome, Deleted::Yes) {
            self.discard(&self.folder.work(&bake), |tx| has_dataset(tx, &bake))?;
            remove(&self.folder.sources(id))?;
            remove(&self.folder.results(id))?;
        }
        Ok(outcome)
    }

    /// Forgets a model and removes its files; whether there was one.
    ///
    /// # Errors
    /// What the database or the disk objects to.
    pub(in crate::serve) fn delete_model(&self, id: &str) -> Result<bool, Error> {
        let gone = self.write(|tx| Ok(tx.execute("DELETE FROM models WHERE id = ?1", [id])?))? > 0;
        if gone {
            self.discard(&self.folder.model(id), |tx| has_model(tx, id))?;
        }
        Ok(gone)
    }

    /// Forgets an asset and removes its file, unless a job that has not ended needs it. Jobs that have
    /// ended keep their scenes.
    ///
    /// # Errors
    /// What the database or the disk objects to.
    pub(in crate::serve) fn delete_asset(&self, sha256: &str) -> Result<Forgotten, Error> {
        let outcome = self.write(|tx| {
            let sql = "SELECT jobs.id FROM uses JOIN jobs ON jobs.seq = uses.job
                WHERE uses.asset = ?1 AND jobs.state IN ('queued', 'running', 'cancelling') LIMIT 1";
            if let Some(job) = tx.query_row(sql, [sha256], |row| row.get(0)).optional()? {
                return Ok(Forgotten::Needed(job));
            }
            let gone = tx.execute("DELETE FROM assets WHERE sha256 = ?1", [sha256])? > 0;
            Ok(if gone { Forgotten::Yes } else { Forgotten::Unknown })
        })?;
        if matches!(outcome, Forgotten::Yes) {
            self.discard(&self.folder.asset(sha256), |tx| has_asset(tx, sha256))?;
        }
        Ok(outcome)
    }

    /// Removes assets that nobody has asked for since a time and that no job names; how many. Others
    /// use the store between one batch and the next.
    ///
    /// # Errors
    /// What database or disk object to.
    pub(in crate::serve) fn delete_unused_assets(&self, before_ms: i64) -> Result<usize, Error> {
        let (mut after, mut count) = (String::new(), 0);
        loop {
            let (last, unused) = self.write(|tx| unused(tx, &after, before_ms))?;
            for sha256 in &unused {
                self.discard(&self.folder.asset(sha256), |tx| has_asset(tx, sha256))?;
            }
            count += unused.len();
            match last {
                Some(last) => after = last,
                None => return Ok(count),
            }
        }
    }

    /// Deletes a file or folder unless something stands for it again: it is moved away while nobody
    /// can write the database, and deleted afterwards, which may take longer.
    fn discard(
        &self,
        path: &Path,
        is_known: impl FnOnce(&Connection) -> Result<bool, Error>,
    ) -> Result<(), Error> {
        let aside = self.folder.incoming()?;
        let connection = self.lock();
        if is_known(&connection)? {
            return Ok(());
        }
        let moved = fs::rename(path, aside.path().join("gone"));
        drop(connection);
        match moved {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                Err(Error::Io { action: "remove", path: path.to_path_buf(), source })
            }
            _ => Ok(()),
        }
    }
}

/// Takes unused assets out of the next batch after one of them: the batch's last, and what is gone.
fn unused(
    tx: &Transaction<'_>,
    after: &str,
    before_ms: i64,
) -> Result<(Option<String>, Vec<String>), Error> {
    let sql = "SELECT MAX(sha256) FROM
        (SELECT sha256 FROM assets WHERE sha256 > ?1 ORDER BY sha256 LIMIT ?2)";
    let last: Option<String> = tx.query_row(sql, params![after, BATCH], |row| row.get(0))?;
    let Some(last) = last else { return Ok((None, Vec::new())) };
    let sql = "DELETE FROM assets WHERE sha256 > ?1 AND sha256 <= ?2
        AND MAX(created_ms, asked_ms) < ?3
        AND NOT EXISTS (SELECT 1 FROM uses WHERE asset = assets.sha256) RETURNING sha256";
    let mut statement = tx.prepare_cached(sql)?;
    let rows = statement.query_map(params![after, last, before_ms], |row| row.get(0))?;
    let unused = rows.collect::<Result<_, _>>()?;
    Ok((Some(last), unused))
}

fn has_asset(tx: &Connection, sha256: &str) -> Result<bool, Error> {
    let sql = "SELECT EXISTS (SELECT 1 FROM assets WHERE sha256 = ?1)";
    Ok(tx.query_row(sql, [sha256], |row| row.get(0))?)
}
