//! The table of jobs, and every change of a job's state.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use rusqlite::{OptionalExtension, Row, Transaction, params};
use serde_json::json;

use super::folder::remove;
use super::job::{Cancelled, Deleted, Done, Job, Key, NewJob, State, Submitted};
use super::{Error, Store, deliveries, events, now_ms};

const COLUMNS: &str = "seq, id, state, priority, request, bake, fit, cached, attempts, created_ms,
    started_ms, finished_ms, progress, result, error, kind, memory_bytes";

fn job(row: &Row<'_>) -> rusqlite::Result<Job> {
    let state: String = row.get(2)?;
    Ok(Job {
        seq: row.get(0)?,
        id: row.get(1)?,
        // An unknown state can only come from a later version, which is refused on opening.
        state: State::from_name(&state).unwrap_or(State::Failed),
        priority: row.get(3)?,
        request: row.get(4)?,
        bake: row.get(5)?,
        key: row.get(6)?,
        cached: row.get(7)?,
        attempts: row.get(8)?,
        created_ms: row.get(9)?,
        started_ms: row.get(10)?,
        finished_ms: row.get(11)?,
        progress: row.get(12)?,
        result: row.get(13)?,
        error: row.get(14)?,
        kind: row.get(15)?,
        memory_bytes: row.get::<_, i64>(16)?.unsigned_abs(),
    })
}

fn get(tx: &rusqlite::Connection, id: &str) -> Result<Option<Job>, Error> {
    let sql = format!("SELECT {COLUMNS} FROM jobs WHERE id = ?1");
    Ok(tx.query_row(&sql, [id], job).optional()?)
}

/// Moves a job to a state, with the event that says so.
fn enter(tx: &Transaction<'_>, seq: i64, state: State) -> Result<(), Error> {
    let finished = state.is_final().then(now_ms);
    let sql = "UPDATE jobs SET state = ?2, finished_ms = ?3 WHERE seq = ?1";
    tx.execute(sql, params![seq, state.name(), finished])?;
    if state.is_final() {
        deliveries::add(tx, seq, state)?;
    }
    events::add(tx, seq, "state", &json!({ "state": state.name() }).to_string())
}

