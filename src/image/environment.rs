//! Images that scenes refer to, as linear RGB: environment maps from OpenEXR and Radiance files.

use std::path::Path;

use crate::error::{Error, Result, Span};
use crate::image::exr;

/// A linear RGB image, rows from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RgbImage {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[f32; 3]>,
}

/// Load an environment map (`.exr`, `.hdr`; known by content). Every texel is finite and >= 0. Errors name the file.
pub fn load_environment(path: &Path) -> Result<RgbImage> {
    let span = Span { file: path.into(), ..Span::default() };
    let fail = |what: String| Error::scene(&span, what, "give a readable OpenEXR (.exr) or Radiance (.hdr) image");
    let bytes = std::fs::read(path).map_err(|e| fail(format!("cannot read the image: {e}")))?;
    let image = if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        exr::read_rgb(path).map_err(|e| fail(e.to_string()))?
    } else if bytes.starts_with(b"#?") {
        read_radiance(&bytes).map_err(|what| fail(format!("cannot read the Radiance image: {what}")))?
    } else {
        return Err(fail("the image is neither OpenEXR nor Radiance".into()));
    };
    check_texels(&image).map_err(|what| Error::scene(&span, what, "repair the image: radiance is finite and >= 0"))?;
    Ok(image)
}

fn check_texels(image: &RgbImage) -> std::result::Result<(), String> {
    let bad = |x: &f32| !(x.is_finite() && *x >= 0.0);
    match image.pixels.iter().position(|p| p.iter().any(bad)) {
        None => Ok(()),
        Some(i) => {
            let [r, g, b] = image.pixels[i];
            let count = image.pixels.iter().filter(|p| p.iter().any(bad)).count();
            let (x, y) = (i % image.width, i / image.width);
            Err(format!("texel ({x}, {y}) is ({r}, {g}, {b}); {count} such texel(s)"))
        }
    }
}

/// Largest number of texels that a file may claim.
const MAX_TEXELS: usize = 1 << 28;

/// A Radiance picture: text header, then RGBE scanlines, flat or run-length coded (old and new style).
/// Radiance = mantissa * 2^(exponent - 136) / exposure.
fn read_radiance(bytes: &[u8]) -> std::result::Result<RgbImage, String> {
    let mut rest = bytes;
    let mut exposure = 1.0f64;
    next_line(&mut rest)?;
    loop {
        let line = next_line(&mut rest)?;
        match line.split_once('=').map(|(key, value)| (key.trim(), value.trim())) {
            _ if line.is_empty() => break,
            Some(("FORMAT", "32-bit_rle_rgbe")) => {}
            Some(("FORMAT", format)) => return Err(format!("format `{format}` is not 32-bit_rle_rgbe")),
            Some(("EXPOSURE", value)) => {
                let factor: f64 = value.parse().map_err(|_| format!("EXPOSURE={value} is not a number"))?;
                if !(factor > 0.0 && factor.is_finite()) {
                    return Err(format!("EXPOSURE={value} is not positive"));
                }
                exposure *= factor;
            }
            _ => {}
        }
    }

    // Size and orientation, `-Y height +X width` as a rule.
    let line = next_line(&mut rest)?;
    let words: Vec<&str> = line.split_whitespace().collect();
    let (flip_y, flip_x, height, width) = match words[..] {
        [y @ ("-Y" | "+Y"), height, x @ ("+X" | "-X"), width] => (y == "+Y", x == "-X", height, width),
        _ => return Err(format!("resolution `{line}` is not of the form `-Y height +X width`")),
    };
    let number = |s: &str| s.parse::<usize>().ok().filter(|&n| n > 0 && n <= MAX_TEXELS);
    let (Some(height), Some(width)) = (number(height), number(width)) else {
        return Err(format!("resolution `{line}` is not a size"));
    };
    if width * height > MAX_TEXELS {
        return Err(format!("{width} x {height} texels are too many"));
    }

    let mut pixels = Vec::new();
    for y in 0..height {
        let mut row = read_scanline(&mut rest, width).map_err(|what| format!("row {y}: {what}"))?;
        if flip_x {
            row.reverse();
        }
        pixels.extend(row.into_iter().map(|rgbe| from_rgbe(rgbe, exposure)));
    }
    if flip_y {
        pixels = pixels.chunks(width).rev().flatten().copied().collect();
    }
    Ok(RgbImage { width, height, pixels })
}

fn next_line<'a>(rest: &mut &'a [u8]) -> std::result::Result<&'a str, String> {
    let end = rest.iter().position(|&b| b == b'\n').ok_or("the header is cut short")?;
    let line = std::str::from_utf8(&rest[..end]).map_err(|_| "the header is not text")?;
    *rest = &rest[end + 1..];
    Ok(line.trim())
}

fn take<'a>(rest: &mut &'a [u8], n: usize) -> std::result::Result<&'a [u8], String> {
    if rest.len() < n {
        return Err("the file is cut short".into());
    }
    let (head, tail) = rest.split_at(n);
    *rest = tail;
    Ok(head)
}

