//! PNG previews: tone-mapped pictures, derivative maps in a diverging colour map, sheets of panels with one colour bar.
//!
//! Previews are for looking, the EXR is for measuring.

use std::path::Path;
use std::sync::OnceLock;

use crate::error::{Error, Result};
use crate::image::environment::RgbImage;
use crate::image::output;
use crate::math::Rgb;
use crate::render::font;

/// How linear radiance becomes display brightness, before the sRGB curve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// The 99th percentile of luminance becomes 1.
    #[default]
    Auto,
    /// The same with another quantile, 0 to 1, for pictures with lamps in them.
    Quantile(f64),
    /// Radiance times this factor.
    Scale(f64),
}

/// Colour of values that are not numbers, in pictures and maps.
const NOT_A_NUMBER: [u8; 3] = [0, 170, 0];
const WHITE: [u8; 3] = [255; 3];
const BLACK: [u8; 3] = [0; 3];
const FRAME: [u8; 3] = [160; 3];

/// The q-quantile (0..=1) of the finite values: the smallest one that at least a share q does not exceed. `None` if there is none.
fn quantile(values: impl Iterator<Item = f64>, q: f64) -> Option<f64> {
    let mut v: Vec<f64> = values.filter(|x| x.is_finite()).collect();
    let rank = ((q * v.len() as f64).ceil() as usize).max(1);
    if v.is_empty() {
        return None;
    }
    let (_, x, _) = v.select_nth_unstable_by(rank - 1, f64::total_cmp);
    Some(*x)
}

/// The quantile, or where that is zero (few pixels lit) the largest value, or 1.
fn positive_quantile(values: &[f64], q: f64) -> f64 {
    [q, 1.0].into_iter().filter_map(|q| quantile(values.iter().copied(), q)).find(|&x| x > 0.0).unwrap_or(1.0)
}

/// Luminance of every pixel: the scalar that derivative maps show.
pub fn luminance(pixels: &[[f32; 3]]) -> Vec<f32> {
    pixels.iter().map(|p| Rgb(p.map(f64::from)).luminance() as f32).collect()
}

/// The factor that an exposure means for these pixels.
pub fn exposure_scale(pixels: &[[f32; 3]], exposure: Exposure) -> f64 {
    let q = match exposure {
        Exposure::Scale(s) => return s,
        Exposure::Auto => 0.99,
        Exposure::Quantile(q) => q,
    };
    let y: Vec<f64> = luminance(pixels).into_iter().map(f64::from).collect();
    1.0 / positive_quantile(&y, q)
}

fn srgb(linear: f64) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    let y = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (y * 255.0).round() as u8
}

/// Exposure, then the sRGB curve; values above 1 saturate.
pub fn tone_map(pixels: &[[f32; 3]], exposure: Exposure) -> Vec<[u8; 3]> {
    let scale = exposure_scale(pixels, exposure);
    let map = |p: &[f32; 3]| {
        if p.iter().any(|x| x.is_nan()) { NOT_A_NUMBER } else { p.map(|x| srgb(f64::from(x) * scale)) }
    };
    pixels.iter().map(map).collect()
}

/// The symmetric range of derivative maps: 99.5th percentile of |d| over all of them (the largest |d| where that is zero).
pub fn symmetric_range<'a>(maps: impl IntoIterator<Item = &'a [f32]>) -> f64 {
    let all: Vec<f64> = maps.into_iter().flatten().map(|&x| f64::from(x).abs()).collect();
    positive_quantile(&all, 0.995)
}

/// Blue (negative) - white (zero) - red (positive), t in -1..=1. Lightness falls linearly and alike on both sides (Oklab).
pub fn diverging(t: f64) -> [u8; 3] {
    const STEPS: i32 = 256;
    static TABLE: OnceLock<Vec<[u8; 3]>> = OnceLock::new();
    let table =
        TABLE.get_or_init(|| (-STEPS..=STEPS).map(|i| diverging_exact(f64::from(i) / f64::from(STEPS))).collect());
    if t.is_nan() {
        return NOT_A_NUMBER;
    }
    table[((t.clamp(-1.0, 1.0) * f64::from(STEPS)).round() as i32 + STEPS) as usize]
}

