//! A fit's state in a file: all that its next iteration depends on, as exact numbers, so that a run that goes on makes the same bits as one that was never stopped.
//!
//! Bytes: `TYNDALLFIT 1\n`; then little-endian 64-bit numbers: fingerprint of the problem, iterations, steps and age of the optimiser, the two counts of the halves, whether
//! it converged, number of parameters; then, as f64, the history line by line, parameters, both moments, both sums.

use super::reverse::{State, Step};
use crate::error::{Error, Result};

const MAGIC: &[u8] = b"TYNDALLFIT 1\n";
const HEADER: usize = 8;

/// FNV-1a.
pub fn fingerprint(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

pub fn write(s: &State, fingerprint: u64) -> Result<Vec<u8>> {
    let header: [u64; HEADER] = [
        fingerprint,
        s.history.len() as u64,
        s.adam.step as u64,
        s.adam.age as u64,
        s.halves.counts[0] as u64,
        s.halves.counts[1] as u64,
        s.converged.into(),
        s.adam.u.len() as u64,
    ];
    let line = |h: &Step| -> Vec<f64> {
        let mut v = vec![h.seconds, h.loss, h.error, h.variation, f64::from(h.spacing)];
        v.extend(h.scalars.iter().chain(&h.gradient).chain(&h.rates));
        v
    };
    let arrays = [&s.adam.u, &s.adam.first, &s.adam.second, &s.halves.sums[0], &s.halves.sums[1]];
    let mut out = MAGIC.to_vec();
    out.extend(header.iter().flat_map(|x| x.to_le_bytes()));
    out.extend(s.history.iter().flat_map(line).flat_map(f64::to_le_bytes));
    out.extend(arrays.into_iter().flatten().flat_map(|x| x.to_le_bytes()));
    Ok(out)
}

fn header(bytes: &[u8]) -> Option<[u64; HEADER]> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let mut out = [0; HEADER];
    for (x, b) in out.iter_mut().zip(rest.get(..8 * HEADER)?.chunks_exact(8)) {
        *x = u64::from_le_bytes(b.try_into().ok()?);
    }
    Some(out)
}

/// How many iterations are behind. Errors: no state, or one of another problem.
pub fn iterations(bytes: &[u8], fingerprint: u64) -> Result<usize> {
    let header = header(bytes).ok_or_else(damaged)?;
    if header[0] != fingerprint {
        return Err(Error::Mismatch {
            what: "the saved state is of another fit".into(),
            remedy: "resume with the settings it began with (only --iterations and --max-time may change), or leave out --resume".into(),
        });
    }
    Ok(header[1] as usize)
}

/// Fill a state of the right number of parameters.
pub fn read(bytes: &[u8], scalars: usize, fields: usize, s: &mut State) -> Result<()> {
    let h = header(bytes).ok_or_else(damaged)?;
    let body = &bytes[MAGIC.len() + 8 * HEADER..];
    let (n, line) = (s.adam.u.len(), 5 + scalars + 2 * (scalars + fields));
    let lines = usize::try_from(h[1]).ok().and_then(|k| k.checked_mul(line));
    let expected = lines.and_then(|k| k.checked_add(5 * n)?.checked_mul(8));
    if h[7] != n as u64 || expected != Some(body.len()) {
        return Err(damaged());
    }
    let numbers: Vec<f64> =
        body.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap_or_default())).collect();
    let (history, arrays) = numbers.split_at(lines.unwrap_or(0));
    let step = |x: &[f64]| {
        let (own, rest) = x[5..].split_at(scalars);
        let (gradient, rates) = rest.split_at(scalars + fields);
        Step {
            seconds: x[0],
            loss: x[1],
            error: x[2],
            variation: x[3],
            spacing: x[4] as i32,
            scalars: own.to_vec(),
            gradient: gradient.to_vec(),
            rates: rates.to_vec(),
        }
    };
    s.history = history.chunks_exact(line).map(step).collect();
    let mut arrays = arrays.chunks_exact(n.max(1)).map(<[f64]>::to_vec);
    let mut next = || arrays.next().ok_or_else(damaged);
    (s.adam.u, s.adam.first, s.adam.second) = (next()?, next()?, next()?);
    s.halves.sums = [next()?, next()?];
    (s.adam.step, s.adam.age) = (h[2] as i32, h[3] as i32);
    s.halves.counts = [h[4] as usize, h[5] as usize];
    s.converged = h[6] != 0;
    Ok(())
}

fn damaged() -> Error {
    Error::Mismatch {
        what: "the saved state is damaged, or no state of a fit".into(),
        remedy: "leave out --resume and start anew".into(),
    }
}