fn read_scanline(rest: &mut &[u8], width: usize) -> std::result::Result<Vec<[u8; 4]>, String> {
    let new_style = (8..32768).contains(&width) && rest.len() >= 4 && rest[0] == 2 && rest[1] == 2 && rest[2] < 128;
    if !new_style {
        return read_old_scanline(rest, width);
    }
    let head = take(rest, 4)?;
    if usize::from(head[2]) << 8 | usize::from(head[3]) != width {
        return Err("its length is not the image's width".into());
    }
    // Four planes, each of runs (count > 128) and literals.
    let mut row = vec![[0u8; 4]; width];
    for plane in 0..4 {
        let mut x = 0;
        while x < width {
            let count = usize::from(take(rest, 1)?[0]);
            let (n, run) = if count > 128 { (count - 128, true) } else { (count, false) };
            if n == 0 || x + n > width {
                return Err("a run goes past its end".into());
            }
            let values = take(rest, if run { 1 } else { n })?;
            for i in 0..n {
                row[x + i][plane] = values[if run { 0 } else { i }];
            }
            x += n;
        }
    }
    Ok(row)
}

/// Flat texels; (1, 1, 1, n) repeats the last one n times, n << 8 times when it follows another repeat, and so on.
fn read_old_scanline(rest: &mut &[u8], width: usize) -> std::result::Result<Vec<[u8; 4]>, String> {
    let mut row: Vec<[u8; 4]> = Vec::new();
    let mut shift = 0;
    while row.len() < width {
        let t = take(rest, 4)?;
        if t[..3] == [1, 1, 1] {
            let last = *row.last().ok_or("a repeat without a texel before it")?;
            let n = if shift < 32 { usize::from(t[3]) << shift } else { usize::MAX };
            if n > width - row.len() {
                return Err("a run goes past its end".into());
            }
            row.resize(row.len() + n, last);
            shift += 8;
        } else {
            row.push([t[0], t[1], t[2], t[3]]);
            shift = 0;
        }
    }
    Ok(row)
}

fn from_rgbe([r, g, b, e]: [u8; 4], exposure: f64) -> [f32; 3] {
    let scale = if e == 0 { 0.0 } else { 2f64.powi(i32::from(e) - 136) / exposure };
    [r, g, b].map(|m| (f64::from(m) * scale) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(name: &str, bytes: &[u8]) -> std::result::Result<RgbImage, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        load_environment(&path).map_err(|e| {
            assert_eq!(e.exit_code(), crate::error::ExitCode::Scene);
            assert!(e.to_string().contains(name), "{e}");
            e.to_string()
        })
    }

    fn hdr(header: &str, size: &str, data: &[u8]) -> Vec<u8> {
        [format!("#?RADIANCE\n{header}\n{size}\n").as_bytes(), data].concat()
    }

    #[test]
    fn flat_and_old_runs() {
        let data = [128, 64, 0, 129, 1, 1, 1, 2, 255, 0, 0, 0];
        let image = load("a.hdr", &hdr("FORMAT=32-bit_rle_rgbe\n", "-Y 2 +X 2", &data)).unwrap_err();
        assert!(image.contains("row 0") && image.contains("past its end"), "{image}");
        let image = load("a.hdr", &hdr("FORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n", "-Y 1 +X 4", &data)).unwrap();
        assert_eq!(image.pixels, [[0.5, 0.25, 0.0], [0.5, 0.25, 0.0], [0.5, 0.25, 0.0], [0.0; 3]]);
        let flipped = load("a.hdr", &hdr("", "+Y 2 -X 1", &[128, 0, 0, 129, 0, 128, 0, 129])).unwrap();
        assert_eq!(flipped.pixels, [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
    }

    #[test]
    fn new_runs() {
        // Width 10: R = 10 x 128 (one run), G = literals 0..10, B = 3 + 7 runs, E = 10 x 129.
        let mut data = vec![2, 2, 0, 10, 138, 128, 10];
        data.extend(0..10);
        data.extend([131, 5, 135, 6, 138, 129]);
        let bytes = hdr("FORMAT=32-bit_rle_rgbe\n", "-Y 1 +X 10", &data);
        let image = load("b.hdr", &bytes).unwrap();
        assert_eq!(image.pixels[9], [1.0, 9.0 / 128.0, 6.0 / 128.0]);
        assert_eq!(image.pixels[2][2], 5.0 / 128.0);
        for cut in 0..bytes.len() {
            assert!(load("b.hdr", &bytes[..cut]).is_err(), "cut at {cut}");
        }
    }

    #[test]
    fn errors_say_why() {
        assert!(load("c.png", b"\x89PNG").unwrap_err().contains("neither OpenEXR nor Radiance"));
        assert!(load("d.hdr", &hdr("FORMAT=32-bit_rle_xyze\n", "-Y 1 +X 1", &[])).unwrap_err().contains("xyze"));
        assert!(load("e.hdr", &hdr("", "+X 1 -Y 1", &[])).unwrap_err().contains("resolution"));
        assert!(load("f.hdr", &hdr("", "-Y 99999999 +X 99999999", &[])).unwrap_err().contains("too many"));
        assert!(load_environment(Path::new("/nowhere/x.hdr")).unwrap_err().to_string().contains("/nowhere/x.hdr"));
    }

    #[test]
    fn bad_texels_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("env.exr");
        for bad in [f32::NAN, f32::INFINITY, -1.0] {
            let mut pixels = vec![[1.0f32; 3]; 6];
            pixels[4][1] = bad;
            let mut image = exr::ExrImage::new(3, 2);
            image.push_rgb("", &pixels);
            exr::write(&path, &image).unwrap();
            let e = load_environment(&path).unwrap_err().to_string();
            assert!(e.contains("env.exr") && e.contains("texel (1, 1)"), "{e}");
        }
    }
}
