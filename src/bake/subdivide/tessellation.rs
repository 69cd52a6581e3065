//! Triangles that split in four, and the triangulation without T-vertices that they come to.
//!
//! Vertices at one place (seams of normals or texture coordinates) share a *weld*; an edge is a pair
//! of welds, so a split on one side of a seam is one on the other side too, each side with a vertex
//! of its own.
//!
//! *Invariant:* [`Tessellation::count`] is the number of triangles of [`Tessellation::conforming`]:
//! a triangle with k vertices on its edges becomes k + 1.
//!
//! Split in the order that [`Tessellation::coarser`] asks for, no triangle has more than one vertex on
//! an edge (a balance of 2 to 1): else one beside a fine edge becomes a fan of thousands of slivers,
//! which bend what is interpolated and slow whoever traces them down.

use std::collections::{HashMap, HashSet};

use super::Leaf;
use crate::bake::Place;

/// An edge of the hierarchy, by its welds.
#[derive(Debug, Clone, Copy, Default)]
struct Edge {
    /// Whether a triangle at it was split.
    split: bool,
    /// Triangles at it.
    faces: u32,
    /// Different pairs of vertices at it: 2 at a seam.
    pairs: u32,
    /// The edge that it is half of.
    whole: Option<[u32; 2]>,
}

/// The hierarchy over an input mesh.
#[derive(Debug)]
pub struct Tessellation {
    /// Vertex → weld.
    weld: Vec<u32>,
    welds: u32,
    /// Vertices of the input.
    given: usize,
    /// Vertex beyond the input's → where it lies.
    places: Vec<Place>,
    edges: HashMap<[u32; 2], Edge>,
    /// Welds of an edge → the weld in its middle.
    weld_between: HashMap<[u32; 2], u32>,
    /// Vertices of an edge → the vertex in its middle.
    between: HashMap<[u32; 2], u32>,
    /// Every edge that there was, by its vertices.
    pairs: HashSet<[u32; 2]>,
    /// Everything that is not split.
    leaves: Vec<Option<Leaf>>,
    /// Edge → the leaves that have it for a side.
    sides: HashMap<[u32; 2], Vec<u32>>,
    /// The input's triangles that stay as they are, whatever is split beside them.
    kept: HashSet<u32>,
    /// Edges of the input that are not split, and triangles of it.
    stiff: (HashSet<[u32; 2]>, HashSet<u32>),
    count: usize,
    used: usize,
}

