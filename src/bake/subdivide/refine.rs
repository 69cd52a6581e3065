//! The queue: the worst triangle is split until a goal is reached.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::measure::{Seen, Surplus, foretell, lack};
use super::{ErrorMeasure, Goal, Tessellation, Work};
use crate::bake::{Error, Place};

/// Triangles whose middles are baked together: enough rays for all cores, and few that the end
/// leaves unused.
const BATCH: usize = 512;

/// Splits between two words of progress.
const TOLD_SPLITS: usize = 64;

/// Where transfer comes from.
pub trait Source: std::fmt::Debug {
    /// The transfer and the normals at some places, with their numbers in random streams.
    ///
    /// # Errors
    /// What the bake objects to.
    fn look(&self, places: &[Place], numbers: &[u64], stop: &AtomicBool)
    -> Result<Vec<Row>, Error>;
}

/// What one vertex looks like in every view: each key pose, and in each pose every instance.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Row {
    /// `[view, coefficient]`
    pub transfer: Vec<f32>,
    /// `[view]`
    pub normals: Vec<Vec3>,
    /// `[view]` Σ over the coefficients of the squares of their standard errors.
    pub variances: Vec<f32>,
}

impl Row {
    fn view(&self, view: usize) -> Seen<'_> {
        let width = self.transfer.len() / self.normals.len().max(1);
        let transfer = &self.transfer[view * width..(view + 1) * width];
        Seen { transfer, normal: self.normals[view] }
    }
}

/// An entry of the queue; the larger error first, and of equal ones the older.
#[derive(Debug, PartialEq)]
struct Entry {
    error: f32,
    leaf: usize,
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error.total_cmp(&other.error).then(other.leaf.cmp(&self.leaf))
    }
}

/// A refinement under way.
#[derive(Debug)]
pub struct Refiner<'a> {
    source: &'a dyn Source,
    measure: ErrorMeasure,
    /// Areas of the input's triangles.
    areas: &'a [f32],
    pub(super) tessellation: Tessellation,
    /// Vertex → what it looks like; empty where nobody looked.
    pub(super) rows: Vec<Row>,
    queue: BinaryHeap<Entry>,
    surplus: HashMap<usize, Surplus>,
    errors: Vec<f32>,
}

