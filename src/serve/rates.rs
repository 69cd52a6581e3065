//! How often each client may ask: a bucket of tokens for each, filled at a steady rate.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A client may save up requests for so many seconds.
const BURST_S: f64 = 2.0;

/// Buckets by client. Clients are the names of tokens, so there are few.
#[derive(Debug, Default)]
pub(super) struct Rates {
    buckets: Mutex<BTreeMap<String, Bucket>>,
}

#[derive(Debug, Clone, Copy)]
struct Bucket {
    left: f64,
    at: Instant,
}

impl Rates {
    /// Takes one request out of a client's bucket; where it is empty, how long until there is one.
    pub(super) fn take(&self, client: &str, rate_hz: u32, now: Instant) -> Result<(), Duration> {
        let rate = f64::from(rate_hz);
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        let full = Bucket { left: (rate * BURST_S).max(1.0), at: now };
        let bucket = buckets.entry(client.to_owned()).or_insert(full);
        let since = now.saturating_duration_since(bucket.at).as_secs_f64();
        bucket.left = (bucket.left + since * rate).min(full.left);
        bucket.at = now;
        if bucket.left < 1.0 {
            return Err(Duration::from_secs_f64((1.0 - bucket.left) / rate));
        }
        bucket.left -= 1.0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A burst passes, then the rate holds; what is saved up is bounded; clients do not share.
    #[test]
    fn each_client_has_its_own_rate() {
        let (rates, start) = (Rates::default(), Instant::now());
        let take = |client: &str, ms: u64| {
            rates.take(client, 10, start + Duration::from_millis(ms)).is_ok()
        };
        assert_eq!((0..30).filter(|_| take("a", 0)).count(), 20);
        assert!(!take("a", 50) && take("a", 151) && !take("a", 160));
        assert!(take("b", 160), "another client's bucket is full");
        assert_eq!((0..100).filter(|_| take("a", 3_600_000)).count(), 20);
        let wait = rates.take("a", 10, start + Duration::from_secs(3600)).unwrap_err();
        assert!(wait <= Duration::from_millis(100), "{wait:?}");
    }
}
