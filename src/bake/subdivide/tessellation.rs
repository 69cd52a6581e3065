//! Triangles that split in four, and the triangulation without T-vertices that they come to.
//!
//! Vertices at one place (seams of normals or texture coordinates) share a *weld*; an edge is a pair
//! of welds, so a split on one side of a seam is one on the other side too, each side with a vertex
//! of its own.
//!
//! *Invariant:* [`Tessellation::count`] is the number of triangles of [`Tessellation::conforming`]:
//! a triangle with k vertices on its edges becomes k + 1.

use std::collections::{HashMap, HashSet};

use crate::bake::Place;

/// A triangle of the hierarchy, or of the result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leaf {
    /// Vertices.
    pub corners: [u32; 3],
    /// The input's triangle that it is part of.
    pub root: u32,
    /// Weights of the root's corners at each corner; dyadic, so exact.
    pub at: [[f32; 3]; 3],
    /// How often it was split.
    pub depth: u8,
}

impl Leaf {
    /// Area as a share of the root's.
    #[must_use]
    pub fn share(&self) -> f32 {
        let [a, b, c] = self.at;
        ((b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])).abs()
    }

    /// The corners of each edge: the first from corner 0 to 1.
    fn sides(&self) -> [[u32; 2]; 3] {
        let [a, b, c] = self.corners;
        [[a, b], [b, c], [c, a]]
    }

    fn middle(&self, side: usize) -> [f32; 3] {
        let (from, to) = (self.at[side], self.at[(side + 1) % 3]);
        [0, 1, 2].map(|i| (from[i] + to[i]) / 2.0)
    }
}

