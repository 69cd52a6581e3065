//! Messages that wait to be delivered to those who asked to be told of a job's end.

use std::collections::BTreeSet;

use rusqlite::{OptionalExtension, Row, Transaction, params};
use serde_json::json;

use super::job::State;
use super::{Error, Store, now_ms, random_id};

/// A message that waits further ahead than this was put off by a clock that has since gone back.
const FURTHEST_MS: i64 = 24 * 3_600_000;

/// One message on its way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::serve) struct Delivery {
    pub(in crate::serve) seq: i64,
    /// The same for every attempt.
    pub(in crate::serve) id: String,
    /// The job that it is about.
    pub(in crate::serve) job: i64,
    pub(in crate::serve) url: String,
    /// JSON.
    pub(in crate::serve) body: String,
    /// How often it was tried.
    pub(in crate::serve) attempts: u32,
    /// Who takes it.
    pub(in crate::serve) host: String,
}

fn delivery(row: &Row<'_>) -> rusqlite::Result<Delivery> {
    Ok(Delivery {
        seq: row.get(0)?,
        id: row.get(1)?,
        job: row.get(2)?,
        url: row.get(3)?,
        body: row.get(4)?,
        attempts: row.get(5)?,
        host: row.get(6)?,
    })
}

/// Writes down the message that a job has ended, where its request names somebody to tell.
pub(super) fn add(tx: &Transaction<'_>, job: i64, state: State) -> Result<(), Error> {
    let sql = "SELECT id, kind, json_extract(request, '$.webhook.url') FROM jobs WHERE seq = ?1";
    let row = |row: &Row<'_>| Ok((row.get(0)?, row.get(1)?, row.get(2)?));
    let (id, kind, url): (String, String, Option<String>) = tx.query_row(sql, [job], row)?;
    let Some(url) = url else { return Ok(()) };
    let data =
        json!({ "id": id, "kind": kind, "state": state.name(), "href": format!("/v1/jobs/{id}") });
    let body = json!({
        "type": format!("job.{}", state.name()),
        "timestamp_ms": now_ms(),
        "data": data,
    });
    let sql = "INSERT INTO deliveries (id, job, url, body, attempts, due_ms, host)
        VALUES (?1, ?2, ?3, ?4, 0, 0, ?5)";
    let message = format!("msg_{}", random_id()?);
    tx.execute(sql, params![message, job, url, body.to_string(), host(&url)])?;
    Ok(())
}

/// Who takes the messages that go to an address: one that is silent holds up its own only.
fn host(url: &str) -> String {
    let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
    rest.split(['/', '?', '#']).next().unwrap_or_default().to_lowercase()
}

impl Store {
    /// The next message whose time has come and whose receiver is none of these.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn due(&self, busy: &BTreeSet<String>) -> Result<Option<Delivery>, Error> {
        let now = now_ms();
        let sql = "SELECT seq, id, job, url, body, attempts, host FROM deliveries
            WHERE (due_ms <= ?1 OR due_ms > ?2)
            AND host NOT IN (SELECT value FROM json_each(?3)) ORDER BY due_ms, seq LIMIT 1";
        let far = now.saturating_add(FURTHEST_MS);
        let busy = json!(busy).to_string();
        Ok(self.lock().query_row(sql, params![now, far, busy], delivery).optional()?)
    }

    /// Takes a message off the list, delivered or given up.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn settled(&self, seq: i64) -> Result<(), Error> {
        let sql = "DELETE FROM deliveries WHERE seq = ?1";
        self.write(|tx| Ok(tx.execute(sql, [seq]).map(drop)?))
    }

    /// Puts a message off after an attempt that failed.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn put_off(&self, seq: i64, wait_ms: i64) -> Result<(), Error> {
        let sql = "UPDATE deliveries SET attempts = attempts + 1, due_ms = ?2 WHERE seq = ?1";
        let due = now_ms().saturating_add(wait_ms);
        self.write(|tx| Ok(tx.execute(sql, params![seq, due]).map(drop)?))
    }
}
