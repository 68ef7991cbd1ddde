//! Animated pictures: sheets as the frames of an animated PNG, which browsers play and other programs show the first frame of.

use super::png::{Canvas, Sheet};
use crate::error::{Error, Result};
use crate::image::output;
use std::path::Path;

/// Write frames of one size, `per_second` of them; the last one stays for two seconds. Plays forever.
pub fn write(path: &Path, frames: &[Sheet], per_second: u16) -> Result<()> {
    let drawn: Vec<Canvas> = frames.iter().map(Sheet::draw).collect();
    let bytes = encode(&drawn, per_second).map_err(|e| Error::Runtime(format!("{}: {e}", path.display())))?;
    output::write_bytes(path, &bytes)
}

fn encode(frames: &[Canvas], per_second: u16) -> std::result::Result<Vec<u8>, ::png::EncodingError> {
    let (width, height) = frames.first().map_or((1, 1), |c| (c.width, c.height));
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.set_source_srgb(::png::SrgbRenderingIntent::RelativeColorimetric);
    // Small pictures are enlarged by whole factors: rows repeat.
    encoder.set_filter(::png::FilterType::Up);
    encoder.set_compression(::png::Compression::Best);
    encoder.set_animated(frames.len() as u32, 0)?;
    encoder.set_frame_delay(1, per_second)?;
    let mut writer = encoder.write_header()?;
    for (i, frame) in frames.iter().enumerate() {
        if i + 1 == frames.len() {
            writer.set_frame_delay(2, 1)?;
        }
        writer.write_image_data(frame.pixels.as_flattened())?;
    }
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_is_there() {
        let frames: Vec<Canvas> = (0..3).map(|_| Canvas::new(4, 2)).collect();
        let bytes = encode(&frames, 10).unwrap();
        let mut reader = ::png::Decoder::new(&bytes[..]).read_info().unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 3);
        let mut buffer = vec![0; reader.output_buffer_size()];
        for _ in 0..3 {
            reader.next_frame(&mut buffer).unwrap();
        }
    }
}
