//! Counting of what a file asks for, and of what was mended.

use std::collections::BTreeSet;

use super::{Error, Limits};

/// What is counted against a limit.
#[derive(Debug, Clone, Copy)]
pub(super) enum Quantity {
    DecodedBytes,
    JsonValues,
    Files,
    Nodes,
    Parts,
    Joints,
    Vertices,
    Triangles,
    MorphTargets,
    Channels,
    Keys,
}

impl Quantity {
    /// The limit's value, its name, and the unit.
    fn limit(self, limits: &Limits) -> (u64, &'static str, &'static str) {
        match self {
            Self::DecodedBytes => (limits.decoded_bytes, "decoded_bytes", "decoded bytes"),
            Self::JsonValues => (limits.json_values, "json_values", "JSON values"),
            Self::Files => (limits.files, "files", "external files"),
            Self::Nodes => (limits.nodes, "nodes", "nodes"),
            Self::Parts => (limits.parts, "parts", "parts"),
            Self::Joints => (limits.joints, "joints", "joints"),
            // Vertices are numbered by u32.
            Self::Vertices => (limits.vertices.min(u32::MAX.into()), "vertices", "vertices"),
            Self::Triangles => (limits.triangles, "triangles", "triangles"),
            Self::MorphTargets => (limits.morph_targets, "morph_targets", "morph targets"),
            Self::Channels => (limits.channels, "channels", "channels"),
            Self::Keys => (limits.keys, "keys", "keys"),
        }
    }
}

/// Running totals of one import. Nothing is allocated before it is taken from here.
#[derive(Debug)]
pub(super) struct Budget<'a> {
    limits: &'a Limits,
    taken: [u64; Quantity::Keys as usize + 1],
}

impl<'a> Budget<'a> {
    pub(super) fn new(limits: &'a Limits) -> Self {
        Self { limits, taken: [0; Quantity::Keys as usize + 1] }
    }

    /// Says whether so much would pass the limit, of what is given back before anything else is taken.
    pub(super) fn pass(&mut self, what: Quantity, amount: u64, place: &str) -> Result<(), Error> {
        let before = self.taken[what as usize];
        let passed = self.take(what, amount, place);
        self.taken[what as usize] = before;
        passed
    }

    /// Adds to a total, or says that the limit is passed.
    pub(super) fn take(&mut self, what: Quantity, amount: u64, place: &str) -> Result<(), Error> {
        let taken = &mut self.taken[what as usize];
        *taken = taken.saturating_add(amount);
        let (most, limit, unit) = what.limit(self.limits);
        if *taken > most {
            let place = place.to_owned();
            return Err(Error::Limit { place, what: unit, limit, found: *taken, most });
        }
        Ok(())
    }
}

/// Notices for the user. The number is bounded: a hostile file could cause one per node.
#[derive(Debug, Default)]
pub(super) struct Notices {
    kept: Vec<String>,
    more: usize,
    /// What was found at several places: what, the first of them, all of them.
    alike: Vec<(&'static str, String, BTreeSet<String>)>,
}

/// More than this many notices help nobody.
const MOST_NOTICES: usize = 64;

impl Notices {
    pub(super) fn add(&mut self, notice: impl Into<String>) {
        if self.kept.len() < MOST_NOTICES {
            self.kept.push(notice.into());
        } else {
            self.more += 1;
        }
    }

    /// Something that many places of one file have in common, to be told once.
    pub(super) fn add_alike(&mut self, what: &'static str, place: &str) {
        match self.alike.iter_mut().find(|alike| alike.0 == what) {
            Some((.., places)) => {
                places.insert(place.to_owned());
            }
            None => {
                self.alike.push((what, place.to_owned(), BTreeSet::from([place.to_owned()])));
            }
        }
    }

    pub(super) fn finish(mut self) -> Vec<String> {
        for (what, first, places) in std::mem::take(&mut self.alike) {
            let more = match places.len() {
                1 => String::new(),
                2 => " and another".to_owned(),
                n => format!(" and {} others", n - 1),
            };
            self.add(format!("{first}{more}: {what}"));
        }
        if self.more > 0 {
            self.kept.push(format!("{} more notices of this kind", self.more));
        }
        self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A total may reach its limit and not pass it, and cannot wrap around.
    #[test]
    fn totals_stop_at_the_limit() {
        let limits = Limits { vertices: 10, ..Limits::default() };
        let mut budget = Budget::new(&limits);
        budget.take(Quantity::Vertices, 10, "here").unwrap();
        let refusal = budget.take(Quantity::Vertices, u64::MAX, "there").unwrap_err().to_string();
        assert!(refusal.contains("`vertices` is 10"), "{refusal}");
        assert!(budget.take(Quantity::Vertices, 1, "there").is_err());
    }

    /// What many places have in common is told once, with the first of them and their number.
    #[test]
    fn what_is_alike_is_told_once() {
        let mut notices = Notices::default();
        for place in ["b", "a", "b", "c"] {
            notices.add_alike("broken", place);
        }
        notices.add_alike("odd", "a");
        assert_eq!(notices.finish(), ["b and 2 others: broken", "a: odd"]);
    }

    /// Notices beyond the bound are counted, not kept.
    #[test]
    fn notices_are_bounded() {
        let mut notices = Notices::default();
        (0..1000).for_each(|i| notices.add(i.to_string()));
        let kept = notices.finish();
        assert_eq!(kept.len(), MOST_NOTICES + 1);
        assert!(kept[MOST_NOTICES].starts_with("936 more"));
    }
}
