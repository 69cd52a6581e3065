//! What a job had to say, line by line.

use rusqlite::params;

use super::{Error, Store, now_ms};

/// Lines of one job that are kept; the oldest go first.
const MOST_KEPT: i64 = 1000;

/// How grave a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::serve) enum Level {
    Info,
    Warning,
    Error,
}

impl Level {
    /// As clients read it.
    pub(in crate::serve) fn name(self) -> &'static str {
        match self {
            Self::Info => "info",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

/// One line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::serve) struct Line {
    /// From 1; gaps are lines that were dropped.
    pub(in crate::serve) id: i64,
    pub(in crate::serve) at_ms: i64,
    pub(in crate::serve) level: String,
    pub(in crate::serve) text: String,
}

impl Store {
    /// Adds a line to a job's log.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn log(&self, job: i64, level: Level, text: &str) -> Result<(), Error> {
        self.write(|tx| {
            let sql = "INSERT INTO logs SELECT ?1, COALESCE(MAX(id), 0) + 1, ?2, ?3, ?4
                FROM logs WHERE job = ?1 RETURNING id";
            let line = params![job, now_ms(), level.name(), text];
            let id: i64 = tx.query_row(sql, line, |row| row.get(0))?;
            let sql = "DELETE FROM logs WHERE job = ?1 AND id <= ?2";
            Ok(tx.execute(sql, params![job, id - MOST_KEPT]).map(drop)?)
        })
    }

    /// A job's log, the oldest line first.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn log_of(&self, job: i64) -> Result<Vec<Line>, Error> {
        let connection = self.lock();
        let sql = "SELECT id, at_ms, level, text FROM logs WHERE job = ?1 ORDER BY id";
        let mut statement = connection.prepare_cached(sql)?;
        let rows = statement.query_map([job], |row| {
            Ok(Line { id: row.get(0)?, at_ms: row.get(1)?, level: row.get(2)?, text: row.get(3)? })
        })?;
        Ok(rows.collect::<Result<_, _>>()?)
    }
}
