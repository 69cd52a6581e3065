//! The store's promises without a network: states, keys, queue, fence and recovery.

use super::*;

fn new<'a>(id: &'a str, bake: &'a str) -> NewJob<'a> {
    NewJob {
        id,
        kind: "run",
        priority: 0,
        request: "{}",
        bake,
        key: "f",
        memory_bytes: 10,
        needs_dataset: false,
        result: None,
        most_queued: 3,
    }
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
    let claimed = || store.claim(10).unwrap().map(|job| job.id);
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
        store.claim(10).unwrap().unwrap();
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

/// The data set of the last job that was deleted is gone with it at once, and nothing else is.
#[test]
fn a_deleted_data_set_is_not_counted_on() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    for (id, bake) in [("a", "x"), ("b", "y")] {
        let job = accepted(&store, &new(id, bake));
        std::fs::create_dir_all(store.folder().work(&job.bake).join("dataset.zarr")).unwrap();
        assert!(matches!(store.cancel(id).unwrap(), Cancelled::Yes(_)));
    }
    assert!(matches!(store.delete_job("a").unwrap(), Deleted::Yes));
    assert!(!store.folder().work("x").exists() && store.folder().work("y").exists());
    let left = std::fs::read_dir(folder.path().join("incoming")).unwrap().count();
    assert_eq!(left, 0, "what was set aside is deleted");
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
    assert!(matches!(store.claim(10), Err(Error::Fenced)));
    assert!(matches!(store.progress(1, "{}"), Err(Error::Fenced)), "a running job hears of it");
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

/// A job that does not fit into the memory that is free waits, and lets smaller ones pass.
#[test]
fn jobs_wait_for_memory() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    accepted(&store, &NewJob { memory_bytes: 100, priority: 9, ..new("large", "x") });
    accepted(&store, &new("small", "y"));
    let claim = |free| store.claim(free).unwrap().map(|job| job.id);
    assert_eq!(claim(9), None);
    assert_eq!(claim(99).as_deref(), Some("small"));
    assert_eq!(claim(100).as_deref(), Some("large"));
}

/// A job on somebody else's data set is taken as long as some job has it, and keeps it; the folder
/// goes with the last of them.
#[test]
fn data_sets_live_as_long_as_their_jobs() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let fit = |id| NewJob { kind: "fit", needs_dataset: true, ..new(id, "x") };
    assert!(matches!(store.submit(&fit("early"), None).unwrap(), Submitted::NoDataset));
    accepted(&store, &NewJob { kind: "bake", result: Some("{}"), ..new("bake", "x") });
    let work = store.folder().work("x");
    create(&work).unwrap();
    accepted(&store, &fit("fit"));
    assert!(matches!(store.delete_job("bake").unwrap(), Deleted::Yes));
    assert!(work.is_dir(), "a job still needs it");
    assert!(store.succeeded("bake", "f").unwrap().is_none());
    store.cancel("fit").unwrap();
    assert!(matches!(store.delete_job("fit").unwrap(), Deleted::Yes));
    assert!(!work.exists());
}

/// Logs keep their order and their bound.
#[test]
fn logs_are_bounded() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    store.lock().pragma_update(None, "synchronous", "OFF").unwrap();
    for line in 0..1003 {
        store.log(1, Level::Info, &line.to_string()).unwrap();
    }
    let lines = store.log_of(1).unwrap();
    assert_eq!((lines.len(), lines[0].text.as_str()), (1000, "3"));
    assert_eq!(lines[999].id, 1003);
}

/// Tables of the first version are brought up to this one with what they hold; those of a later
/// build are refused and left as they are.
#[test]
fn old_tables_are_carried_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poselight.db");
    let old = Connection::open(&path).unwrap();
    old.execute_batch(TABLES).unwrap();
    let sql = "INSERT INTO jobs (id, state, priority, request, bake, fit, cached, created_ms)
        VALUES ('a', 'succeeded', 0, '{}', 'x', 'f', 0, 1)";
    old.execute(sql, []).unwrap();
    old.pragma_update(None, "user_version", 1).unwrap();
    drop(old);
    let store = Store::open(folder.path()).unwrap();
    assert_eq!(store.job("a").unwrap().unwrap().kind, "run");
    store.lock().pragma_update(None, "user_version", SCHEMA + 1).unwrap();
    drop(store);
    assert!(matches!(Store::open(folder.path()), Err(Error::Newer { found }) if found > SCHEMA));
}

