//! The store's promises without a network: states, keys, queue, fence and recovery.

use std::collections::BTreeSet;

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
        makes_model: false,
        result: None,
        most_queued: 3,
    }
}

/// The next job, with memory for any of [`new`].
fn claim(store: &Store) -> Option<Job> {
    store.claim(10, |_| true).unwrap().job
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
    let claimed = || claim(&store).map(|job| job.id);
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
        claim(&store).unwrap();
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
    assert!(matches!(store.claim(10, |_| true), Err(Error::Fenced)));
    assert!(matches!(store.progress(1, "{}"), Err(Error::Fenced)), "a running job hears of it");
}

/// Tokens are found by hash only, expire, and can be taken back.
#[test]
fn tokens_live_and_die() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::visit(folder.path()).unwrap();
    assert!(!store.has_tokens().unwrap());
    let made = store.create_token("maya", "read write", 1, false).unwrap();
    let hash = hash_of(&made.secret);
    assert_eq!(store.token(&hash).unwrap().unwrap().name, "maya");
    assert!(store.token(&made.secret).unwrap().is_none());
    let expired = store.create_token("old", "read", 0, false).unwrap();
    assert!(store.token(&hash_of(&expired.secret)).unwrap().is_none());
    let left =
        |name: &str| store.tokens().unwrap().iter().find(|t| t.name == name).unwrap().left_ms();
    assert!(left("old") <= 0 && left("maya") > 0);
    store.create_token("old", "read", 1, false).expect("the earlier one has expired");
    // Who uses one does not lose it by a name that is taken by mistake.
    let again = store.create_token("maya", "read", 1, false).unwrap_err();
    assert!(matches!(&again, Error::KnownToken(name) if name == "maya"), "{again}");
    assert!(store.token(&hash).unwrap().is_some());
    let other = store.create_token("maya", "read", 1, true).unwrap();
    assert!(store.token(&hash).unwrap().is_none());
    let hash = hash_of(&other.secret);
    assert!(store.revoke_token("maya").unwrap());
    assert!(store.token(&hash).unwrap().is_none());
}

/// A job that does not fit into the memory that is free waits and is told of, and lets smaller ones
/// pass only as long as it may.
#[test]
fn jobs_wait_for_memory() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let large = accepted(&store, &NewJob { memory_bytes: 100, priority: 9, ..new("large", "x") });
    accepted(&store, &new("small", "y"));
    accepted(&store, &new("other", "z"));
    let claim = |free, passes| {
        let Claim { job, waits } = store.claim(free, |seq| seq == large.seq && passes).unwrap();
        (job.map(|job| job.id), waits.map(|job| job.id))
    };
    let some = |id: &str| Some(id.to_owned());
    assert_eq!(claim(9, true), (None, some("large")));
    assert_eq!(claim(99, true), (some("small"), some("large")));
    assert_eq!(claim(99, false), (None, some("large")), "it is passed for ever");
    assert_eq!(claim(100, false), (some("large"), None));
    assert_eq!(claim(10, false), (some("other"), None));
    assert_eq!(store.claim(10, |_| true).unwrap(), Claim::default());
}

/// A job that is put back because of the disk waits again, and that attempt counts or does not.
#[test]
fn a_job_that_is_put_back_waits() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let seq = accepted(&store, &new("a", "x")).seq;
    for (counts, attempts) in [(false, 0), (true, 1), (false, 1)] {
        claim(&store).unwrap();
        store.put_back(seq, counts).unwrap();
        let job = store.job("a").unwrap().unwrap();
        assert_eq!((job.state, job.attempts), (State::Queued, attempts));
    }
}

