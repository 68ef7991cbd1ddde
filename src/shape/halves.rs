//! Which faces of a triangle mesh share an edge: in time and memory linear in the faces.

/// An edge of a mesh as one of its faces has it, from corner k to corner k + 1: 3 face + k.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Half(u32);

impl Half {
    pub const NONE: Half = Half(u32::MAX);

    pub fn face(self) -> u32 {
        self.0 / 3
    }

    /// Which of the face's corners it starts from.
    pub fn first(self) -> u32 {
        self.0 % 3
    }

    /// The vertex `offset` corners after the one that it starts from.
    pub fn corner(self, faces: &[[u32; 3]], offset: u32) -> u32 {
        faces[self.face() as usize][((self.first() + offset) % 3) as usize]
    }
}

/// Every edge of these faces as the halves that they have of it, in the order of its ends. `name`: which vertices are one, below `names`.
/// Faces that `keep` does not take, and those whose corners are not three vertices, have no edges.
pub fn by_edge(
    faces: &[[u32; 3]],
    names: usize,
    name: impl Fn(u32) -> u32,
    keep: impl Fn(u32) -> bool,
    mut f: impl FnMut(&[Half]),
) {
    // Sorted by the lower end by counting; the few that share one by the other end.
    let each = |visit: &mut dyn FnMut(u32, u32, Half)| {
        for (face, corners) in faces.iter().enumerate() {
            let [a, b, c] = corners.map(&name);
            if a != b && b != c && c != a && keep(face as u32) {
                for (k, (i, j)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
                    visit(i.min(j), i.max(j), Half(3 * face as u32 + k as u32));
                }
            }
        }
    };
    let mut ends = vec![0u32; names + 1];
    each(&mut |low, _, _| ends[low as usize + 1] += 1);
    for v in 0..names {
        ends[v + 1] += ends[v];
    }
    let mut all = vec![(0, Half::NONE); ends[names] as usize];
    // From here on where the next one of each goes, in the end where they end.
    each(&mut |low, high, h| {
        all[ends[low as usize] as usize] = (high, h);
        ends[low as usize] += 1;
    });
    let (mut start, mut group) = (0, Vec::new());
    for &end in &ends[..names] {
        let around = &mut all[start..end as usize];
        around.sort_unstable();
        for edge in around.chunk_by(|x, y| x.0 == y.0) {
            group.clear();
            group.extend(edge.iter().map(|e| e.1));
            f(&group);
        }
        start = end as usize;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn edges_are_those_of_a_map_in_its_order() {
        // Vertices 7 to 9 are one; some faces collapse by it, one is left out, edges have up to several faces.
        let faces: Vec<[u32; 3]> = (0..60u32)
            .map(|i| [i * 7 % 10, (i * i + 3) % 10, (i * 3 + 5) % 10])
            .chain([[7, 8, 2], [0, 1, 2]])
            .collect();
        let (name, keep) = (|v: u32| v.min(7), |f: u32| f != 11);
        let mut expected: BTreeMap<[u32; 2], Vec<Half>> = BTreeMap::new();
        for (f, corners) in faces.iter().enumerate() {
            let c = corners.map(name);
            if c[0] != c[1] && c[1] != c[2] && c[2] != c[0] && keep(f as u32) {
                for k in 0..3 {
                    let (i, j) = (c[k], c[(k + 1) % 3]);
                    expected.entry([i.min(j), i.max(j)]).or_default().push(Half((3 * f + k) as u32));
                }
            }
        }
        let mut found = Vec::new();
        by_edge(&faces, 8, name, keep, |e| found.push(e.to_vec()));
        assert!(found.len() > 10 && found.iter().any(|e| e.len() > 2));
        assert_eq!(found, expected.into_values().collect::<Vec<_>>());
    }
}
