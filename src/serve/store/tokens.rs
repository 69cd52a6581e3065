//! Access tokens. Only their hashes are kept.

use rusqlite::{Connection, Row, params};
use sha2::{Digest, Sha256};

use super::{Error, Store, hexadecimal, now_ms, random_id};

/// A token as it is kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Token {
    /// Who it is for.
    pub name: String,
    /// Separated by spaces: `read`, `write`.
    pub scopes: String,
    /// Milliseconds since 1970.
    pub expires_ms: i64,
}

/// A token that was just made.
#[derive(Debug)]
pub struct NewToken {
    /// What the client sends; shown once.
    pub secret: String,
    /// Milliseconds since 1970.
    pub expires_ms: i64,
}

/// The SHA-256 of what a client sends. A token has 256 random bits, so neither salt nor stretching
/// would add anything, and finding it by its hash tells a listener nothing of the token.
#[must_use]
pub(in crate::serve) fn hash_of(secret: &str) -> String {
    hexadecimal(&Sha256::digest(secret.as_bytes()))
}

/// Digits of a hash that a token is looked up by.
const SELECTOR: usize = 16;

/// Whether two hashes are the same, in a time that does not depend on where they differ.
fn is_same(a: &[u8], b: &[u8]) -> bool {
    let differing = a.iter().zip(b).fold(0, |all, (a, b)| std::hint::black_box(all | (a ^ b)));
    a.len() == b.len() && differing == 0
}

fn token(row: &Row<'_>) -> rusqlite::Result<Token> {
    Ok(Token { name: row.get(0)?, scopes: row.get(1)?, expires_ms: row.get(2)? })
}

impl Token {
    /// Milliseconds that it is still good for; below zero where it has expired.
    #[must_use]
    pub fn left_ms(&self) -> i64 {
        self.expires_ms.saturating_sub(now_ms())
    }
}

impl Store {
    /// Makes a token for `name`; one of that name that has expired goes, and one that has not, where it
    /// is to be replaced.
    ///
    /// # Errors
    /// [`Error::KnownToken`]; what the database objects to.
    pub fn create_token(
        &self,
        name: &str,
        scopes: &str,
        days: u32,
        replace: bool,
    ) -> Result<NewToken, Error> {
        let secret = format!("psl_{}{}", random_id()?, random_id()?);
        let expires_ms = now_ms().saturating_add(i64::from(days) * 86_400_000);
        self.write(|tx| {
            let sql = "DELETE FROM tokens WHERE name = ?1 AND (?2 OR expires_ms <= ?3)";
            tx.execute(sql, params![name, replace, now_ms()])?;
            let sql = "SELECT EXISTS (SELECT 1 FROM tokens WHERE name = ?1)";
            if tx.query_row(sql, [name], |row| row.get(0))? {
                return Err(Error::KnownToken(name.to_owned()));
            }
            let sql = "INSERT INTO tokens VALUES (?1, ?2, ?3, ?4, ?5)";
            tx.execute(sql, params![hash_of(&secret), name, scopes, now_ms(), expires_ms])?;
            Ok(())
        })?;
        Ok(NewToken { secret, expires_ms })
    }

    /// Removes a token; whether there was one.
    ///
    /// # Errors
    /// What the database objects to.
    pub fn revoke_token(&self, name: &str) -> Result<bool, Error> {
        self.write(|tx| Ok(tx.execute("DELETE FROM tokens WHERE name = ?1", [name])? > 0))
    }

    /// Every token, by name.
    ///
    /// # Errors
    /// What the database objects to.
    pub fn tokens(&self) -> Result<Vec<Token>, Error> {
        let connection = self.lock();
        let mut statement =
            connection.prepare("SELECT name, scopes, expires_ms FROM tokens ORDER BY name")?;
        let rows = statement.query_map([], token)?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    /// The token of this hash, where it has not expired. It is looked up by the first quarter of its
    /// hash and compared in constant time by all of it: how long that takes says nothing of the rest.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn token(&self, hash: &str) -> Result<Option<Token>, Error> {
        let connection = self.lock();
        let sql = "SELECT name, scopes, expires_ms, hash FROM tokens
            WHERE hash BETWEEN ?1 AND ?1 || 'g' AND expires_ms > ?2";
        let mut statement = connection.prepare_cached(sql)?;
        let first = hash.get(..SELECTOR).unwrap_or(hash);
        let mut rows = statement.query(params![first, now_ms()])?;
        let mut found = None;
        while let Some(row) = rows.next()? {
            let known: String = row.get(3)?;
            if is_same(known.as_bytes(), hash.as_bytes()) {
                found = Some(token(row)?);
            }
        }
        Ok(found)
    }

    /// Whether any token was ever made and not revoked.
    ///
    /// # Errors
    /// What the database objects to.
    pub(in crate::serve) fn has_tokens(&self) -> Result<bool, Error> {
        any(&self.lock())
    }
}

pub(super) fn any(tx: &Connection) -> Result<bool, Error> {
    Ok(tx.query_row("SELECT EXISTS (SELECT 1 FROM tokens)", [], |row| row.get(0))?)
}