impl Store {
    /// A job.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn job(&self, id: &str) -> Result<Option<Job>, Error> {
        get(&self.lock(), id)
    }

    /// A job by its number.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn job_by_seq(&self, seq: i64) -> Result<Option<Job>, Error> {
        let sql = format!("SELECT {COLUMNS} FROM jobs WHERE seq = ?1");
        Ok(self.lock().query_row(&sql, [seq], job).optional()?)
    }

    /// Jobs that ended before a time, the oldest first.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn ended_before(&self, before_ms: i64) -> Result<Vec<String>, Error> {
        let connection = self.lock();
        let sql = "SELECT id FROM jobs WHERE state IN ('succeeded', 'failed', 'cancelled')
            AND finished_ms < ?1 ORDER BY seq";
        let mut statement = connection.prepare_cached(sql)?;
        let rows = statement.query_map([before_ms], |row| row.get(0))?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    pub(super) fn job_ids(&self) -> Result<BTreeSet<String>, Error> {
        let connection = self.lock();
        let mut statement = connection.prepare("SELECT id FROM jobs")?;
        let rows = statement.query_map([], |row| row.get(0))?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    /// Jobs before one of them, the latest first.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn jobs(
        &self,
        before: i64,
        state: Option<State>,
        kind: Option<&str>,
        count: u32,
    ) -> Result<Vec<Job>, Error> {
        let connection = self.lock();
        let of_state = if state.is_some() { "AND state = ?3" } else { "AND ?3 IS NULL" };
        let of_kind = if kind.is_some() { "AND kind = ?4" } else { "AND ?4 IS NULL" };
        let sql = format!(
            "SELECT {COLUMNS} FROM jobs WHERE seq < ?1 {of_state} {of_kind}
            ORDER BY seq DESC LIMIT ?2"
        );
        let mut statement = connection.prepare_cached(&sql)?;
        let rows =
            statement.query_map(params![before, count, state.map(State::name), kind], job)?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    /// The latest job of a kind that ended well with this key.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn succeeded(&self, kind: &str, key: &str) -> Result<Option<Job>, Error> {
        let sql = format!(
            "SELECT {COLUMNS} FROM jobs WHERE fit = ?1 AND kind = ?2 AND state = 'succeeded'
            ORDER BY seq DESC LIMIT 1"
        );
        Ok(self.lock().query_row(&sql, [key, kind], job).optional()?)
    }

    /// A job that has the scene which a model was made of: its own, or one of the same bake.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn scene_job(&self, model: &str) -> Result<Option<Job>, Error> {
        let sql = format!(
            "SELECT {COLUMNS} FROM jobs WHERE kind IN ('run', 'bake') AND bake IN
            (SELECT bake FROM jobs WHERE fit = ?1) ORDER BY seq DESC LIMIT 1"
        );
        Ok(self.lock().query_row(&sql, [model], job).optional()?)
    }

    /// Whether a job has baked this data set, or works on it: then its folder stays.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn has_dataset(&self, bake: &str) -> Result<bool, Error> {
        has_dataset(&self.lock(), bake)
    }

    /// How many jobs are in each state.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn count_jobs(&self) -> Result<BTreeMap<String, i64>, Error> {
        let connection = self.lock();
        let mut statement =
            connection.prepare_cached("SELECT state, COUNT(*) FROM jobs GROUP BY 1")?;
        let rows = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    /// Rays a second of all jobs that run, as they last told.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn rays_per_s(&self) -> Result<f64, Error> {
        let sql = "SELECT TOTAL(json_extract(progress, '$.rays_per_s')) FROM jobs
            WHERE state = 'running'";
        Ok(self.lock().query_row(sql, [], |row| row.get(0))?)
    }

    /// What an earlier request with this key came to.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn by_key(&self, key: &Key) -> Result<Option<Submitted>, Error> {
        by_key(&self.lock(), key)
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
            let sql = "SELECT COUNT(*) FROM jobs WHERE state = 'queued'";
            let waiting: u32 = tx.query_row(sql, [], |row| row.get(0))?;
            if new.result.is_none() && waiting >= new.most_queued {
                return Ok(Submitted::Full(waiting));
            }
            if new.needs_dataset && !has_dataset(tx, new.bake)? {
                return Ok(Submitted::NoDataset);
            }
            insert(tx, new)?;
            let id = new.id;
            if let Some(Key { owner, key, body_sha256 }) = key {
                let sql = "INSERT INTO keys VALUES (?1, ?2, ?3, ?4, ?5)";
                tx.execute(sql, params![owner, key, body_sha256, id, now_ms()])?;
            }
            let job = get(tx, id)?.ok_or(rusqlite::Error::QueryReturnedNoRows)?;
            Ok(Submitted::New(Box::new(job)))
        })
    }

    /// The next job to run that takes at most so much memory, now marked as running. Two jobs of one
    /// bake never run at once, for they write to one data set.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn claim(&self, memory_bytes: u64) -> Result<Option<Job>, Error> {
        let memory = i64::try_from(memory_bytes).unwrap_or(i64::MAX);
        let claimed = self.write(|tx| {
            let sql = format!(
                "SELECT {COLUMNS} FROM jobs WHERE state = 'queued' AND memory_bytes <= ?1
                AND bake NOT IN (SELECT bake FROM jobs WHERE state IN ('running', 'cancelling'))
                ORDER BY priority DESC, seq LIMIT 1"
            );
            let Some(next) = tx.query_row(&sql, [memory], job).optional()? else {
                return Ok(None);
            };
            let sql = "UPDATE jobs SET attempts = attempts + 1,
                started_ms = COALESCE(started_ms, ?2) WHERE seq = ?1";
            tx.execute(sql, params![next.seq, now_ms()])?;
            enter(tx, next.seq, State::Running)?;
            get(tx, &next.id)
        })?;
        claimed.iter().for_each(|job| self.bells.ring(job.seq));
        Ok(claimed)
    }

    /// Puts a running job back, because the service stops; that attempt does not count.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn put_back(&self, seq: i64) -> Result<(), Error> {
        self.write(|tx| {
            tx.execute("UPDATE jobs SET attempts = attempts - 1 WHERE seq = ?1", [seq])?;
            enter(tx, seq, State::Queued)
        })
    }

    /// Ends a job, and makes its model known in the same transaction.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn finish(&self, job: &Job, done: &Done<'_>) -> Result<(), Error> {
        self.write(|tx| {
            if let Some((sha256, bytes)) = done.model {
                let sql = "INSERT INTO models (id, sha256, bytes, job, created_ms)
                    VALUES (?1, ?2, ?3, ?4, ?5) ON CONFLICT (id) DO NOTHING";
                let bytes = i64::try_from(bytes).unwrap_or(i64::MAX);
                tx.execute(sql, params![job.key, sha256, bytes, job.id, now_ms()])?;
            }
            let sql = "UPDATE jobs SET result = ?2, error = ?3 WHERE seq = ?1";
            tx.execute(sql, params![job.seq, done.result, done.error])?;
            enter(tx, job.seq, done.state)
        })?;
        self.bells.ring(job.seq);
        Ok(())
    }

    /// Asks a job to stop; one that waits is cancelled at once.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn cancel(&self, id: &str) -> Result<Cancelled, Error> {
        let outcome = self.write(|tx| {
            let Some(job) = get(tx, id)? else { return Ok(Cancelled::Unknown) };
            match job.state {
                State::Queued => enter(tx, job.seq, State::Cancelled)?,
                State::Running => enter(tx, job.seq, State::Cancelling)?,
                State::Cancelling => {}
                ended => return Ok(Cancelled::Ended(ended)),
            }
            Ok(get(tx, id)?.map_or(Cancelled::Unknown, |job| Cancelled::Yes(Box::new(job))))
        })?;
        if let Cancelled::Yes(job) = &outcome {
            self.bells.ring(job.seq);
        }
        Ok(outcome)
    }

    /// Forgets a job that has ended, with its scene, and with its data set where no other job has
    /// the same. Its model stays.
    ///
    /// # Errors
    /// What the database or the disk objects to.
    pub(in crate::serve) fn delete_job(&self, id: &str) -> Result<Deleted, Error> {
        let aside = self.folder.incoming()?;
        let held = aside.path().join("work");
        let mut moved = None;
        let outcome = self.write(|tx| {
            let Some(job) = get(tx, id)? else { return Ok(Deleted::Unknown) };
            if !job.state.is_final() {
                return Ok(Deleted::Active(job.state));
            }
            tx.execute("DELETE FROM events WHERE job = ?1", [job.seq])?;
            tx.execute("DELETE FROM logs WHERE job = ?1", [job.seq])?;
            tx.execute("DELETE FROM keys WHERE job = ?1", [id])?;
            tx.execute("DELETE FROM jobs WHERE seq = ?1", [job.seq])?;
            if !has_dataset(tx, &job.bake)? {
                // Now, while nobody can submit a job that would count on it; deleting takes longer.
                let work = self.folder.work(&job.bake);
                moved = set_aside(&work, &held)?.then_some(work);
            }
            Ok(Deleted::Yes)
        });
        if outcome.is_err()
            && let Some(work) = &moved
        {
            // The job is still there, and so is its data set.
            let _ = fs::rename(&held, work);
        }
        let outcome = outcome?;
        if matches!(outcome, Deleted::Yes) {
            remove(&self.folder.sources(id))?;
            remove(&self.folder.results(id))?;
        }
        Ok(outcome)
    }

    /// After a start: what was running waits again, what was to be cancelled is.
    pub(super) fn recover(&self) -> Result<(), Error> {
        self.write(|tx| {
            for (from, to) in
                [(State::Running, State::Queued), (State::Cancelling, State::Cancelled)]
            {
                let mut statement = tx.prepare("SELECT seq FROM jobs WHERE state = ?1")?;
                let rows = statement.query_map([from.name()], |row| row.get(0))?;
                for seq in rows.collect::<Result<Vec<i64>, _>>()? {
                    enter(tx, seq, to)?;
                }
            }
            Ok(())
        })
    }
}

