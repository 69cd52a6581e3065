//! The table of jobs, and every change of a job's state.

use std::collections::{BTreeMap, BTreeSet};

use rusqlite::{OptionalExtension, Row, Transaction, params};
use serde_json::json;

use super::job::{Cancelled, Claim, Done, Job, State};
use super::submit::has_dataset;
use super::{Error, Store, deliveries, events, models, now_ms};

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

pub(super) fn get(tx: &rusqlite::Connection, id: &str) -> Result<Option<Job>, Error> {
    let sql = format!("SELECT {COLUMNS} FROM jobs WHERE id = ?1");
    Ok(tx.query_row(&sql, [id], job).optional()?)
}

/// The first job in the queue that takes at most so much memory and whose data set nobody works on.
fn next(tx: &Transaction<'_>, memory_bytes: u64) -> Result<Option<Job>, Error> {
    let sql = format!(
        "SELECT {COLUMNS} FROM jobs WHERE state = 'queued' AND memory_bytes <= ?1
        AND bake NOT IN (SELECT bake FROM jobs WHERE state IN ('running', 'cancelling'))
        ORDER BY priority DESC, seq LIMIT 1"
    );
    let memory = i64::try_from(memory_bytes).unwrap_or(i64::MAX);
    Ok(tx.query_row(&sql, [memory], job).optional()?)
}

/// Moves a job to a state, with the event that says so.
pub(super) fn enter(tx: &Transaction<'_>, seq: i64, state: State) -> Result<(), Error> {
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
        self.names("SELECT id FROM jobs")
    }

    /// The bakes that jobs are of: what else is among the data sets is nobody's.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn bakes(&self) -> Result<BTreeSet<String>, Error> {
        self.names("SELECT DISTINCT bake FROM jobs")
    }

    fn names(&self, sql: &str) -> Result<BTreeSet<String>, Error> {
        let connection = self.lock();
        let mut statement = connection.prepare_cached(sql)?;
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

    /// The next job to run, now marked as running: the first in the queue or, where that takes more
    /// memory than there is and `may_pass` says so of its number, the first behind it that does not.
    /// Two jobs of one bake never run at once, for they write to one data set.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn claim(
        &self,
        memory_bytes: u64,
        may_pass: impl FnOnce(i64) -> bool,
    ) -> Result<Claim, Error> {
        let claim = self.write(|tx| {
            let Some(first) = next(tx, u64::MAX)? else { return Ok(Claim::default()) };
            let fits = first.memory_bytes <= memory_bytes;
            let passes = !fits && may_pass(first.seq);
            let (job, waits) = match fits {
                true => (Some(first), None),
                false if passes => (next(tx, memory_bytes)?, Some(first)),
                false => (None, Some(first)),
            };
            let Some(job) = job else { return Ok(Claim { job: None, waits }) };
            let sql = "UPDATE jobs SET attempts = attempts + 1,
                started_ms = COALESCE(started_ms, ?2) WHERE seq = ?1";
            tx.execute(sql, params![job.seq, now_ms()])?;
            enter(tx, job.seq, State::Running)?;
            Ok(Claim { job: get(tx, &job.id)?, waits })
        })?;
        claim.job.iter().for_each(|job| self.bells.ring(job.seq));
        Ok(claim)
    }

    /// Puts a running job back, because the service stops or its disk takes no writes; that attempt
    /// may count or not.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn put_back(&self, seq: i64, counts: bool) -> Result<(), Error> {
        self.write(|tx| {
            let sql = "UPDATE jobs SET attempts = attempts - ?2 WHERE seq = ?1";
            tx.execute(sql, params![seq, i64::from(!counts)])?;
            enter(tx, seq, State::Queued)
        })?;
        self.bells.ring(seq);
        Ok(())
    }

    /// Ends a job. Its model is put into its place and made known in the same transaction, so that
    /// nobody who deletes one of that name comes between.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn finish(&self, job: &Job, done: &Done<'_>) -> Result<(), Error> {
        self.write(|tx| {
            if let Some(model) = &done.model {
                models::add(tx, &self.folder, job, model)?;
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

    /// Takes note, as an attempt at a job begins, of how many whole files its bake has come to; how
    /// often the service has ended while it ran the job since there were last more of them.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn begin(&self, seq: i64, whole: u64) -> Result<i64, Error> {
        let sql = "UPDATE jobs SET ends = CASE WHEN ?2 > whole THEN 0 ELSE ends END, whole = ?2
            WHERE seq = ?1 RETURNING ends";
        let whole = i64::try_from(whole).unwrap_or(i64::MAX);
        self.write(|tx| Ok(tx.query_row(sql, params![seq, whole], |row| row.get(0))?))
    }

    /// After a start: what was running waits again, what was to be cancelled is.
    pub(super) fn recover(&self) -> Result<(), Error> {
        self.write(|tx| {
            tx.execute("UPDATE jobs SET ends = ends + 1 WHERE state = 'running'", [])?;
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
