//! Lists that come page by page.

use serde::Deserialize;

use super::problem::Problem;

/// Entries of a page at most, and where nothing is said.
const MOST_LISTED: u32 = 100;

/// Which page of a list.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PageQuery {
    pub(super) page_size: Option<u32>,
    pub(super) page_token: Option<i64>,
}

impl PageQuery {
    /// Where the page starts and how long it is.
    ///
    /// # Errors
    /// `page_size` with its limit.
    pub(super) fn page(&self) -> Result<(i64, u32), Problem> {
        let count = self.page_size.unwrap_or(MOST_LISTED);
        if !(1..=MOST_LISTED).contains(&count) {
            let fault = format!("a page has 1 to {MOST_LISTED} entries");
            return Err(
                Problem::field("page_size", fault).limit("page_size", u64::from(MOST_LISTED))
            );
        }
        Ok((self.page_token.unwrap_or(i64::MAX), count))
    }
}