/// A database without jobs, as after its file was lost, takes nothing away of what another has named;
/// one that broke a moment ago gets no empty one in its place, but a copy.
#[test]
fn an_empty_database_takes_nothing_away() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    accepted(&store, &new("a", "x"));
    let kept = [store.folder().results("a"), store.folder().sources("a"), store.folder().work("x")];
    for place in &kept {
        create(place).unwrap();
    }
    drop(store);
    let (path, copy) = (folder.path().join(DATABASE), folder.path().join("copy"));
    std::fs::rename(&path, &copy).unwrap();
    assert!(matches!(Store::reopen(folder.path()), Err(Error::Gone(_))));
    assert!(matches!(Store::visit(folder.path()), Err(Error::Gone(_))), "for the sake of a token");
    assert!(!path.exists());
    std::fs::write(&path, b"").unwrap();
    assert!(matches!(Store::reopen(folder.path()), Err(Error::Gone(_))), "a copy has just begun");
    let whole = std::fs::read(&copy).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let half = Store::reopen(folder.path()).unwrap_err();
    assert!(half.is_of_the_disk(), "{half}");
    std::fs::write(&path, &whole).unwrap();
    let store = Store::reopen(folder.path()).unwrap();
    assert!(store.job("a").unwrap().is_some());
    drop(store);
    // The operator's own start begins anew.
    std::fs::remove_file(&path).unwrap();
    drop(Store::open(folder.path()).unwrap());
    assert!(kept.iter().all(|place| place.is_dir()), "what hours have made is thrown away");
    let empty = tempfile::tempdir().unwrap();
    assert!(Store::reopen(empty.path()).is_ok(), "there is nothing to lose");
}

