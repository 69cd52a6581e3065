//! Room for assets: what is on its way counts as if it were kept, or uploads side by side, or of a
//! length that nobody tells, would each find room for itself.

use std::sync::{Arc, Mutex, PoisonError};

use axum::http::StatusCode;

use super::problem::Problem;
use super::{Service, StoreError};

/// Bytes that are reserved ahead where a length is not told: the store is asked once for each.
const STEP: u64 = 4 << 20;

/// Bytes of all assets that are on their way.
#[derive(Debug, Default)]
pub(super) struct Room {
    taken: Mutex<u64>,
}

impl Room {
    /// Takes room for more bytes where there is; what is kept is asked for while nobody else takes
    /// any.
    fn take(
        &self,
        bytes: u64,
        most: u64,
        kept: impl FnOnce() -> Result<u64, StoreError>,
    ) -> Result<bool, StoreError> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let all = taken.saturating_add(bytes);
        let fits = kept()?.saturating_add(all) <= most;
        if fits {
            *taken = all;
        }
        Ok(fits)
    }

    fn give(&self, bytes: u64) {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        *taken = taken.saturating_sub(bytes);
    }
}

/// The room of one upload, until it is kept or given up.
#[derive(Debug)]
pub(super) struct Place {
    room: Arc<Room>,
    bytes: u64,
}

impl Place {
    /// A place of no size.
    pub(super) fn new(service: &Service) -> Self {
        Self { room: Arc::clone(&service.room), bytes: 0 }
    }

    /// Whether it has room for so many bytes already.
    pub(super) fn holds(&self, bytes: u64) -> bool {
        bytes <= self.bytes
    }

    /// Makes it large enough for so many bytes, which are all that there will be.
    ///
    /// # Errors
    /// `storage-full` with the limit.
    pub(super) fn hold(&mut self, service: &Service, bytes: u64) -> Result<(), Problem> {
        let most = service.settings.limits.assets_bytes;
        match self.grow(bytes, most, || service.store.asset_bytes())? {
            true => Ok(()),
            false => Err(full(most)),
        }
    }

    /// Makes it large enough for so many bytes, and for some that may follow.
    ///
    /// # Errors
    /// `storage-full` with the limit.
    pub(super) fn hold_more(&mut self, service: &Service, bytes: u64) -> Result<(), Problem> {
        let most = service.settings.limits.assets_bytes;
        let ahead = bytes.saturating_add(STEP);
        if self.grow(ahead, most, || service.store.asset_bytes())? {
            return Ok(());
        }
        self.hold(service, bytes)
    }

    fn grow(
        &mut self,
        bytes: u64,
        most: u64,
        kept: impl FnOnce() -> Result<u64, StoreError>,
    ) -> Result<bool, StoreError> {
        let fits = self.room.take(bytes.saturating_sub(self.bytes), most, kept)?;
        if fits {
            self.bytes = self.bytes.max(bytes);
        }
        Ok(fits)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.room.give(self.bytes);
    }
}

fn full(most: u64) -> Problem {
    let detail = "all assets together would be over the limit; delete some that are not needed any more \
                  (`DELETE /v1/assets/{sha256}`), or let whoever runs the service raise it \
                  (`--max-assets-gib`) or have unused ones forgotten (`--keep-days`)";
    Problem::new(StatusCode::INSUFFICIENT_STORAGE, "storage-full", detail)
        .limit("assets_bytes", most)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(room: &Arc<Room>) -> Place {
        Place { room: Arc::clone(room), bytes: 0 }
    }

    /// Uploads side by side share what is left beside what is kept, one that grows takes only what it
    /// lacks, one that ends gives back what it had, and a refusal takes nothing.
    #[test]
    fn uploads_share_what_is_left() {
        let room = Arc::new(Room::default());
        let grow = |place: &mut Place, bytes| place.grow(bytes, 100, || Ok(40)).expect("asked");
        let (mut a, mut b) = (place(&room), place(&room));
        assert!(grow(&mut a, 30) && grow(&mut b, 30), "there is room for both");
        assert!(!grow(&mut b, 31) && !grow(&mut a, u64::MAX), "one byte too many");
        assert!(b.holds(30) && !b.holds(31), "a refusal changes nothing");
        drop(a);
        assert!(grow(&mut b, 60) && !grow(&mut b, 61));
        drop(b);
        assert_eq!(*room.taken.lock().expect("sound"), 0);
        let mut c = place(&room);
        assert!(c.grow(1, 100, || Err(StoreError::Fenced)).is_err());
        assert!(grow(&mut c, 0) && !c.grow(0, 39, || Ok(40)).expect("asked"), "it is over already");
    }

    /// Many threads take no more than there is.
    #[test]
    fn threads_take_no_more_than_there_is() {
        let room = Arc::new(Room::default());
        let places: Vec<Place> = std::thread::scope(|scope| {
            let take = || {
                let mut mine = place(&room);
                while mine.grow(mine.bytes + 7, 1000, || Ok(0)).expect("asked") {}
                mine
            };
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(take)).collect();
            threads.into_iter().map(|thread| thread.join().expect("a place")).collect()
        });
        let all: u64 = places.iter().map(|place| place.bytes).sum();
        assert!((994..=1000).contains(&all), "{all}");
    }
}
