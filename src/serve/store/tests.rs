//! The store's promises without a network: states, keys, queue, fence and recovery.

use super::*;

fn new<'a>(id: &'a str, bake: &'a str) -> NewJob<'a> {
    NewJob { id, priority: 0, request: "{}", bake, fit: "f", result: None, most_queued: 3 }
}

fn accepted(store: &Store, new: &NewJob<'_>) -> Job {
    match store.submit(new, None).unwrap() {
        Submitted::New(job) => *job,
        other => panic!("{other:?}"),
    }
}

/// Higher priorities run first, then the order of arrival; two jobs of one bake never at once.
#[test]
fn jobs_are_claimed_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    accepted(&store, &new("a", "x"));
    accepted(&store, &new("b", "x"));
    accepted(&store, &NewJob { priority: 5, ..new("c", "y") });
    let full = store.submit(&new("d", "z"), None).unwrap();
    assert!(matches!(full, Submitted::Full(3)), "{full:?}");
    let claimed = || store.claim().unwrap().map(|job| job.id);
    assert_eq!(claimed().as_deref(), Some("c"));
    assert_eq!(claimed().as_deref(), Some("a"));
    assert_eq!(claimed(), None);
}

/// What was running waits again after a restart, with its events numbered on; what was to be
/// cancelled is cancelled.
#[test]
fn a_restart_recovers_every_job() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    for (id, bake) in [("a", "x"), ("b", "y")] {
        accepted(&store, &new(id, bake));
        store.claim().unwrap().unwrap();
    }
    assert!(matches!(store.cancel("b").unwrap(), Cancelled::Yes(_)));
    assert!(matches!(store.delete_job("b").unwrap(), Deleted::Active(State::Cancelling)));
    drop(store);
    let store = Store::open(folder.path()).unwrap();
    let state = |id: &str| store.job(id).unwrap().unwrap().state;
    assert_eq!((state("a"), state("b")), (State::Queued, State::Cancelled));
    let a = store.job("a").unwrap().unwrap();
    let ids: Vec<i64> = store.events(a.seq, 0).unwrap().iter().map(|event| event.id).collect();
    assert_eq!(ids, [1, 2, 3]);
    assert!(matches!(store.cancel("b").unwrap(), Cancelled::Ended(State::Cancelled)));
    assert!(matches!(store.delete_job("b").unwrap(), Deleted::Yes));
    assert!(matches!(store.delete_job("b").unwrap(), Deleted::Unknown));
}

/// One key is one job: the same body finds it, another body is refused, another owner is free.
#[test]
fn keys_name_one_submission() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let key = |owner: &str, body: &str| Key {
        owner: owner.into(),
        key: "k".into(),
        body_sha256: body.into(),
    };
    let submit = |id: &str, key: &Key| store.submit(&new(id, id), Some(key)).unwrap();
    assert!(matches!(submit("a", &key("me", "1")), Submitted::New(_)));
    assert!(matches!(submit("b", &key("me", "1")), Submitted::Same(job) if job.id == "a"));
    assert!(matches!(submit("c", &key("me", "2")), Submitted::OtherBody));
    assert!(matches!(submit("d", &key("you", "2")), Submitted::New(_)));
}

/// A folder has one owner: a second one is refused, and an owner whose place was taken writes
/// nothing more.
#[test]
fn a_lost_folder_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    assert!(matches!(Store::open(folder.path()), Err(Error::Taken(_))));
    store.lock().execute("UPDATE meta SET value = value + 1 WHERE key = 'epoch'", []).unwrap();
    assert!(matches!(store.submit(&new("a", "x"), None), Err(Error::Fenced)));
    assert!(matches!(store.claim(), Err(Error::Fenced)));
}

/// Tokens are found by hash only, expire, and can be taken back.
#[test]
fn tokens_live_and_die() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::visit(folder.path()).unwrap();
    assert!(!store.has_tokens().unwrap());
    let made = store.create_token("maya", "read write", 1).unwrap();
    let hash = hash_of(&made.secret);
    assert_eq!(store.token(&hash).unwrap().unwrap().name, "maya");
    assert!(store.token(&made.secret).unwrap().is_none());
    let expired = store.create_token("old", "read", 0).unwrap();
    assert!(store.token(&hash_of(&expired.secret)).unwrap().is_none());
    assert!(store.revoke_token("maya").unwrap());
    assert!(store.token(&hash).unwrap().is_none());
}