/// An edge of the hierarchy, by its welds.
#[derive(Debug, Clone, Copy, Default)]
struct Edge {
    /// Whether a triangle at it was split.
    split: bool,
    /// Triangles at it.
    faces: u32,
    /// Different pairs of vertices at it: 2 at a seam.
    pairs: u32,
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
        let corner = |i: usize| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
        let at = [corner(0), corner(1), corner(2)];
        let leaf = |(root, &corners): (u32, &[u32; 3])| Some(Leaf { corners, root, at, depth: 0 });
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
            count: triangles.len(),
            used: 0,
        };
        all.used = all.given;
        for index in 0..triangles.len() {
            for side in all.leaf(index).sides() {
                all.add_edge(side, 1);
            }
        }
        all
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

    /// The triangles that are not split, by index.
    pub fn leaves(&self) -> impl Iterator<Item = usize> {
        (0..self.leaves.len()).filter(|&index| self.leaves[index].is_some())
    }

    /// Whether a triangle has three corners at three places; one without is only ever bisected.
    #[must_use]
    pub fn can_split(&self, leaf: &Leaf) -> bool {
        let [a, b, c] = leaf.corners.map(|corner| self.weld[corner as usize]);
        a != b && b != c && c != a
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
        assert!(self.can_split(&leaf), "corners of triangle {} coincide", leaf.root);
        self.count += self.growth(&leaf);
        self.used += self.new_vertices(&leaf);
        self.leaves[index] = None;
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
            open.push((self.leaf(index), [true; 3]));
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
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    /// How many triangles are at each edge, by welds.
    fn faces(all: &Tessellation, triangles: &[(usize, Leaf)]) -> BTreeMap<[u32; 2], usize> {
        let mut faces = BTreeMap::new();
        for pair in triangles.iter().flat_map(|(_, leaf)| leaf.sides()).map(|side| all.welded(side))
        {
            *faces.entry(pair).or_default() += 1;
        }
        faces
    }

    /// An octahedron with a seam: the vertex at the top is there twice, for two triangles each.
    fn seamed() -> Tessellation {
        let triangles = [
            [0, 2, 3],
            [0, 3, 4],
            [6, 4, 5],
            [6, 5, 2],
            [1, 3, 2],
            [1, 4, 3],
            [1, 5, 4],
            [1, 2, 5],
        ];
        Tessellation::new(&triangles, vec![0, 1, 2, 3, 4, 5, 0])
    }

    proptest! {
        /// However a closed surface is split: every edge of the result has its two triangles, the
        /// count is what was foretold, and the parts of each input triangle make up its area.
        #[test]
        fn splitting_keeps_a_closed_surface(choices in prop::collection::vec(0_usize..1000, 0..40)) {
            let mut all = seamed();
            for choice in choices {
                let open: Vec<usize> = all.leaves().collect();
                all.split(open[choice % open.len()]);
            }
            let foretold = (all.count(), all.used());
            let result = all.conforming();
            let used: HashSet<u32> = result.iter().flat_map(|(_, leaf)| leaf.corners).collect();
            prop_assert_eq!((result.len(), used.len()), foretold);
            prop_assert!(faces(&all, &result).values().all(|&count| count == 2));
            let mut areas = [0.0; 8];
            for (_, leaf) in &result {
                areas[leaf.root as usize] += leaf.share();
            }
            prop_assert_eq!(areas, [1.0; 8]);
        }

        /// A vertex between two others lies in their middle, seen from either side of the edge.
        #[test]
        fn vertices_lie_where_they_should(choices in prop::collection::vec(0_usize..1000, 1..30)) {
            let mut all = seamed();
            let corners: [[f32; 3]; 7] = [
                [0.0, 0.0, 1.0],
                [0.0, 0.0, -1.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [-1.0, 0.0, 0.0],
                [0.0, -1.0, 0.0],
                [0.0, 0.0, 1.0],
            ];
            let roots: Vec<[u32; 3]> = all.leaves().map(|leaf| all.leaf(leaf).corners).collect();
            for choice in choices {
                let open: Vec<usize> = all.leaves().collect();
                all.split(open[choice % open.len()]);
            }
            let result = all.conforming();
            let mix = |root: u32, at: [f32; 3]| {
                let ends = roots[root as usize].map(|vertex| corners[vertex as usize]);
                [0, 1, 2].map(|axis| (0..3).map(|i| at[i] * ends[i][axis]).sum::<f32>())
            };
            for (_, leaf) in &result {
                for (&vertex, at) in leaf.corners.iter().zip(leaf.at) {
                    let here = mix(leaf.root, at);
                    let there = match (vertex as usize) < all.given() {
                        true => corners[vertex as usize],
                        false => mix(all.place(vertex).triangle, all.place(vertex).weights),
                    };
                    prop_assert_eq!(here, there);
                }
            }
        }
    }

    /// Two layers of one square, with vertices of their own: whatever is split on either, the count
    /// holds.
    #[test]
    fn layers_are_counted() {
        let triangles = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]];
        for order in [[0, 2, 1, 3], [0, 4, 2, 3], [0, 7, 2, 1], [2, 0, 4, 8]] {
            let mut all = Tessellation::new(&triangles, vec![0, 1, 2, 3, 0, 1, 2, 3]);
            for index in order {
                if all.leaves[index].is_some() {
                    all.split(index);
                }
            }
            let foretold = (all.count(), all.used());
            let result = all.conforming();
            let used: HashSet<u32> = result.iter().flat_map(|(_, leaf)| leaf.corners).collect();
            assert_eq!((result.len(), used.len()), foretold, "{order:?}");
        }
    }

    /// A triangle whose corners share a place cannot be split, and is bisected with its neighbour.
    #[test]
    fn a_flat_triangle_follows_its_neighbour() {
        let mut all = Tessellation::new(&[[0, 1, 2], [2, 1, 3]], vec![0, 1, 2, 1]);
        let flat = all.leaf(1);
        assert!(!all.can_split(&flat));
        let whole = all.leaf(0);
        assert_eq!(all.growth(&whole), 1 + 3 + 1);
        all.split(0);
        assert_eq!(all.conforming().len(), all.count());
    }
}