fn diverging_exact(t: f64) -> [u8; 3] {
    let s = t.abs();
    let (lightness, chroma) = (1.0 - 0.6 * s, 0.15 * (1.0 - (1.0 - s) * (1.0 - s)));
    let hue = if t < 0.0 { 257.0f64 } else { 27.0 }.to_radians();
    let (a, b) = (chroma * hue.cos(), chroma * hue.sin());
    // Oklab to linear sRGB (Ottosson 2020).
    let l = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let m = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let s = (lightness - 0.089_484_177_5 * a - 1.291_485_548 * b).powi(3);
    [
        srgb(4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s),
        srgb(-1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s),
        srgb(-0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701 * s),
    ]
}

/// A picture to draw into, 8-bit sRGB.
pub(super) struct Canvas {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[u8; 3]>,
}

impl Canvas {
    pub fn new(width: usize, height: usize) -> Self {
        Canvas { width, height, pixels: vec![WHITE; width * height] }
    }

    /// Fill a rectangle; what lies outside is cut.
    pub fn fill(&mut self, x: usize, y: usize, width: usize, height: usize, color: [u8; 3]) {
        for row in y..(y + height).min(self.height) {
            let end = (x + width).min(self.width);
            self.pixels[row * self.width + x.min(end)..row * self.width + end].fill(color);
        }
    }

    /// One line of text, `scale` pixels a dot.
    pub fn text(&mut self, x: usize, y: usize, scale: usize, text: &str) {
        for (dx, dy, length) in font::runs(text) {
            self.fill(x + dx * scale, y + dy * scale, length * scale, scale, BLACK);
        }
    }

    /// Nearest-neighbour enlargement by a whole factor.
    pub fn blit(&mut self, x: usize, y: usize, factor: usize, width: usize, pixels: &[[u8; 3]]) {
        for (i, &color) in pixels.iter().enumerate() {
            self.fill(x + i % width * factor, y + i / width * factor, factor, factor, color);
        }
    }

    pub fn write(&self, path: &Path) -> Result<()> {
        output::write_bytes(path, &self.encode().map_err(|e| Error::Runtime(format!("{}: {e}", path.display())))?)
    }

    fn encode(&self) -> std::result::Result<Vec<u8>, ::png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = ::png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(::png::ColorType::Rgb);
        encoder.set_depth(::png::BitDepth::Eight);
        encoder.set_source_srgb(::png::SrgbRenderingIntent::RelativeColorimetric);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        writer.finish()?;
        Ok(bytes)
    }
}

/// The whole factor that makes the longer side at least `least` pixels.
fn enlargement(width: usize, height: usize, least: usize) -> usize {
    least.div_ceil(width.max(height).max(1))
}

/// A picture, tone mapped, pixel by pixel (small ones enlarged to at least 256 pixels).
pub fn write_picture(path: &Path, image: &RgbImage, exposure: Exposure) -> Result<()> {
    let factor = enlargement(image.width, image.height, 256);
    let mut canvas = Canvas::new(image.width * factor, image.height * factor);
    canvas.blit(0, 0, factor, image.width, &tone_map(&image.pixels, exposure));
    canvas.write(path)
}

/// What a panel shows, rows from the top.
#[derive(Clone, Debug)]
pub enum Content {
    Picture(Vec<[f32; 3]>, Exposure),
    /// A signed map, such as [`luminance`] of a derivative layer.
    Derivative(Vec<f32>),
    /// A signed map with a symmetric range and a colour bar of its own, such as a map of z scores.
    Score(Vec<f32>, f64),
}

