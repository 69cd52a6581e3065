//! A matrix in the layout that the CPU kernels read: blocks of 32 rows, transposed.

/// Rows per panel.
pub const PANEL_ROWS: usize = 32;

/// One j of one panel.
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lanes(pub(super) [f32; PANEL_ROWS]);

impl Lanes {
    pub(super) const ZERO: Self = Self([0.0; PANEL_ROWS]);
}

/// A matrix of `rows` × `inner` in the layout of the kernels: `[panel][inner][32 rows]`, the last
/// panel filled up with zeros.
#[derive(Debug, Clone, PartialEq)]
pub struct Panels {
    rows: usize,
    inner: usize,
    data: Vec<Lanes>,
}

impl Panels {
    /// Rearranges a matrix whose entry (row, j) is `value(row, j)`.
    #[must_use]
    pub fn new(rows: usize, inner: usize, value: impl Fn(usize, usize) -> f32) -> Self {
        let mut data = vec![Lanes::ZERO; rows.div_ceil(PANEL_ROWS) * inner];
        for row in 0..rows {
            let (panel, lane) = (row / PANEL_ROWS, row % PANEL_ROWS);
            for j in 0..inner {
                data[panel * inner + j].0[lane] = value(row, j);
            }
        }
        Self { rows, inner, data }
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns, the length of the sums.
    #[must_use]
    pub fn inner(&self) -> usize {
        self.inner
    }

    /// The entry (row, j).
    ///
    /// # Panics
    /// Outside the matrix.
    #[must_use]
    pub fn at(&self, row: usize, j: usize) -> f32 {
        assert!(row < self.rows && j < self.inner, "({row}, {j}) is outside the matrix");
        self.data[row / PANEL_ROWS * self.inner + j].0[row % PANEL_ROWS]
    }

    pub(super) fn panel(&self, panel: usize) -> &[Lanes] {
        &self.data[panel * self.inner..(panel + 1) * self.inner]
    }
}

/// Which rows take which of several right-hand sides; see [`multiply_grouped`](super::kernels::multiply_grouped).
#[derive(Debug, Clone, PartialEq)]
pub struct Groups {
    /// `pairs[starts[p]..starts[p + 1]]` are those of panel p.
    starts: Vec<usize>,
    /// Two groups, each with the rows of the panel that belong to it. An odd group goes with
    /// itself and no rows: most panels have one or two, and one way through is quicker for both
    /// than a choice between two.
    pairs: Vec<[(usize, u32); 2]>,
    count: usize,
}

impl Groups {
    /// From the group of each row.
    #[must_use]
    pub fn new(group_of_row: &[u16]) -> Self {
        let count = group_of_row.iter().max().map_or(0, |&group| usize::from(group) + 1);
        let mut this = Self { starts: vec![0], pairs: Vec::new(), count };
        for panel in group_of_row.chunks(PANEL_ROWS) {
            let mut entries: Vec<(usize, u32)> = Vec::new();
            for (lane, &group) in panel.iter().enumerate() {
                let group = usize::from(group);
                match entries.iter_mut().find(|entry| entry.0 == group) {
                    Some(entry) => entry.1 |= 1 << lane,
                    None => entries.push((group, 1 << lane)),
                }
            }
            let pair = |pair: &[(usize, u32)]| [pair[0], *pair.get(1).unwrap_or(&(pair[0].0, 0))];
            this.pairs.extend(entries.chunks(2).map(pair));
            this.starts.push(this.pairs.len());
        }
        this
    }

    /// One more than the largest group.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// How many panels it was made for.
    pub(super) fn panels(&self) -> usize {
        self.starts.len() - 1
    }

    /// The groups of a panel, each with the rows that belong to it.
    pub(super) fn of_panel(&self, panel: usize) -> &[[(usize, u32); 2]] {
        &self.pairs[self.starts[panel]..self.starts[panel + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is put into panels comes out of them.
    #[test]
    fn panels_keep_their_entries() {
        let panels = Panels::new(33, 4, |row, j| (row * 4 + j) as f32);
        for row in 0..33 {
            for j in 0..4 {
                assert_eq!(panels.at(row, j), (row * 4 + j) as f32);
            }
        }
    }

    /// The masks of a panel's groups are disjoint, cover its rows, and say the right group.
    #[test]
    fn groups_partition_each_panel() {
        let group_of_row: Vec<u16> = (0..70).map(|row| (row * 7 % 5) as u16).collect();
        let groups = Groups::new(&group_of_row);
        assert_eq!((groups.panels(), groups.count()), (3, 5));
        for (row, &expected) in group_of_row.iter().enumerate() {
            let of_panel = groups.of_panel(row / PANEL_ROWS);
            let holds = |mask: u32| mask >> (row % PANEL_ROWS) & 1 == 1;
            let entries = of_panel.as_flattened().iter();
            let found: Vec<usize> =
                entries.filter(|entry| holds(entry.1)).map(|entry| entry.0).collect();
            assert_eq!(found, [usize::from(expected)]);
        }
    }
}
