//! The film as bytes: what resume, shards and merge hand on. Exact sums, so that nothing is lost between runs.
//!
//! Layout, little endian: magic, length of the head, head (JSON: spec, batches, health), then the arrays of the finished
//! batches (low words, high words, squares, rejections), then a checksum (FNV-1a, 64 bits) of all before it.

use std::sync::atomic::Ordering;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::render::film::{Batch, Film, FilmSpec};
use crate::render::health::Mishap;

const MAGIC: &[u8; 8] = b"tyndfil1";

#[derive(Serialize, Deserialize)]
struct Head {
    spec: FilmSpec,
    batches: Vec<Batch>,
    health: Vec<(String, u64)>,
}

fn broken(what: &str) -> Error {
    Error::Runtime(format!("the film's state cannot be used: {what}"))
}

fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |h, &b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
}

impl Film {
    /// The finished batches as bytes. Refused while a batch is in progress: its part would be lost.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        if self.batch_in_progress() {
            return Err(broken("a batch is in progress"));
        }
        let health = self.health.entries().map(|(name, n)| (name.to_string(), n)).collect();
        let head = Head { spec: self.spec().clone(), batches: self.batches.clone(), health };
        let head = serde_json::to_vec(&head).map_err(|e| broken(&e.to_string()))?;
        let mut out = MAGIC.to_vec();
        out.extend((head.len() as u64).to_le_bytes());
        out.extend(head);
        out.extend(self.total_low.iter().flat_map(|x| x.to_le_bytes()));
        out.extend(self.total_high.iter().flat_map(|x| x.to_le_bytes()));
        out.extend(self.squares.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        out.extend(self.rejected.iter().flat_map(|x| x.load(Ordering::Relaxed).to_le_bytes()));
        out.extend(checksum(&out).to_le_bytes());
        Ok(out)
    }

    /// The inverse of [`Film::to_bytes`]. Cut or altered bytes are an error.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let (body, sum) = bytes.split_last_chunk::<8>().ok_or_else(|| broken("it is cut short"))?;
        let rest = body.strip_prefix(MAGIC).ok_or_else(|| broken("it is not the state of a film"))?;
        if u64::from_le_bytes(*sum) != checksum(body) {
            return Err(broken("it is damaged"));
        }
        let (length, rest) = rest.split_first_chunk::<8>().ok_or_else(|| broken("it is cut short"))?;
        let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let (head, mut rest) = rest.split_at_checked(length).ok_or_else(|| broken("it is cut short"))?;
        let head: Head = serde_json::from_slice(head).map_err(|e| broken(&e.to_string()))?;

        // Sizes must agree before anything is allocated.
        let pixels = head.spec.width.checked_mul(head.spec.height);
        let cells = pixels.and_then(|p| p.checked_mul(3 * head.spec.layers.len()));
        let need = cells.and_then(|c| c.checked_mul(36)).and_then(|n| n.checked_add(pixels?.checked_mul(4)?));
        if need != Some(rest.len()) || head.spec.layers.len() != head.spec.quantum.len() {
            return Err(broken("its size does not fit its head"));
        }
        let mut film = Film::try_new(head.spec)?;
        film.total_low.iter_mut().for_each(|x| *x = u64::from_le_bytes(next(&mut rest)));
        film.total_high.iter_mut().for_each(|x| *x = i32::from_le_bytes(next(&mut rest)));
        film.squares.as_flattened_mut().iter_mut().for_each(|x| *x = u64::from_le_bytes(next(&mut rest)));
        film.rejected.iter_mut().for_each(|x| *x.get_mut() = u32::from_le_bytes(next(&mut rest)));
        film.batches = head.batches;
        for (name, n) in head.health {
            let kind = Mishap::ALL.iter().find(|kind| kind.name() == name);
            film.health.add(*kind.ok_or_else(|| broken(&format!("unknown counter `{name}`")))?, n);
        }
        Ok(film)
    }
}

/// The next N bytes; the caller has checked that they are there.
fn next<const N: usize>(rest: &mut &[u8]) -> [u8; N] {
    let mut out = [0; N];
    let (head, tail) = rest.split_at(N);
    out.copy_from_slice(head);
    *rest = tail;
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;

    fn film() -> Film {
        let spec = FilmSpec {
            width: 3,
            height: 2,
            layers: vec!["picture".into(), "d_x".into()],
            quantum: vec![-46, FilmSpec::quantum_for(1e-5)],
        };
        let mut f = Film::new(spec);
        for b in 0..3 {
            for p in 0..6 {
                f.add(p, 0, Rgb([0.1 * p as f64, -1e9, 1e-3 * b as f64]));
                f.add(p, 1, Rgb::splat(1e-5 * (b as f64 - 1.3)));
            }
            f.end_batch(b, 2 + b).unwrap();
        }
        f.add(4, 0, Rgb::splat(f64::NAN));
        f
    }

    #[test]
    fn state_survives_exactly() {
        let f = film();
        let g = Film::from_bytes(&f.to_bytes().unwrap()).unwrap();
        for layer in 0..2 {
            for p in 0..6 {
                assert_eq!(f.mean(layer, p), g.mean(layer, p));
                assert_eq!(f.variance_of_mean(layer, p), g.variance_of_mean(layer, p));
                assert_eq!(f.rejected(p), g.rejected(p));
            }
        }
        assert_eq!((g.batches(), g.spec()), (f.batches(), f.spec()));
        assert_eq!(g.health.get(Mishap::RejectedNonfinite), 1);
        assert_eq!(g.to_bytes().unwrap(), f.to_bytes().unwrap());
    }

    #[test]
    fn damage_is_seen() {
        let bytes = film().to_bytes().unwrap();
        for cut in 0..bytes.len() {
            assert!(Film::from_bytes(&bytes[..cut]).is_err());
        }
        for i in (0..bytes.len()).step_by(7) {
            let mut bad = bytes.clone();
            bad[i] ^= 16;
            assert!(Film::from_bytes(&bad).is_err());
        }
        let f = film();
        f.add(0, 0, Rgb::ONE);
        assert!(f.to_bytes().is_err());
    }
}
