//! Messages to those who asked to be told of a job's end, signed as Standard Webhooks 1.0 has it,
//! tried again with growing pauses.
//!
//! *Invariant:* nothing is sent to a private address unless the settings allow it: a name is looked
//! up once for each attempt, all its addresses are checked, and those very addresses are connected
//! to; the name only meets the receiver's certificate. Redirects are not followed.

mod address;
mod post;
mod sign;
mod tls;

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::problem::Problem;
use super::store::{Delivery, Job, Level};
use super::{Service, StoreError, recorder};

pub(super) use address::Target;
use rustls::ClientConfig;
pub use sign::{BadSecret, Secret};
pub use tls::{Authorities, BadAuthorities};

/// Between two looks for messages whose time has come.
const LOOK: Duration = Duration::from_millis(500);

/// Receivers that are told at once.
const AT_ONCE: usize = 8;

/// Pauses after each attempt that failed, seconds; after the last the message is given up.
const PAUSES_S: [u32; 8] = [5, 30, 120, 900, 3600, 4 * 3600, 8 * 3600, 12 * 3600];

/// Checks what a client wants to be told at, as far as that can be done without a look-up.
///
/// # Errors
/// The field at fault.
pub(super) fn check(service: &Service, url: &str) -> Result<(), Problem> {
    let fault = |fault: String| Problem::field("#/webhook/url", fault);
    if service.settings.webhooks.secret.is_none() {
        let lack =
            "this service has no secret to sign messages with (its setting `webhook-secret`)";
        return Err(fault(lack.to_owned()));
    }
    let target = Target::read(url).map_err(fault)?;
    target.check_literal(service.settings.webhooks.private).map_err(fault)
}

/// Delivers messages until the service stops: some receivers at once, each one message at a time, so
/// that one which is silent holds up its own only.
pub(super) fn work(service: &Arc<Service>) {
    let Some(secret) = &service.settings.webhooks.secret else { return };
    let trust = match tls::config(&service.settings.webhooks.authorities) {
        Ok(trust) => trust,
        Err(error) => return tracing::error!(%error, "no message can be sent"),
    };
    let sender = Sender { service, secret, trust };
    let busy = Mutex::new(BTreeSet::new());
    let busy = || busy.lock().unwrap_or_else(PoisonError::into_inner);
    std::thread::scope(|scope| {
        while !*service.stopping.borrow() {
            let mut told = busy();
            let due = if told.len() < AT_ONCE { service.store.due(&told) } else { Ok(None) };
            match due {
                Ok(Some(delivery)) => {
                    told.insert(delivery.host.clone());
                    drop(told);
                    let (sender, busy) = (&sender, &busy);
                    scope.spawn(move || {
                        if let Err(error) = sender.deliver(&delivery) {
                            tracing::error!(%error, "cannot write down a delivery");
                            std::thread::sleep(LOOK);
                        }
                        busy().remove(&delivery.host);
                    });
                    continue;
                }
                Ok(None) => {}
                Err(error) => tracing::error!(%error, "cannot look for deliveries"),
            }
            drop(told);
            std::thread::sleep(LOOK);
        }
    });
}

/// Why a message did not arrive.
struct Fault {
    text: String,
    /// Whether another attempt makes no sense.
    is_final: bool,
}

/// What messages are sent with.
struct Sender<'a> {
    service: &'a Service,
    secret: &'a Secret,
    trust: Arc<ClientConfig>,
}

impl Sender<'_> {
    /// One attempt, and what becomes of the message.
    fn deliver(&self, delivery: &Delivery) -> Result<(), StoreError> {
        let outcome = self.attempt(delivery);
        let service = self.service;
        let job = service.store.job_by_seq(delivery.job)?;
        let log = |level, text: &str| match &job {
            Some(job) => recorder::log(service, job as &Job, level, text),
            None => tracing::info!(message = delivery.id, "{text}"),
        };
        let Err(fault) = outcome else {
            log(Level::Info, "the webhook took the message");
            return service.store.settled(delivery.seq);
        };
        let pause = PAUSES_S.get(delivery.attempts as usize).filter(|_| !fault.is_final);
        match pause {
            Some(&seconds) => {
                log(Level::Warning, &format!("webhook: {}; again in {seconds} s", fault.text));
                service.store.put_off(delivery.seq, i64::from(seconds) * 1000)
            }
            None => {
                log(Level::Error, &format!("webhook: {}; given up", fault.text));
                service.store.settled(delivery.seq)
            }
        }
    }

    fn attempt(&self, delivery: &Delivery) -> Result<(), Fault> {
        let later = |text: String| Fault { text, is_final: false };
        let target = Target::read(&delivery.url).map_err(|text| Fault { text, is_final: true })?;
        let addresses = target.resolve(self.service.settings.webhooks.private).map_err(later)?;
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        let signature = self.secret.sign(&delivery.id, seconds, delivery.body.as_bytes());
        let headers = [
            ("webhook-id", delivery.id.clone()),
            ("webhook-timestamp", seconds.to_string()),
            ("webhook-signature", signature),
        ];
        let body = delivery.body.as_bytes();
        let status = post::post(&target, &addresses, &self.trust, &headers, body)
            .map_err(|error| later(format!("{}: {error}", target.host())))?;
        match status {
            200..=299 => Ok(()),
            // Gone: the receiver wants no more.
            410 => Err(Fault { text: "the answer was 410".to_owned(), is_final: true }),
            other => Err(later(format!("the answer was {other}"))),
        }
    }
}
