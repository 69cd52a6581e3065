//! What is kept for how long: jobs that have ended, their data sets, and assets that no job uses.
//! Models stay until somebody deletes them.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::store::{Deleted, now_ms};
use super::{Limits, Service, Store, StoreError, disk};

/// Between two looks.
const LOOK: Duration = Duration::from_secs(60);

/// Between two looks whether the service stops.
const GLANCE: Duration = Duration::from_millis(200);

const DAY_MS: i64 = 24 * 3_600_000;

/// Removes what is too old or too much, until the service stops.
pub(super) fn work(service: &Arc<Service>) {
    let limits = service.settings.limits;
    if limits.keep_days.is_none() && limits.keep_bytes.is_none() {
        return;
    }
    loop {
        if let Err(error) = look(&service.store, &limits) {
            tracing::error!(%error, "cannot remove what is too old or too much");
        }
        let start = Instant::now();
        while start.elapsed() < LOOK {
            if *service.stopping.borrow() {
                return;
            }
            std::thread::sleep(GLANCE);
        }
    }
}

fn look(store: &Store, limits: &Limits) -> Result<(), StoreError> {
    if let Some(days) = limits.keep_days {
        let before = now_ms().saturating_sub(i64::from(days) * DAY_MS);
        for job in store.ended_before(before)? {
            forget(store, &job)?;
        }
        let assets = store.delete_unused_assets(before)?;
        if assets > 0 {
            tracing::info!(assets, "removed what no job uses");
        }
    }
    limits.keep_bytes.map_or(Ok(()), |most| make_room(store, most))
}

/// Forgets the oldest jobs that have ended, as long as data sets of jobs have more bytes together; a
/// job that has none would make no room.
fn make_room(store: &Store, most: u64) -> Result<(), StoreError> {
    let mut sizes = BTreeMap::new();
    for bake in store.bakes()? {
        let bytes = disk::size(&store.folder().work(&bake));
        sizes.insert(bake, bytes);
    }
    for id in store.ended_before(i64::MAX)? {
        if sizes.values().sum::<u64>() <= most {
            break;
        }
        let Some(job) = store.job(&id)? else { continue };
        if sizes.get(&job.bake).is_none_or(|&bytes| bytes == 0) {
            continue;
        }
        forget(store, &id)?;
        if !store.has_dataset(&job.bake)? {
            sizes.remove(&job.bake);
        }
    }
    Ok(())
}

fn forget(store: &Store, job: &str) -> Result<(), StoreError> {
    if matches!(store.delete_job(job)?, Deleted::Yes) {
        tracing::info!(job, "forgotten");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::store::NewJob;

    /// Where data sets are larger together than they may be, the oldest job that has ended goes with
    /// its own; what has not ended, and what there is room for, stays.
    #[test]
    fn the_oldest_goes_first() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let store = Store::open(folder.path()).expect("a store");
        let work = |id: &str| store.folder().work(&id.repeat(64));
        for id in ["a", "b", "c"] {
            let (bake, request) = (id.repeat(64), r#"{"kind":"bake"}"#);
            let new = NewJob {
                id,
                kind: "bake",
                priority: 0,
                request,
                bake: &bake,
                key: &bake,
                memory_bytes: 0,
                needs_dataset: false,
                makes_model: false,
                result: (id != "a").then_some("{}"),
                most_queued: 10,
            };
            store.submit(&new, None).expect("accepted");
            std::fs::create_dir_all(work(id)).expect("made");
            std::fs::write(work(id).join("block"), [0; 100]).expect("written");
        }
        let there = || ["a", "b", "c"].map(|id| work(id).exists());
        let keep = |bytes| {
            let limits = Limits { keep_bytes: Some(bytes), ..Limits::default() };
            look(&store, &limits).expect("looked");
            there()
        };
        // Of nobody: it goes at the next start, and no job goes for it.
        std::fs::create_dir_all(work("d")).expect("made");
        std::fs::write(work("d").join("block"), [0; 1000]).expect("written");
        assert_eq!(keep(300), [true; 3]);
        assert_eq!(keep(250), [true, false, true], "`a` has not ended, `c` is younger");
        assert_eq!(keep(10), [true, false, false]);
        assert!(store.job("a").expect("read").is_some() && store.job("b").expect("read").is_none());
        drop(store);
        let store = Store::open(folder.path()).expect("a store");
        assert!(!store.folder().work(&"d".repeat(64)).exists(), "it is nobody's");
        assert!(store.folder().work(&"a".repeat(64)).exists());
    }
}
