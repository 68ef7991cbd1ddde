//! Pictures that are written already on one sheet: rows of PNG files, each row below its title.

use super::font;
use super::png::{Canvas, GAP, LINE, TEXT};
use crate::error::{Error, Result};
use std::fs::File;
use std::path::{Path, PathBuf};

/// Pictures side by side. Without a title, the row stands right below the one before.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Row {
    pub title: String,
    pub files: Vec<PathBuf>,
}

/// Write rows one below the other, pictures as large as they are. Errors: a file that cannot be read, or is no RGB picture of
/// 8 bits; of animated ones the first frame counts.
pub fn write(path: &Path, rows: &[Row]) -> Result<()> {
    let mut drawn: Vec<(&str, Vec<Canvas>)> = Vec::new();
    for row in rows {
        drawn.push((&row.title, row.files.iter().map(|f| read(f)).collect::<Result<_>>()?));
    }
    let head = |title: &str| if title.is_empty() { 0 } else { GAP + 2 * LINE };
    let tall = |row: &[Canvas]| row.iter().map(|c| c.height).max().unwrap_or(0);
    let wide = |(title, row): &(&str, Vec<Canvas>)| {
        let text = 2 * GAP + font::text_width(title) * 2 * TEXT;
        row.iter().map(|c| c.width).sum::<usize>().max(text)
    };
    let height = drawn.iter().map(|(title, row)| head(title) + tall(row)).sum::<usize>();
    let mut sheet = Canvas::new(drawn.iter().map(wide).max().unwrap_or(1), height.max(1));
    let mut y = 0;
    for (title, row) in &drawn {
        sheet.text(GAP, y + GAP, 2 * TEXT, title);
        y += head(title);
        let mut x = 0;
        for picture in row {
            sheet.blit(x, y, 1, picture.width, &picture.pixels);
            x += picture.width;
        }
        y += tall(row);
    }
    sheet.write(path)
}

fn read(path: &Path) -> Result<Canvas> {
    let io = |source| Error::Io { what: format!("cannot read {}", path.display()), source };
    let fail = |what: String| Error::usage(format!("{}: {what}", path.display()), "give .png files that tyndall wrote");
    let mut reader = ::png::Decoder::new(File::open(path).map_err(io)?).read_info().map_err(|e| fail(e.to_string()))?;
    if reader.output_color_type() != (::png::ColorType::Rgb, ::png::BitDepth::Eight) {
        return Err(fail("not an RGB picture of 8 bits a channel".into()));
    }
    let mut bytes = vec![0; reader.output_buffer_size()];
    let frame = reader.next_frame(&mut bytes).map_err(|e| fail(e.to_string()))?;
    let pixels = bytes[..frame.buffer_size()].chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    Ok(Canvas { width: frame.width as usize, height: frame.height as usize, pixels })
}