#[derive(Clone, Debug)]
pub struct Panel {
    pub title: String,
    pub width: usize,
    pub height: usize,
    pub content: Content,
}

impl Panel {
    pub fn picture(title: impl Into<String>, image: &RgbImage, exposure: Exposure) -> Self {
        let content = Content::Picture(image.pixels.clone(), exposure);
        Panel { title: title.into(), width: image.width, height: image.height, content }
    }

    /// The luminance of a derivative layer.
    pub fn derivative(title: impl Into<String>, image: &RgbImage) -> Self {
        let content = Content::Derivative(luminance(&image.pixels));
        Panel { title: title.into(), width: image.width, height: image.height, content }
    }
}

/// Panels side by side, row by row; all derivative panels share one symmetric range and one colour bar, scores have theirs. What has
/// other units belongs on another sheet.
#[derive(Clone, Debug, Default)]
pub struct Sheet {
    pub panels: Vec<Panel>,
    /// Panels a row; 0: up to four.
    pub columns: usize,
    /// Unit of the derivative, shown above the colour bar, such as `radiance / m`.
    pub unit: String,
    /// Half-width of the range; `None`: [`symmetric_range`].
    pub range: Option<f64>,
}

/// Sheets in rows of so many, each with its own ranges and colour bars.
pub fn write_sheets(path: &Path, sheets: &[Sheet], columns: usize) -> Result<()> {
    join(sheets, columns.max(1)).write(path)
}

fn join(sheets: &[Sheet], columns: usize) -> Canvas {
    let drawn: Vec<Canvas> = sheets.iter().map(Sheet::draw).collect();
    let rows: Vec<&[Canvas]> = drawn.chunks(columns).collect();
    let height = |row: &[Canvas]| row.iter().map(|c| c.height).max().unwrap_or(0);
    let width = |row: &[Canvas]| row.iter().map(|c| c.width).sum::<usize>();
    let total = rows.iter().map(|r| height(r)).sum::<usize>();
    let mut all = Canvas::new(rows.iter().map(|r| width(r)).max().unwrap_or(1).max(1), total.max(1));
    let mut y = 0;
    for row in rows {
        let mut x = 0;
        for c in row {
            all.blit(x, y, 1, c.width, &c.pixels);
            x += c.width;
        }
        y += height(row);
    }
    all
}

/// Pixels a dot of text, and the space between things.
pub(super) const TEXT: usize = 2;
pub(super) const LINE: usize = font::GLYPH_HEIGHT * TEXT;
pub(super) const GAP: usize = 12;
const BAR_WIDTH: usize = 24;
/// A cell is at least so wide, in pixels: panels of small pictures stand one below the other on sheets that are joined.
const CELL: usize = 288;

impl Sheet {
    /// The range that the colour bar shows; `None` without derivative panels.
    pub fn shown_range(&self) -> Option<f64> {
        let maps: Vec<&[f32]> = self.panels.iter().filter_map(|p| p.map()).collect();
        (!maps.is_empty()).then(|| self.range.unwrap_or_else(|| symmetric_range(maps)))
    }

    pub fn write(&self, path: &Path) -> Result<()> {
        self.draw().write(path)
    }