/// A part of the folder that takes no files is found; a try leaves nothing.
#[test]
fn a_folder_that_takes_no_writes_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    store.folder().probe().unwrap();
    for part in ["incoming", "work", "results", "models", "jobs", "assets"] {
        let path = folder.path().join(part);
        assert_eq!(std::fs::read_dir(&path).unwrap().count(), 0, "{part}: a try stays");
        std::fs::remove_dir(&path).unwrap();
        std::fs::write(&path, b"no folder").unwrap();
        let error = store.folder().probe().unwrap_err();
        assert!(error.takes_no_writes() && error.to_string().contains(part), "{error}");
        std::fs::remove_file(&path).unwrap();
        create(&path).unwrap();
    }
    store.folder().probe().unwrap();
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
    let sql = r#"INSERT INTO jobs (id, state, priority, request, bake, fit, cached, created_ms)
        VALUES ('a', 'succeeded', 0, '{"assets":{"n":"h","o":"h"}}', 'x', 'f', 0, 1)"#;
    old.execute(sql, []).unwrap();
    old.pragma_update(None, "user_version", 1).unwrap();
    drop(old);
    let store = Store::open(folder.path()).unwrap();
    assert_eq!(store.job("a").unwrap().unwrap().kind, "run");
    let uses: i64 = store
        .lock()
        .query_row("SELECT COUNT(*) FROM uses WHERE asset = 'h'", [], |row| row.get(0))
        .unwrap();
    assert_eq!(uses, 1);
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
    let large = format!("\"{}\"", "x".repeat(1 << 16));
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
    assert_eq!(store.due(&BTreeSet::new()).unwrap(), None);
    store.cancel("a").unwrap();
    let due = store.due(&BTreeSet::new()).unwrap().expect("a message");
    assert_eq!((due.url.as_str(), due.attempts), ("http://a/", 0));
    assert!(due.body.contains(r#""type":"job.cancelled""#), "{}", due.body);
    store.put_off(due.seq, 60_000).unwrap();
    assert_eq!(store.due(&BTreeSet::new()).unwrap(), None);
    store.lock().execute("UPDATE deliveries SET due_ms = due_ms + 1000000000000", []).unwrap();
    let again = store.due(&BTreeSet::new()).unwrap().expect("the clock went back");
    assert_eq!((again.id, again.attempts), (due.id, 1));
    store.settled(due.seq).unwrap();
    assert_eq!(store.due(&BTreeSet::new()).unwrap(), None);
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
    let first = claim(&store).unwrap();
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

/// Puts a file of one byte in its place as an asset.
fn add(store: &Store, name: &str) {
    let incoming = store.folder().incoming().unwrap();
    let file = incoming.path().join("file");
    std::fs::write(&file, b"x").unwrap();
    store.add_asset(name, 1, "file", &file).unwrap();
    assert!(store.folder().asset(name).is_file());
}

/// Assets that no job names go when they are old enough; one that is named stays, and so does one
/// that is new or was asked for lately.
#[test]
fn unused_assets_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let names = ["a", "b", "c", "d"].map(|name| name.repeat(64));
    for name in &names {
        add(&store, name);
    }
    let sql = "UPDATE assets SET created_ms = 5 WHERE sha256 != ?1";
    store.lock().execute(sql, [&names[2]]).unwrap();
    let request = format!(r#"{{"assets":{{"x":"{}"}}}}"#, names[1]);
    accepted(&store, &NewJob { request: &request, ..new("j", "x") });
    store.renew_asset(&names[3]).unwrap();
    assert_eq!(store.delete_unused_assets(6).unwrap(), 1);
    let there = |name: &String| {
        store.asset(name).unwrap().is_some() && store.folder().asset(name).is_file()
    };
    assert_eq!(names.each_ref().map(there), [false, true, true, true]);
    assert_eq!(store.asset(&names[3]).unwrap().unwrap().created_ms, 5, "it came when it came");
    let gone = format!(r#"{{"assets":{{"x/y":"{}"}}}}"#, names[0]);
    let refused = store.submit(&NewJob { request: &gone, ..new("k", "x") }, None).unwrap();
    assert!(matches!(&refused, Submitted::NoAsset(name) if name == "x/y"), "{refused:?}");
    store.cancel("j").unwrap();
    assert!(matches!(store.delete_job("j").unwrap(), Deleted::Yes));
    assert_eq!(store.delete_unused_assets(6).unwrap(), 1, "with its job goes its use");
}

/// An asset is deleted with its file as soon as no job that has not ended needs it, and can come again.
#[test]
fn assets_are_deleted() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let name = "a".repeat(64);
    add(&store, &name);
    let request = format!(r#"{{"assets":{{"x":"{name}"}}}}"#);
    accepted(&store, &NewJob { request: &request, ..new("j", "x") });
    let delete = || store.delete_asset(&name).unwrap();
    assert_eq!(delete(), Forgotten::Needed("j".into()));
    claim(&store).unwrap();
    assert_eq!(delete(), Forgotten::Needed("j".into()));
    store.cancel("j").unwrap();
    assert_eq!(delete(), Forgotten::Needed("j".into()), "it may still read it");
    store.recover().unwrap();
    assert_eq!(delete(), Forgotten::Yes);
    assert!(store.asset(&name).unwrap().is_none() && !store.folder().asset(&name).exists());
    assert_eq!(store.asset_bytes().unwrap(), 0);
    assert_eq!(delete(), Forgotten::Unknown);
    add(&store, &name);
}

/// More unused assets than one transaction looks at all go, and those between them that are used stay.
#[test]
fn unused_assets_go_in_batches() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let sql = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 2500)
        INSERT INTO assets SELECT printf('%064x', i), 1, 'file', 5, 0 FROM n";
    store.lock().execute(sql, []).unwrap();
    let used = "INSERT INTO uses SELECT sha256, 1 FROM assets WHERE sha256 LIKE '%0'";
    let used = store.lock().execute(used, []).unwrap();
    assert_eq!(store.delete_unused_assets(6).unwrap(), 2500 - used);
    assert_eq!(store.asset_bytes().unwrap(), used as u64);
}

/// The service's ends count until the bake has more whole files than when they last did; those of a
/// job that was put back do not count.
#[test]
fn ends_count_while_nothing_comes_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut store = Store::open(folder.path()).unwrap();
    let job = accepted(&store, &new("a", "x"));
    for blocks in 0..30 {
        claim(&store).unwrap();
        let ends = store.begin(job.seq, blocks).unwrap();
        assert_eq!(ends, 0, "it came further, whatever ended the service");
        drop(store);
        store = Store::open(folder.path()).unwrap();
    }
    for ends in 1..5 {
        claim(&store).unwrap();
        assert_eq!(store.begin(job.seq, 29).unwrap(), ends);
        drop(store);
        store = Store::open(folder.path()).unwrap();
    }
    claim(&store).unwrap();
    store.put_back(job.seq, false).unwrap();
    claim(&store).unwrap();
    assert_eq!(
        store.begin(job.seq, 3).unwrap(),
        5,
        "its data set is begun anew, but it is not more"
    );
    assert_eq!(store.begin(job.seq, 4).unwrap(), 0);
    assert_eq!(store.job("a").unwrap().unwrap().attempts, 35);
}