impl<'a> Refiner<'a> {
    /// The input with the transfer at its vertices; `areas` are those of its triangles.
    ///
    /// # Errors
    /// What the source objects to.
    ///
    /// # Panics
    /// If there are not as many rows as vertices, or areas as triangles.
    pub fn new(
        tessellation: Tessellation,
        rows: Vec<Row>,
        areas: &'a [f32],
        (source, measure): (&'a dyn Source, ErrorMeasure),
        stop: &AtomicBool,
    ) -> Result<Self, Error> {
        assert_eq!(rows.len(), tessellation.vertices(), "rows");
        let (queue, surplus, errors) = (BinaryHeap::new(), HashMap::new(), Vec::new());
        let mut refiner =
            Self { source, measure, areas, tessellation, rows, queue, surplus, errors };
        let leaves: Vec<usize> = refiner.tessellation.leaves().collect();
        if measure.sees_middles() {
            let middles: Vec<u32> = leaves.iter().flat_map(|&leaf| refiner.middles(leaf)).collect();
            refiner.complete(&middles, stop)?;
            for &leaf in &leaves {
                let surplus = refiner.measured(leaf);
                refiner.surplus.insert(leaf, surplus);
            }
        }
        leaves.into_iter().for_each(|leaf| refiner.enter(leaf));
        Ok(refiner)
    }

    /// Splits until a goal is reached; tells of the triangles there are.
    ///
    /// # Errors
    /// What the source objects to; [`Error::Cancelled`].
    pub fn run(
        &mut self,
        goal: &Goal,
        stop: &AtomicBool,
        tell: &mut dyn FnMut(usize),
    ) -> Result<Work, Error> {
        let mut work = Work::default();
        while let Some(entry) = self.queue.pop() {
            if !self.tessellation.is_leaf(entry.leaf) {
                continue;
            }
            if entry.error <= goal.error {
                self.queue.push(entry);
                break;
            }
            if self.is_finest(entry.leaf, goal) {
                work.at_depth += 1;
                continue;
            }
            let chain = self.chain(entry.leaf, goal);
            if chain.iter().any(|&leaf| self.lacks(leaf)) {
                self.bake_batch(&chain, goal, stop)?;
            }
            let before = work.splits;
            for leaf in chain {
                if !self.fits(leaf, goal) {
                    break;
                }
                self.split(leaf);
                work.splits += 1;
                if work.splits % TOLD_SPLITS == 0 {
                    tell(self.tessellation.count());
                }
            }
            work.forced += work.splits - before;
            if self.tessellation.is_leaf(entry.leaf) {
                self.queue.push(entry);
                break;
            }
            work.forced -= 1;
        }
        tell(self.tessellation.count());
        work.left = self.tessellation.leaves().map(|leaf| self.error(leaf)).fold(0.0, f32::max);
        Ok(work)
    }

    /// What is split with a triangle, in order: coarser ones beside it first, so that the balance stays.
    fn chain(&self, leaf: usize, goal: &Goal) -> Vec<usize> {
        let mut chain = Vec::new();
        // A triangle is open until all that come before it are in the chain.
        let mut open = vec![(leaf, false)];
        while let Some((index, ready)) = open.pop() {
            if chain.contains(&index) {
                continue;
            }
            if ready {
                chain.push(index);
                continue;
            }
            open.push((index, true));
            for coarser in self.tessellation.coarser(index) {
                let leaf = self.tessellation.leaf(coarser);
                if self.tessellation.can_split(&leaf) && !self.is_finest(coarser, goal) {
                    open.push((coarser, false));
                }
            }
        }
        chain
    }

    /// Whether there is room for a split.
    fn fits(&self, index: usize, goal: &Goal) -> bool {
        let leaf = self.tessellation.leaf(index);
        let after = self.tessellation.count() + self.tessellation.growth(&leaf);
        let used = self.tessellation.used() + self.tessellation.new_vertices(&leaf);
        after <= goal.triangles && used <= goal.vertices
    }

    /// Whether a triangle is as deep or as small as it may be.
    fn is_finest(&self, index: usize, goal: &Goal) -> bool {
        let leaf = self.tessellation.leaf(index);
        leaf.depth >= goal.depth || self.areas[leaf.root as usize] * leaf.share() < goal.area
    }

    /// The estimate of each triangle of the hierarchy that is not split, by index.
    #[must_use]
    pub fn error(&self, leaf: usize) -> f32 {
        self.errors.get(leaf).copied().unwrap_or_default()
    }

    /// Bakes what vertices of the result still lack.
    pub(super) fn complete(&mut self, vertices: &[u32], stop: &AtomicBool) -> Result<(), Error> {
        self.rows.resize(self.tessellation.vertices(), Row::default());
        let lacking = vertices.iter().filter(|&&v| self.rows[v as usize].normals.is_empty());
        let mut lacking: Vec<u32> = lacking.copied().collect();
        lacking.sort_unstable();
        lacking.dedup();
        self.bake(&lacking, stop)
    }

    /// The middles of a leaf that can be split.
    fn middles(&mut self, index: usize) -> Vec<u32> {
        let leaf = self.tessellation.leaf(index);
        match self.tessellation.can_split(&leaf) {
            true => self.tessellation.middles(&leaf).to_vec(),
            false => Vec::new(),
        }
    }

    /// What must be baked before a leaf is split.
    fn ahead(&mut self, index: usize) -> Vec<u32> {
        if self.measure != ErrorMeasure::Midpoint {
            return self.middles(index);
        }
        let leaf = self.tessellation.leaf(index);
        if !self.tessellation.can_split(&leaf) {
            return Vec::new();
        }
        let children = self.tessellation.children(&leaf);
        children.iter().flat_map(|child| self.tessellation.middles(child)).collect()
    }

    fn lacks(&mut self, index: usize) -> bool {
        let wanted = self.ahead(index);
        self.rows.resize(self.tessellation.vertices(), Row::default());
        wanted.iter().any(|&vertex| self.rows[vertex as usize].normals.is_empty())
    }

    /// Bakes ahead for the triangles of a chain and for those that come next in the queue.
    fn bake_batch(&mut self, chain: &[usize], goal: &Goal, stop: &AtomicBool) -> Result<(), Error> {
        // No more than the goal still has room for: a split brings three triangles at least.
        let room = goal.triangles.saturating_sub(self.tessellation.count()) / 3;
        let next: Vec<Entry> =
            (1..BATCH.min(room.max(1))).map_while(|_| self.queue.pop()).collect();
        let mut wanted: Vec<u32> = chain.iter().flat_map(|&leaf| self.ahead(leaf)).collect();
        for entry in next.iter().filter(|entry| entry.error > goal.error) {
            if self.tessellation.is_leaf(entry.leaf) && !self.is_finest(entry.leaf, goal) {
                for leaf in self.chain(entry.leaf, goal) {
                    wanted.extend(self.ahead(leaf));
                }
            }
        }
        self.queue.extend(next);
        self.complete(&wanted, stop)
    }

    fn bake(&mut self, vertices: &[u32], stop: &AtomicBool) -> Result<(), Error> {
        let places: Vec<Place> = vertices.iter().map(|&v| self.tessellation.place(v)).collect();
        let numbers: Vec<u64> = vertices.iter().map(|&v| u64::from(v)).collect();
        let rows = self.source.look(&places, &numbers, stop)?;
        for (&vertex, row) in vertices.iter().zip(rows) {
            self.rows[vertex as usize] = row;
        }
        Ok(())
    }

    fn split(&mut self, index: usize) {
        let leaf = self.tessellation.leaf(index);
        let surplus = self.surplus.remove(&index);
        let middles = self.tessellation.middles(&leaf);
        let children = self.tessellation.split(index);
        if self.measure == ErrorMeasure::Midpoint {
            for child in children {
                let surplus = self.measured(child);
                self.surplus.insert(child, surplus);
            }
        } else if surplus.is_some() {
            let measured = self.lacking(leaf.corners, middles);
            let views = 0..self.rows[leaf.corners[0] as usize].normals.len();
            let mut foretold = [[0.0_f32; 3]; 4];
            for view in views {
                let of = |vertices: [u32; 3]| {
                    vertices.map(|vertex| self.rows[vertex as usize].view(view).transfer)
                };
                let here = foretell(of(leaf.corners), of(middles), measured);
                for (all, here) in foretold.iter_mut().flatten().zip(here.iter().flatten()) {
                    *all = all.max(*here);
                }
            }
            self.surplus.extend(children.into_iter().zip(foretold));
        }
        children.into_iter().for_each(|child| self.enter(child));
    }

    fn measured(&mut self, leaf: usize) -> Surplus {
        let leaf = self.tessellation.leaf(leaf);
        if !self.tessellation.can_split(&leaf) {
            return [0.0; 3];
        }
        let middles = self.tessellation.middles(&leaf);
        self.lacking(leaf.corners, middles)
    }

    /// What middles lack of the mean of their ends beyond what noise explains, the most of all views.
    fn lacking(&self, corners: [u32; 3], middles: [u32; 3]) -> Surplus {
        [0, 1, 2].map(|side| {
            let [from, to, middle] = [corners[side], corners[(side + 1) % 3], middles[side]]
                .map(|vertex| &self.rows[vertex as usize]);
            let one = |view: usize| {
                let noise =
                    middle.variances[view] + (from.variances[view] + to.variances[view]) / 4.0;
                let [from, to, middle] = [from, to, middle].map(|row| row.view(view).transfer);
                (lack(middle, from, to).powi(2) - noise).max(0.0).sqrt()
            };
            (0..from.normals.len()).map(one).fold(0.0, f32::max)
        })
    }

    fn enter(&mut self, index: usize) {
        let leaf = self.tessellation.leaf(index);
        let corners = leaf.corners.map(|vertex| &self.rows[vertex as usize]);
        let area = self.areas[leaf.root as usize] * leaf.share();
        let error = match self.surplus.get(&index) {
            Some(surplus) => 8.0 / 45.0 * area * surplus.iter().map(|s| s * s).sum::<f32>(),
            None if self.measure == ErrorMeasure::Uniform => leaf.share(),
            None => {
                let one = |view| self.measure.of(corners.map(|row| row.view(view)));
                let most = (0..corners[0].normals.len()).map(one).fold(0.0, f32::max);
                if self.measure.is_by_area() { most * area.sqrt() } else { most }
            }
        };
        if self.errors.len() <= index {
            self.errors.resize(index + 1, 0.0);
        }
        self.errors[index] = error;
        if self.tessellation.can_split(&leaf) {
            self.queue.push(Entry { error, leaf: index });
        }
    }
}