    pub(super) fn draw(&self) -> Canvas {
        let range = self.shown_range();
        let columns = if self.columns == 0 { self.panels.len().clamp(1, 4) } else { self.columns };
        let rows = self.panels.len().div_ceil(columns).max(1);
        let factors: Vec<usize> = self.panels.iter().map(|p| enlargement(p.width, p.height, 256)).collect();

        // One cell size for all panels.
        let cells = self.panels.iter().zip(&factors);
        let cell_width = cells.clone().map(|(p, f)| (p.width * f).max(font::text_width(&p.title) * TEXT)).max();
        let cell_height = cells.map(|(p, f)| p.height * f).max();
        let (cell_width, cell_height) = (cell_width.unwrap_or(0).max(CELL), cell_height.unwrap_or(0));
        let (step_x, step_y) = (cell_width + GAP, LINE + GAP / 2 + cell_height + GAP);
        let panels_width = GAP + columns * step_x;
        let mut bars: Vec<ColorBar> = range.map(|r| ColorBar::new(r, &self.unit)).into_iter().collect();
        let scores = self.panels.iter().find_map(|p| if let Content::Score(_, r) = p.content { Some(r) } else { None });
        bars.extend(scores.map(|r| ColorBar::new(r, "z")));
        let width = panels_width + bars.iter().map(|b| b.width() + 2 * GAP).sum::<usize>();
        let mut canvas = Canvas::new(width, GAP + rows * step_y);

        for (i, (panel, &factor)) in self.panels.iter().zip(&factors).enumerate() {
            let (x, y) = (GAP + i % columns * step_x, GAP + i / columns * step_y);
            canvas.text(x, y, TEXT, &panel.title);
            let pixels = panel.colors(range.unwrap_or(1.0));
            // A thin frame: the maps' zero is white, as the paper is.
            let top = y + LINE + GAP / 2;
            canvas.fill(x - 1, top - 1, panel.width * factor + 2, panel.height * factor + 2, FRAME);
            canvas.blit(x, top, factor, panel.width, &pixels);
        }
        let (mut x, top) = (panels_width, GAP + LINE + GAP / 2);
        for bar in bars {
            let height = (rows * step_y - GAP - LINE - GAP / 2).min(512);
            bar.draw(&mut canvas, x, top, height);
            x += bar.width() + 2 * GAP;
        }
        canvas
    }
}

impl Panel {
    fn map(&self) -> Option<&[f32]> {
        if let Content::Derivative(map) = &self.content { Some(map) } else { None }
    }

    fn colors(&self, range: f64) -> Vec<[u8; 3]> {
        match &self.content {
            Content::Picture(pixels, exposure) => tone_map(pixels, *exposure),
            Content::Derivative(map) => map.iter().map(|&v| diverging(f64::from(v) / range)).collect(),
            Content::Score(map, range) => map.iter().map(|&v| diverging(f64::from(v) / range)).collect(),
        }
    }
}

/// The legend of the derivative panels.
struct ColorBar {
    range: f64,
    unit: String,
    labels: Vec<String>,
}

impl ColorBar {
    fn new(range: f64, unit: &str) -> Self {
        let labels = (-2..=2).map(|i| font::number(f64::from(i) * range / 2.0)).collect();
        ColorBar { range, unit: unit.into(), labels }
    }

    fn width(&self) -> usize {
        let label = self.labels.iter().map(|l| font::text_width(l)).max().unwrap_or(0) * TEXT;
        (BAR_WIDTH + 10 + label).max(font::text_width(&self.unit) * TEXT)
    }

    fn draw(&self, canvas: &mut Canvas, x: usize, y: usize, height: usize) {
        canvas.text(x, y - LINE - GAP / 2, TEXT, &self.unit);
        canvas.fill(x, y, BAR_WIDTH, height, BLACK);
        let last = (height - 3) as f64;
        for row in 0..height - 2 {
            let color = diverging(1.0 - 2.0 * row as f64 / last);
            canvas.fill(x + 1, y + 1 + row, BAR_WIDTH - 2, 1, color);
        }
        // Tick labels, centred on their ticks but kept beside the bar.
        for (i, label) in self.labels.iter().enumerate() {
            let at = y + (height - 1) * (4 - i) / 4;
            canvas.fill(x + BAR_WIDTH, at, 5, 1, BLACK);
            let top = at.saturating_sub(7 * TEXT / 2).clamp(y, (y + height).saturating_sub(7 * TEXT));
            canvas.text(x + BAR_WIDTH + 10, top, TEXT, label);
        }
        debug_assert!(self.range > 0.0);
    }
}

#[cfg(test)]
#[path = "png_tests.rs"]
mod tests;