/// A full database is a full disk to the client, and leaves what was there readable.
#[test]
fn a_full_database_refuses_and_keeps() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    accepted(&store, &new("a", "x"));
    let pages: i64 = store.lock().pragma_query_value(None, "page_count", |row| row.get(0)).unwrap();
    store.lock().pragma_update(None, "max_page_count", pages).unwrap();
    let large = "x".repeat(1 << 16);
    let error = store.submit(&NewJob { request: &large, ..new("b", "y") }, None).unwrap_err();
    let problem = crate::serve::problem::Problem::from(error);
    assert_eq!(problem.json()["type"], "/problems/storage-full");
    assert_eq!(problem.json()["status"], 507);
    assert!(store.job("a").unwrap().is_some() && store.job("b").unwrap().is_none());
}

/// Whoever asked is told once of a job's end, in the same transaction; what fails is put off, and a
/// clock that goes back an age does not put it off for an age.
#[test]
fn messages_wait_their_time() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    accepted(&store, &new("silent", "x"));
    accepted(&store, &NewJob { request: r#"{"webhook":{"url":"http://a/"}}"#, ..new("a", "y") });
    store.cancel("silent").unwrap();
    assert_eq!(store.due().unwrap(), None);
    store.cancel("a").unwrap();
    let due = store.due().unwrap().expect("a message");
    assert_eq!((due.url.as_str(), due.attempts), ("http://a/", 0));
    assert!(due.body.contains(r#""type":"job.cancelled""#), "{}", due.body);
    store.put_off(due.seq, 60_000).unwrap();
    assert_eq!(store.due().unwrap(), None);
    store.lock().execute("UPDATE deliveries SET due_ms = due_ms + 1000000000000", []).unwrap();
    let again = store.due().unwrap().expect("the clock went back");
    assert_eq!((again.id, again.attempts), (due.id, 1));
    store.settled(due.seq).unwrap();
    assert_eq!(store.due().unwrap(), None);
}

/// Order is by number, never by the clock: jobs and events of a future that has not come yet do not
/// upset those of now.
#[test]
fn a_clock_that_goes_back_changes_no_order() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    accepted(&store, &new("first", "x"));
    for sql in ["UPDATE jobs SET created_ms = 9e15", "UPDATE events SET at_ms = 9e15"] {
        store.lock().execute(sql, []).unwrap();
    }
    accepted(&store, &new("second", "y"));
    let listed = store.jobs(i64::MAX, None, None, 9).unwrap();
    assert_eq!(listed.iter().map(|job| job.id.as_str()).collect::<Vec<_>>(), ["second", "first"]);
    let first = store.claim(10).unwrap().unwrap();
    assert_eq!(first.id, "first");
    let ids: Vec<i64> = store.events(first.seq, 0).unwrap().iter().map(|e| e.id).collect();
    assert_eq!(ids, [1, 2]);
}

/// Damage is told at the start, as a matter of the disk.
#[test]
fn a_damaged_database_is_told() {
    let folder = tempfile::tempdir().unwrap();
    drop(Store::open(folder.path()).unwrap());
    let path = folder.path().join("poselight.db");
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[4096..].fill(0xa5);
    std::fs::write(&path, &bytes).unwrap();
    let error = Store::open(folder.path()).unwrap_err();
    assert!(error.is_of_the_disk(), "{error}");
    std::fs::write(&path, b"no database at all, but long enough to look like one").unwrap();
    let error = Store::open(folder.path()).unwrap_err();
    assert!(error.is_of_the_disk(), "{error}");
    assert!(!Error::Newer { found: 9 }.is_of_the_disk());
}

/// Assets that no job names go when they are old enough; one that is named stays, and so does one
/// that is new.
#[test]
fn unused_assets_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let names = ["a", "b", "c"].map(|name| name.repeat(64));
    for name in &names {
        let path = store.folder().asset(name);
        create(path.parent().unwrap()).unwrap();
        std::fs::write(path, b"x").unwrap();
        store.add_asset(name, 1, "file").unwrap();
    }
    let sql = "UPDATE assets SET created_ms = 5 WHERE sha256 != ?1";
    store.lock().execute(sql, [&names[2]]).unwrap();
    let request = format!(r#"{{"assets":{{"x":"{}"}}}}"#, names[1]);
    accepted(&store, &NewJob { request: &request, ..new("j", "x") });
    assert_eq!(store.delete_unused_assets(6).unwrap(), 1);
    let there = |name: &String| {
        store.asset(name).unwrap().is_some() && store.folder().asset(name).is_file()
    };
    assert_eq!(names.each_ref().map(there), [false, true, true]);
}

/// Only jobs that ended are old, the oldest first.
#[test]
fn ended_jobs_grow_old() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    for id in ["a", "b", "c"] {
        accepted(&store, &new(id, id));
    }
    store.cancel("b").unwrap();
    store.cancel("a").unwrap();
    assert_eq!(store.ended_before(i64::MAX).unwrap(), ["a", "b"]);
    assert!(store.ended_before(5).unwrap().is_empty());
}
