//! Answers to queries for the estimate, the health and the info of this vehicle, and the errors for what they ask wrongly.
//! Those for its last rounds the vehicle answers itself.

use crate::backlog::Backlogs;
use crate::operator::Operator;
use crate::published::Published;
use crate::queue::Queue;
use serde::Serialize;
use skein_proto::document::ErrorDocument;
use skein_proto::keys::Key;
use skein_proto::name::Name;
use zenoh::Wait;
use zenoh::bytes::Encoding;
use zenoh::query::Query;

/// Queries that wait for an answer at most; more are dropped, which ends them without a reply.
pub(crate) const QUERIES_MAX: usize = 256;

/// A query and what it is for.
pub(crate) struct Question {
    pub(crate) wish: Wish,
    pub(crate) query: Query,
}

/// What a query wants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wish {
    /// A document.
    Tell(About),
    /// Something done: the verb under `@rpc`.
    Do(Name),
    /// The vehicle's last rounds.
    Backlog,
}

/// The documents that are answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum About {
    Estimate,
    Health,
    Info,
}

impl About {
    pub(crate) const ALL: [Self; 3] = [Self::Estimate, Self::Health, Self::Info];

    pub(crate) fn key(self, of: Name) -> Key {
        match self {
            Self::Estimate => Key::Estimate { of },
            Self::Health => Key::Health { of },
            Self::Info => Key::Info { of },
        }
    }
}

/// Answers until the queue is closed.
pub(crate) fn answer_all(
    questions: &Queue<Question>,
    fleet: Name,
    published: &Published,
    operator: &Operator,
    backlogs: &Backlogs,
) {
    let vehicle = published.info().vehicle;
    while let Some(Question { wish, query }) = questions.pop() {
        let parameters = query.parameters().as_str().to_owned();
        let answered = match wish {
            Wish::Tell(about) => answer(about, &parameters, published)
                .map(|(bytes, encoding)| (about.key(vehicle), bytes, encoding)),
            Wish::Do(verb) => {
                let payload = query.payload().map(|payload| payload.to_bytes());
                let done = operator.obey(verb, payload.as_deref().unwrap_or_default());
                let key = Key::Rpc { on: vehicle, verb };
                done.map(|document| (key, json(&document), Encoding::APPLICATION_JSON))
            }
            Wish::Backlog => match backlogs.pass_on(&query) {
                Ok(()) => continue,
                Err(error) => Err(error),
            },
        };
        let sent = match answered {
            Ok((key, bytes, encoding)) => query
                // Under our own key: the query's may have wildcards.
                .reply(key.in_fleet(fleet), bytes)
                .encoding(encoding)
                .wait(),
            Err(error) => query
                .reply_err(json(&error))
                .encoding(Encoding::APPLICATION_JSON)
                .wait(),
        };
        if let Err(error) = sent {
            tracing::debug!(%error, ?wish, "a reply could not be sent");
        }
    }
}

/// The bytes of an answer and their encoding, or the error to send.
fn answer(
    about: About,
    parameters: &str,
    published: &Published,
) -> Result<(Vec<u8>, Encoding), ErrorDocument> {
    let binary = wants_binary(about, parameters)?;
    let bytes = match about {
        About::Estimate => {
            let estimate = published.estimate().ok_or_else(nothing_yet)?;
            if binary {
                return Ok((estimate.packet.clone(), Encoding::APPLICATION_OCTET_STREAM));
            }
            json(&estimate.document)
        }
        About::Health => json(published.health().ok_or_else(nothing_yet)?.as_ref()),
        About::Info => json(published.info()),
    };
    Ok((bytes, Encoding::APPLICATION_JSON))
}

/// Whether the binary form is asked for; an error for parameters that are not of the contract.
fn wants_binary(about: About, parameters: &str) -> Result<bool, ErrorDocument> {
    let mut binary = false;
    for parameter in parameters.split(';').filter(|p| !p.is_empty()) {
        let (name, value) = parameter.split_once('=').unwrap_or((parameter, ""));
        match (about, name, value) {
            // Zenoh's own parameters begin with an underscore.
            (_, own, _) if own.starts_with('_') => {}
            (_, "encoding", "json") => {}
            (About::Estimate, "encoding", "postcard") => binary = true,
            (_, "encoding", other) => {
                return Err(ErrorDocument {
                    code: "unknown_encoding".to_owned(),
                    message: format!(
                        "there is no encoding {other:?} of this document; use json, or for the estimate postcard"
                    ),
                });
            }
            (_, other, _) => {
                return Err(ErrorDocument {
                    code: "unknown_parameter".to_owned(),
                    message: format!("there is no parameter {other:?}; the only one is encoding"),
                });
            }
        }
    }
    Ok(binary)
}

fn nothing_yet() -> ErrorDocument {
    ErrorDocument {
        code: "not_ready".to_owned(),
        message: "the vehicle has just started: ask again".to_owned(),
    }
}

/// JSON of a document of the contract.
pub(crate) fn json<T: Serialize>(document: &T) -> Vec<u8> {
    serde_json::to_vec(document).expect("documents have string keys and always serialise")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_is_the_default_and_postcard_is_for_the_estimate_only() {
        assert_eq!(wants_binary(About::Estimate, ""), Ok(false));
        assert_eq!(wants_binary(About::Estimate, "encoding=postcard"), Ok(true));
        assert_eq!(
            wants_binary(About::Estimate, "_time=[now(-1s)..]"),
            Ok(false)
        );
        assert_eq!(
            wants_binary(About::Health, "encoding=postcard")
                .unwrap_err()
                .code,
            "unknown_encoding"
        );
    }

    #[test]
    fn an_unknown_parameter_is_named_in_the_error() {
        let error = wants_binary(About::Estimate, "encoding=json;format=xml").unwrap_err();
        assert_eq!(error.code, "unknown_parameter");
        assert!(error.message.contains("\"format\""));
    }
}
