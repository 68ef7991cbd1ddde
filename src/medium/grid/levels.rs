//! Least and greatest value of the field over cubes of bricks: a pyramid, each level twice as coarse along every axis.
//!
//! A ray need not step from brick to brick where the field is constant, thin or smooth: what it costs follows what is there, not the voxels' size.

/// Levels 1, 2, ... over the bricks, level 0.
#[derive(Clone, Debug, Default)]
pub(super) struct Levels {
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    dims: [usize; 3],
    range: Vec<[f32; 2]>,
}

impl Levels {
    /// From the ranges of all bricks, z fastest; levels up to the one that holds everything in one node.
    pub(super) fn new(dims: [usize; 3], bricks: &[[f32; 2]]) -> Levels {
        let mut levels: Vec<Level> = Vec::new();
        while !bricks.is_empty() {
            let (dims, range) = levels.last().map_or((dims, bricks), |l| (l.dims, &l.range[..]));
            if dims == [1; 3] {
                break;
            }
            levels.push(Level::above(dims, range));
        }
        Levels { levels }
    }

    /// The coarsest level.
    #[inline(always)]
    pub(super) fn top(&self) -> usize {
        self.levels.len()
    }

    /// Least and greatest value over the node of a level (1 or more) with a brick.
    #[inline(always)]
    pub(super) fn range(&self, level: usize, brick: [i64; 3]) -> [f32; 2] {
        let l = &self.levels[level - 1];
        let [x, y, z] = brick.map(|b| b as usize >> level);
        l.range[(x * l.dims[1] + y) * l.dims[2] + z]
    }

    pub(super) fn bytes(&self) -> usize {
        self.levels.iter().map(|l| size_of_val(&l.range[..])).sum()
    }
}

impl Level {
    fn above(below: [usize; 3], range: &[[f32; 2]]) -> Level {
        let dims = below.map(|n| n.div_ceil(2));
        let mut out = vec![[f32::INFINITY, f32::NEG_INFINITY]; dims.iter().product()];
        let mut next = range.iter();
        for x in 0..below[0] {
            for y in 0..below[1] {
                let row = ((x >> 1) * dims[1] + (y >> 1)) * dims[2];
                for (z, r) in next.by_ref().take(below[2]).enumerate() {
                    let node = &mut out[row + (z >> 1)];
                    *node = [node[0].min(r[0]), node[1].max(r[1])];
                }
            }
        }
        Level { dims, range: out }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_holds_the_range_of_its_bricks() {
        let dims = [5, 3, 18];
        let value = |x: usize, y: usize, z: usize| ((x * 7 + y * 5 + z * 3) % 23) as f32;
        let mut bricks = Vec::new();
        for x in 0..dims[0] {
            for y in 0..dims[1] {
                bricks.extend((0..dims[2]).map(|z| [value(x, y, z), value(x, y, z) + 0.5]));
            }
        }
        let levels = Levels::new(dims, &bricks);
        assert_eq!(levels.top(), 5);
        for (x, y, z) in [(0, 0, 0), (4, 2, 17), (3, 1, 9)] {
            for level in 1..=5 {
                let n = 1 << level;
                let inside = |i: usize, all: usize| (i / n * n)..((i / n + 1) * n).min(all);
                let mut expected = [f32::INFINITY, f32::NEG_INFINITY];
                for i in inside(x, dims[0]) {
                    for j in inside(y, dims[1]) {
                        for k in inside(z, dims[2]) {
                            expected = [expected[0].min(value(i, j, k)), expected[1].max(value(i, j, k) + 0.5)];
                        }
                    }
                }
                assert_eq!(levels.range(level, [x as i64, y as i64, z as i64]), expected);
            }
        }
        assert_eq!(Levels::new([0; 3], &[]).top(), 0);
        assert_eq!(Levels::new([1; 3], &[[1.0, 2.0]]).top(), 0);
    }
}