/// A model and its files come and go together, whoever makes it anew while it is deleted; what
/// remembers a deleted one is done again.
#[test]
fn models_have_their_files() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let finish = |id: &str, text: &str| {
        let job = accepted(&store, &NewJob { key: "m", makes_model: true, ..new(id, id) });
        let incoming = store.folder().incoming().unwrap();
        std::fs::write(incoming.path().join("model"), text).unwrap();
        let model = NewModel { sha256: "s", bytes: 1, folder: incoming.path() };
        let done =
            Done { state: State::Succeeded, result: Some("{}"), error: None, model: Some(model) };
        store.finish(&job, &done).unwrap();
        // Again, as after a transaction that failed when the files were in their place already.
        store.finish(&job, &done).unwrap();
    };
    let read = || std::fs::read_to_string(store.folder().model("m").join("model")).ok();
    finish("a", "first");
    finish("b", "second");
    assert_eq!(read().as_deref(), Some("first"), "what is there stays");
    assert!(store.delete_model("m").unwrap() && !store.delete_model("m").unwrap());
    assert_eq!((read(), store.model("m").unwrap()), (None, None));
    // Of a process that ended between the row and the files.
    create(&store.folder().model("m")).unwrap();
    std::fs::write(store.folder().model("m").join("model"), "left").unwrap();
    let cached = NewJob { key: "m", makes_model: true, result: Some("{}"), ..new("c", "c") };
    let again = accepted(&store, &cached);
    assert_eq!((again.state, again.cached), (State::Queued, false), "there is no such model");
    finish("d", "third");
    assert_eq!(read().as_deref(), Some("third"));
    let known = accepted(&store, &NewJob { id: "e", ..cached });
    assert_eq!((known.state, known.cached), (State::Succeeded, true));
    let left = std::fs::read_dir(folder.path().join("incoming")).unwrap().count();
    assert_eq!(left, 0, "what was set aside is deleted");
}

/// Models are made and deleted at once by many: at the end there is a row with its files, or neither.
#[test]
fn a_model_is_never_without_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    store.lock().pragma_update(None, "synchronous", "OFF").unwrap();
    let names: Vec<String> = (0..40).map(|index| format!("j{index}")).collect();
    let jobs: Vec<Job> = names
        .iter()
        .map(|id| {
            let new = NewJob { key: "m", makes_model: true, most_queued: 99, ..new(id, id) };
            accepted(&store, &new)
        })
        .collect();
    std::thread::scope(|scope| {
        scope.spawn(|| (0..40).filter(|_| store.delete_model("m").unwrap()).count());
        for job in &jobs {
            let incoming = store.folder().incoming().unwrap();
            std::fs::write(incoming.path().join("model"), "x").unwrap();
            let model = NewModel { sha256: "s", bytes: 1, folder: incoming.path() };
            let done =
                Done { state: State::Succeeded, result: None, error: None, model: Some(model) };
            store.finish(job, &done).unwrap();
        }
    });
    let files = store.folder().model("m").join("model").is_file();
    assert_eq!(store.model("m").unwrap().is_some(), files);
}

/// A receiver that is being told is passed over, and others are not.
#[test]
fn a_busy_receiver_holds_up_nobody_else() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    for (id, url) in [
        ("a", "http://One.example:80/x"),
        ("b", "http://one.example:80/y?z"),
        ("c", "https://two.example#z"),
    ] {
        let request = format!(r#"{{"webhook":{{"url":"{url}"}}}}"#);
        accepted(&store, &NewJob { request: &request, ..new(id, id) });
        store.cancel(id).unwrap();
    }
    let mut busy = BTreeSet::new();
    let mut next = || {
        let due = store.due(&busy).unwrap()?;
        busy.insert(due.host.clone());
        Some(due.host)
    };
    assert_eq!(next().as_deref(), Some("one.example:80"));
    assert_eq!(next().as_deref(), Some("two.example"));
    assert_eq!(next(), None);
}

/// To look at a folder, or to ask for its tokens, makes nothing; a folder that cannot be is told.
#[test]
fn looking_leaves_no_trace() {
    let folder = tempfile::tempdir().unwrap();
    let nowhere = folder.path().join("no/where");
    assert!(!Store::look(&nowhere).unwrap());
    assert!(matches!(Store::visit_known(&nowhere), Err(Error::NoService(_))));
    assert!(!nowhere.exists() && !folder.path().join("no").exists());
    std::fs::write(folder.path().join("file"), b"").unwrap();
    assert!(matches!(Store::look(&folder.path().join("file/x")), Err(Error::Io { .. })));
    let store = Store::open(&nowhere).unwrap();
    assert!(!Store::look(&nowhere).unwrap());
    Store::visit_known(&nowhere).unwrap().create_token("a", "read", 1, false).unwrap();
    assert!(Store::look(&nowhere).unwrap(), "beside the one that serves");
    drop(store);
    std::fs::write(nowhere.join(DATABASE), vec![7; 5000]).unwrap();
    assert!(Store::look(&nowhere).unwrap_err().is_of_the_disk());
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
