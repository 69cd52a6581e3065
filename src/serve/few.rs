//! Lists of a document that are counted while they are read: one that is too long is refused before the
//! rest of it takes any memory.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, IgnoredAny, SeqAccess, Visitor};

/// How every refusal of a list that is too long begins.
const TOO_MANY: &str = "too many are given; at most ";

/// Whether a fault is that of a list that is too long.
pub(super) fn is_too_many(fault: &str) -> bool {
    fault.starts_with(TOO_MANY)
}

/// At most so many.
struct Few<T, const MOST: usize>(Vec<T>);

impl<'de, T: Deserialize<'de>, const MOST: usize> Deserialize<'de> for Few<T, MOST> {
    fn deserialize<D: Deserializer<'de>>(given: D) -> Result<Self, D::Error> {
        given.deserialize_seq(Counter::<T, MOST>(PhantomData)).map(Self)
    }
}

struct Counter<T, const MOST: usize>(PhantomData<T>);

impl<'de, T: Deserialize<'de>, const MOST: usize> Visitor<'de> for Counter<T, MOST> {
    type Value = Vec<T>;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a sequence")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut given: A) -> Result<Vec<T>, A::Error> {
        let mut all = Vec::new();
        while all.len() < MOST {
            match given.next_element()? {
                Some(one) => all.push(one),
                None => return Ok(all),
            }
        }
        match given.next_element::<IgnoredAny>()? {
            None => Ok(all),
            Some(_) => Err(A::Error::custom(format!("{TOO_MANY}{MOST} are taken at once"))),
        }
    }
}

/// A list of at most `MOST`.
pub(super) fn list<'de, D, T, const MOST: usize>(given: D) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    Few::<T, MOST>::deserialize(given).map(|few| few.0)
}

/// A list of at most `MOST`, or none.
pub(super) fn maybe<'de, D, T, const MOST: usize>(given: D) -> Result<Option<Vec<T>>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    Option::<Few<T, MOST>>::deserialize(given).map(|few| few.map(|few| few.0))
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    thread_local! {
        static READ: Cell<usize> = const { Cell::new(0) };
    }

    /// Counts how many of it were made.
    #[derive(Debug)]
    struct Counted;

    impl<'de> Deserialize<'de> for Counted {
        fn deserialize<D: Deserializer<'de>>(given: D) -> Result<Self, D::Error> {
            READ.set(READ.get() + 1);
            IgnoredAny::deserialize(given).map(|_| Self)
        }
    }

    #[derive(Debug, serde::Deserialize)]
    struct Document {
        #[serde(default, deserialize_with = "maybe::<_, _, 3>")]
        few: Option<Vec<Counted>>,
    }

    /// As many as may be are read, and no more, however many follow.
    #[test]
    fn no_more_are_read_than_may_be() {
        let read = |count: usize| {
            READ.set(0);
            let text = format!(r#"{{"few": [{}]}}"#, vec!["{}"; count].join(","));
            let document: Result<Document, _> = serde_json::from_str(&text);
            (document.map(|document| document.few.map(|few| few.len())), READ.get())
        };
        assert!(matches!(read(0), (Ok(Some(0)), 0)));
        assert!(matches!(read(3), (Ok(Some(3)), 3)));
        for count in [4, 1000] {
            let (refused, made) = read(count);
            let fault = refused.expect_err("too many").to_string();
            assert!(is_too_many(&fault) && fault.contains("at most 3"), "{fault}");
            assert_eq!(made, 3);
        }
        for none in ["{}", r#"{"few": null}"#] {
            let document: Document = serde_json::from_str(none).expect("none");
            assert!(document.few.is_none());
        }
        assert!(serde_json::from_str::<Document>(r#"{"few": 1}"#).is_err());
    }
}
