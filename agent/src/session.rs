//! Opening and closing a Zenoh session: opened with retry and a clear message, closed within a bounded time.

use crate::clock::real_now;
use crate::life::Life;
use crate::network::NetworkSettings;
use std::sync::mpsc;
use std::time::Duration;
use zenoh::{Session, Wait};

/// First and longest pause between two attempts to open.
const RETRY: (Duration, Duration) = (Duration::from_millis(500), Duration::from_secs(5));
/// How long closing may take: a partition would hold it for ten seconds.
pub(crate) const CLOSE_WITHIN: Duration = Duration::from_millis(600);

/// Opens a session, as often as it takes. None when the agent is stopping.
pub(crate) fn open_with_retry(network: &NetworkSettings, life: &Life) -> Option<Session> {
    let mut pause = RETRY.0;
    while !life.is_stopping() {
        let opened = network
            .zenoh()
            .map_err(|error| error.to_string())
            .and_then(|config| {
                zenoh::open(config)
                    .wait()
                    .map_err(|error| error.to_string())
            });
        match opened {
            Ok(session) => return Some(session),
            Err(reason) => {
                tracing::error!(
                    %reason,
                    retry_s = pause.as_secs_f64(),
                    listen = ?network.listen,
                    "the Zenoh session cannot be opened: is the port free and the address this machine's? nobody hears this vehicle meanwhile"
                );
                life.set_trouble(reason);
            }
        }
        if !life.wait_until(real_now() + pause) {
            return None;
        }
        pause = (2 * pause).min(RETRY.1);
    }
    None
}

/// Closes a session, and drops `first` before it. Returns after [`CLOSE_WITHIN`] at the latest; what is not done then
/// ends in the background.
pub(crate) fn close<T: Send + 'static>(session: Session, first: T) {
    let (done, closed) = mpsc::channel();
    let closing = std::thread::Builder::new()
        .name("skein-close".to_owned())
        .spawn(move || {
            drop(first);
            let result = session.close().wait();
            drop(session);
            // Nobody listens any more when closing took too long.
            let _ = done.send(result.map_err(|error| error.to_string()));
        });
    if closing.is_err() {
        return;
    }
    match closed.recv_timeout(CLOSE_WITHIN) {
        Ok(Ok(())) => {}
        Ok(Err(reason)) => tracing::warn!(%reason, "the Zenoh session did not close cleanly"),
        Err(_) => tracing::warn!("the Zenoh session is still closing in the background"),
    }
}