fn key([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

impl Tessellation {
    /// An input mesh, nothing split. `weld` numbers the places of vertices from 0.
    ///
    /// # Panics
    /// If a triangle names a vertex without a weld.
    #[must_use]
    pub fn new(triangles: &[[u32; 3]], weld: Vec<u32>) -> Self {
        Self::keeping(triangles, weld, HashSet::new())
    }

    /// The same; some triangles, of which two corners are one in every pose, are kept as they are: they
    /// have no area in which a vertex within an edge could show.
    ///
    /// # Panics
    /// As [`Self::new`].
    #[must_use]
    pub fn keeping(triangles: &[[u32; 3]], weld: Vec<u32>, kept: HashSet<u32>) -> Self {
        let leaf = |(root, &corners): (u32, &[u32; 3])| Some(Leaf::root(root, corners));
        let mut all = Self {
            welds: weld.iter().max().map_or(0, |most| most + 1),
            given: weld.len(),
            weld,
            places: Vec::new(),
            edges: HashMap::with_capacity(triangles.len() * 3 / 2),
            weld_between: HashMap::new(),
            between: HashMap::new(),
            pairs: HashSet::with_capacity(triangles.len() * 3 / 2),
            leaves: (0..).zip(triangles).map(leaf).collect(),
            sides: HashMap::with_capacity(triangles.len() * 3 / 2),
            kept,
            stiff: (HashSet::new(), HashSet::new()),
            count: triangles.len(),
            used: 0,
        };
        all.used = all.given;
        for index in 0..triangles.len() {
            if all.kept.contains(&(index as u32)) {
                continue;
            }
            for side in all.leaf(index).sides() {
                all.add_edge(side, 1);
            }
            all.list(index);
        }
        all
    }

    /// Edges, by their ends, and triangles of the input that are not split from now on; triangles at such
    /// an edge are not either.
    pub fn stiffen(&mut self, edges: &[[u32; 2]], triangles: &[u32]) {
        let edges: Vec<[u32; 2]> = edges.iter().map(|&edge| self.welded(edge)).collect();
        self.stiff.0.extend(edges);
        self.stiff.1.extend(triangles);
    }

    /// Notes a leaf at its sides.
    fn list(&mut self, index: usize) {
        for side in self.leaf(index).sides() {
            let side = self.welded(side);
            self.sides.entry(side).or_default().push(index as u32);
        }
    }

    /// The leaves beside one whose side is half of theirs: they are to be split before it is.
    #[must_use]
    pub fn coarser(&self, index: usize) -> Vec<usize> {
        let wholes = self.leaf(index).sides().map(|side| self.edge(side).whole);
        let beside = wholes.into_iter().flatten().filter_map(|whole| self.sides.get(&whole));
        beside.flatten().map(|&leaf| leaf as usize).collect()
    }

    /// Adds triangles at an edge; where another layer of the surface lies on this one, the edge and
    /// halves of it may be split already, and get them too.
    fn add_edge(&mut self, side: [u32; 2], faces: u32) {
        let pairs = u32::from(self.pairs.insert(key(side)));
        let mut open = vec![self.welded(side)];
        while let Some(pair) = open.pop() {
            let edge = self.edges.entry(pair).or_default();
            edge.faces += faces;
            edge.pairs += pairs;
            if edge.split {
                open.extend(self.halves(pair));
                self.count += faces as usize;
                self.used += pairs as usize;
            }
        }
    }

    /// The halves of a split edge.
    fn halves(&self, pair: [u32; 2]) -> [[u32; 2]; 2] {
        let middle = self.weld_between[&pair];
        pair.map(|end| key([end, middle]))
    }

    /// Triangles of the result as it stands.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Vertices of the result as it stands, the input's among them whether they are used or not.
    #[must_use]
    pub fn used(&self) -> usize {
        self.used
    }

    /// Vertices so far, also those that were only looked at.
    #[must_use]
    pub fn vertices(&self) -> usize {
        self.weld.len()
    }

    /// Vertices of the input.
    #[must_use]
    pub fn given(&self) -> usize {
        self.given
    }

    /// Where a vertex beyond the input's lies.
    ///
    /// # Panics
    /// If it is one of the input's, or none.
    #[must_use]
    pub fn place(&self, vertex: u32) -> Place {
        self.places[vertex as usize - self.given]
    }

    /// A triangle that is not split.
    ///
    /// # Panics
    /// If it was.
    #[must_use]
    pub fn leaf(&self, index: usize) -> Leaf {
        self.leaves[index].expect("a leaf is split once")
    }

    /// Whether a triangle of the hierarchy is not split yet.
    #[must_use]
    pub fn is_leaf(&self, index: usize) -> bool {
        self.leaves[index].is_some()
    }

    /// The triangles that are not split, by index.
    pub fn leaves(&self) -> impl Iterator<Item = usize> {
        (0..self.leaves.len()).filter(|&index| self.leaves[index].is_some())
    }

    /// Whether a triangle has three corners at three places, and nothing of it is stiff; one without is
    /// only ever bisected.
    #[must_use]
    pub fn can_split(&self, leaf: &Leaf) -> bool {
        let [a, b, c] = leaf.corners.map(|corner| self.weld[corner as usize]);
        let (edges, roots) = &self.stiff;
        let is_stiff = |side: [u32; 2]| edges.contains(&self.welded(side));
        let soft = edges.is_empty() || !leaf.sides().into_iter().any(is_stiff);
        a != b && b != c && c != a && soft && !roots.contains(&leaf.root)
    }

    /// The vertices in the middle of the three sides; they come to be where they are not yet.
    pub fn middles(&mut self, leaf: &Leaf) -> [u32; 3] {
        [0, 1, 2].map(|side| self.middle(leaf, side))
    }

    fn middle(&mut self, leaf: &Leaf, side: usize) -> u32 {
        let ends = leaf.sides()[side];
        if let Some(&vertex) = self.between.get(&key(ends)) {
            return vertex;
        }
        let vertex = self.weld.len() as u32;
        self.between.insert(key(ends), vertex);
        let weld = *self.weld_between.entry(self.welded(ends)).or_insert(self.welds);
        self.welds = self.welds.max(weld + 1);
        self.weld.push(weld);
        self.places.push(Place { triangle: leaf.root, weights: leaf.middle(side) });
        vertex
    }

    fn welded(&self, side: [u32; 2]) -> [u32; 2] {
        key(side.map(|vertex| self.weld[vertex as usize]))
    }

    fn edge(&self, side: [u32; 2]) -> Edge {
        self.edges.get(&self.welded(side)).copied().unwrap_or_default()
    }

    /// By how much [`Self::count`] grows when a leaf is split: three, less what its neighbours have
    /// split already, and one for each other triangle at an edge that becomes split. Where another
    /// layer lies on this one and is finer, it grows by what that has on the inner edges besides.
    #[must_use]
    pub fn growth(&self, leaf: &Leaf) -> usize {
        let grows = |edge: Edge| if edge.split { 0 } else { edge.faces as usize };
        leaf.sides().map(|side| grows(self.edge(side))).iter().sum()
    }

    /// By how much [`Self::used`] grows when a leaf is split.
    #[must_use]
    pub fn new_vertices(&self, leaf: &Leaf) -> usize {
        let grows = |edge: Edge| if edge.split { 0 } else { edge.pairs as usize };
        leaf.sides().map(|side| grows(self.edge(side))).iter().sum()
    }

    /// Splits a leaf in four: the three at its corners, then the one between.
    ///
    /// # Panics
    /// If it is split, or cannot be.
    pub fn split(&mut self, index: usize) -> [usize; 4] {
        let leaf = self.leaf(index);
        assert!(self.can_split(&leaf), "triangle {} cannot be split", leaf.root);
        self.count += self.growth(&leaf);
        self.used += self.new_vertices(&leaf);
        self.leaves[index] = None;
        for side in leaf.sides().map(|side| self.welded(side)) {
            if let Some(list) = self.sides.get_mut(&side) {
                list.retain(|&other| other as usize != index);
            }
        }
        let middles = self.middles(&leaf);
        for (side, middle) in leaf.sides().into_iter().zip(middles) {
            self.halve(side, middle);
        }
        let [ab, bc, ca] = middles;
        for side in [[ab, bc], [bc, ca], [ca, ab]] {
            self.add_edge(side, 2);
        }
        let first = self.leaves.len();
        let children = self.children(&leaf);
        self.leaves.extend(children.map(Some));
        (first..first + 4).for_each(|child| self.list(child));
        [first, first + 1, first + 2, first + 3]
    }

    /// What a leaf would be split into.
    pub fn children(&mut self, leaf: &Leaf) -> [Leaf; 4] {
        let [a, b, c] = leaf.corners;
        let [ab, bc, ca] = self.middles(leaf);
        let [at_ab, at_bc, at_ca] = [0, 1, 2].map(|side| leaf.middle(side));
        let (root, depth) = (leaf.root, leaf.depth + 1);
        let children = [
            ([a, ab, ca], [leaf.at[0], at_ab, at_ca]),
            ([b, bc, ab], [leaf.at[1], at_bc, at_ab]),
            ([c, ca, bc], [leaf.at[2], at_ca, at_bc]),
            ([ab, bc, ca], [at_ab, at_bc, at_ca]),
        ];
        children.map(|(corners, at)| Leaf { corners, root, at, depth })
    }

    fn halve(&mut self, side: [u32; 2], middle: u32) {
        let whole = self.welded(side);
        let edge = self.edges.entry(whole).or_default();
        if edge.split {
            return;
        }
        edge.split = true;
        let Edge { faces, pairs, .. } = *edge;
        for half in side.map(|end| self.welded([end, middle])) {
            let half = self.edges.entry(half).or_default();
            half.faces += faces;
            half.pairs += pairs;
            half.whole = Some(whole);
        }
    }

    /// The leaves, bisected where a neighbour's vertex lies on an edge: no T-vertex remains. By
    /// root, each with the index of its leaf; vertices that this needs come to be.
    pub fn conforming(&mut self) -> Vec<(usize, Leaf)> {
        let mut leaves: Vec<usize> = self.leaves().collect();
        leaves.sort_by_key(|&index| self.leaf(index).root);
        let mut out = Vec::with_capacity(self.count);
        let mut open: Vec<(Leaf, [bool; 3])> = Vec::new();
        for index in leaves {
            let kept = self.kept.contains(&self.leaf(index).root);
            open.push((self.leaf(index), [!kept; 3]));
            while let Some((leaf, outer)) = open.pop() {
                match self.longest_split(&leaf, outer) {
                    None => out.push((index, leaf)),
                    Some(side) => {
                        let [first, second] = self.bisect(&leaf, side);
                        // The cut is nobody else's edge.
                        let (mut before, mut after) = (outer, outer);
                        before[(side + 1) % 3] = false;
                        after[(side + 2) % 3] = false;
                        open.extend([(first, before), (second, after)]);
                    }
                }
            }
        }
        out
    }

    /// Of the leaf's own sides with a vertex between their ends, the one that is longest in the root
    /// triangle's own coordinates: bisecting it leaves the better shapes.
    fn longest_split(&self, leaf: &Leaf, outer: [bool; 3]) -> Option<usize> {
        let split = |&side: &usize| outer[side] && self.edge(leaf.sides()[side]).split;
        let length = |side: usize| {
            let (from, to) = (leaf.at[side], leaf.at[(side + 1) % 3]);
            [0, 1, 2].map(|i| (from[i] - to[i]).powi(2)).iter().sum::<f32>()
        };
        (0..3).filter(split).max_by(|&a, &b| length(a).total_cmp(&length(b)))
    }

    fn bisect(&mut self, leaf: &Leaf, side: usize) -> [Leaf; 2] {
        let (middle, at) = (self.middle(leaf, side), leaf.middle(side));
        let next = (side + 1) % 3;
        let (mut first, mut second) = (*leaf, *leaf);
        (first.corners[next], first.at[next]) = (middle, at);
        (second.corners[side], second.at[side]) = (middle, at);
        [first, second]
    }
}

#[cfg(test)]
mod tests;