/// Moves a folder away; whether it was there.
fn set_aside(from: &Path, to: &Path) -> Result<bool, Error> {
    match fs::rename(from, to) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(false),
        Err(source) => Err(Error::Io { action: "move", path: from.to_path_buf(), source }),
    }
}

fn has_dataset(tx: &rusqlite::Connection, bake: &str) -> Result<bool, Error> {
    let sql = "SELECT EXISTS (SELECT 1 FROM jobs WHERE bake = ?1)";
    Ok(tx.query_row(sql, [bake], |row| row.get(0))?)
}

/// Writes a job down as queued, or as done at once; its number.
fn insert(tx: &Transaction<'_>, new: &NewJob<'_>) -> Result<i64, Error> {
    let sql = "INSERT INTO jobs (id, state, priority, request, bake, fit, cached, result,
        created_ms, kind, memory_bytes) VALUES (?1, 'queued', ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)";
    let NewJob { id, kind, priority, request, bake, key, result, .. } = *new;
    let cached = result.is_some();
    let memory = i64::try_from(new.memory_bytes).unwrap_or(i64::MAX);
    let row = params![id, priority, request, bake, key, cached, result, now_ms(), kind, memory];
    tx.execute(sql, row)?;
    let seq = tx.last_insert_rowid();
    enter(tx, seq, State::Queued)?;
    if cached {
        enter(tx, seq, State::Succeeded)?;
    }
    Ok(seq)
}

fn by_key(tx: &rusqlite::Connection, key: &Key) -> Result<Option<Submitted>, Error> {
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
