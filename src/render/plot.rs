//! Plots: error against run time on logarithmic axes with a -1/2 guide, and lines such as the history of a fit. PNG and SVG.
//!
//! Both are drawn at three times their size: PNG is averaged down (smooth lines), SVG keeps the finer coordinates.
//! Text in PNG uses the built-in font, text in SVG is text: neither asks the system for a font.

use std::path::Path;

use plotters::coord::Shift;
use plotters::element::{Drawable, PointCollection};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::error::{Error, Result};
use crate::image::output;
use crate::render::font;
use crate::render::png::Canvas;

#[derive(Clone, Debug, Default)]
pub struct Series {
    pub name: String,
    pub points: Vec<(f64, f64)>,
}

#[derive(Clone, Debug, Default)]
pub struct Plot {
    pub title: String,
    pub x_label: String,
    pub y_label: String,
    pub log_x: bool,
    pub log_y: bool,
    /// Slope of a dashed guide through the first point shown (logarithmic axes only).
    pub guide: Option<f64>,
    pub series: Vec<Series>,
}

const WIDTH: usize = 960;
const HEIGHT: usize = 600;
/// Drawing units a pixel.
const FINE: i32 = 3;
/// The axes' box in pixels: left, top, right, bottom. The legend stands at its right.
const FRAME: [i32; 4] = [90, 64, 700, 540];
/// Drawing units a dot of text: two pixels.
const DOT: i32 = 2 * FINE;
/// Markers are drawn up to this many points a series.
const MAX_MARKERS: usize = 48;

/// Colours that the colour-blind can tell apart (Okabe and Ito).
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(40, 40, 40),
];
const GRID: RGBColor = RGBColor(222, 222, 222);
const GUIDE: RGBColor = RGBColor(130, 130, 130);

impl Plot {
    /// Error against seconds, both logarithmic, with the guide of slope -1/2 that independent samples follow.
    pub fn error_over_time(title: impl Into<String>, y_label: impl Into<String>, series: Vec<Series>) -> Self {
        Plot {
            title: title.into(),
            x_label: "time / s".into(),
            y_label: y_label.into(),
            log_x: true,
            log_y: true,
            guide: Some(-0.5),
            series,
        }
    }

    /// Lines on linear axes.
    pub fn lines(
        title: impl Into<String>,
        x_label: impl Into<String>,
        y_label: impl Into<String>,
        series: Vec<Series>,
    ) -> Self {
        let (title, x_label, y_label) = (title.into(), x_label.into(), y_label.into());
        Plot { title, x_label, y_label, series, ..Plot::default() }
    }

    /// Write as PNG or SVG, by the name's ending. Points that the axes cannot show (not finite, not positive on a
    /// logarithmic axis) are counted in the legend.
    pub fn write(&self, path: &Path) -> Result<()> {
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("png") => self.draw_png()?.write(path),
            Some("svg") => output::write_bytes(path, self.draw_svg()?.as_bytes()),
            _ => Err(Error::usage(
                format!("cannot tell the plot's format from `{}`", path.display()),
                "let the name end in .png or .svg",
            )),
        }
    }

    fn draw_png(&self) -> Result<Canvas> {
        let (fine, width, height) = (FINE as usize, WIDTH * FINE as usize, HEIGHT * FINE as usize);
        let mut buffer = vec![255u8; 3 * width * height];
        {
            let area = BitMapBackend::with_buffer(&mut buffer, (width as u32, height as u32)).into_drawing_area();
            Pen { area, native_text: false }.draw(self)?;
        }
        // Average blocks of FINE x FINE.
        let mut canvas = Canvas::new(WIDTH, HEIGHT);
        for (i, pixel) in canvas.pixels.iter_mut().enumerate() {
            let (x, y) = (i % WIDTH * fine, i / WIDTH * fine);
            for c in 0..3 {
                let at = |k: usize| u32::from(buffer[((y + k / fine) * width + x + k % fine) * 3 + c]);
                let n = fine * fine;
                pixel[c] = ((0..n).map(at).sum::<u32>() / n as u32) as u8;
            }
        }
        Ok(canvas)
    }

    fn draw_svg(&self) -> Result<String> {
        let (width, height) = (WIDTH as u32 * FINE as u32, HEIGHT as u32 * FINE as u32);
        let mut text = String::new();
        {
            let area = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
            Pen { area, native_text: true }.draw(self)?;
        }
        // Show it at its size; the view box keeps the fine units.
        let large = format!("width=\"{width}\" height=\"{height}\" viewBox");
        Ok(text.replacen(&large, &format!("width=\"{WIDTH}\" height=\"{HEIGHT}\" viewBox"), 1))
    }
}

/// One axis: value to drawing unit.
struct Axis {
    log: bool,
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Axis {
    /// An axis that holds all values that it can show, with a margin.
    fn new(log: bool, values: impl Iterator<Item = f64>, from: i32, to: i32) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in values.filter(|&v| showable(log, v)).map(|v| if log { v.log10() } else { v }) {
            (low, high) = (low.min(v), high.max(v));
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        // Room for a single value; a margin of 4 %.
        let least = if log { 0.5 } else { (1e-9 * low.abs().max(high.abs())).max(f64::MIN_POSITIVE) };
        let margin =
            if high - low < least { if log { 0.5 } else { 0.5 * low.abs().max(1.0) } } else { 0.04 * (high - low) };
        Axis { log, low: low - margin, high: high + margin, from: f64::from(from * FINE), to: f64::from(to * FINE) }
    }

    fn at(&self, v: f64) -> i32 {
        let t = ((if self.log { v.log10() } else { v }) - self.low) / (self.high - self.low);
        (self.from + t * (self.to - self.from)).round() as i32
    }

    /// Values with a label: decades (and 2, 5 where there are few), or steps of 1, 2, 5 times a power of ten.
    fn ticks(&self) -> Vec<f64> {
        if self.log {
            let decades = self.low.floor() as i32..=self.high.ceil() as i32;
            let every = (((self.high - self.low) / 10.0).ceil() as i32).max(1);
            let digits: &[f64] = if self.high - self.low < 2.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
            let all = decades.filter(|k| k % every == 0).flat_map(|k| digits.iter().map(move |d| d * 10f64.powi(k)));
            return all.filter(|v| (self.low..=self.high).contains(&v.log10())).collect();
        }
        let rough = (self.high - self.low) / 6.0;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|d| d * power).into_iter().find(|&s| s >= rough).unwrap_or(rough);
        let (first, last) = ((self.low / step).ceil(), (self.high / step).floor());
        (0..=(last - first) as usize).map(|i| (first + i as f64) * step).collect()
    }
}

fn showable(log: bool, v: f64) -> bool {
    v.is_finite() && (!log || v > 0.0)
}

/// A drawing area, and whether its backend writes text by itself.
struct Pen<DB: DrawingBackend> {
    area: DrawingArea<DB, Shift>,
    native_text: bool,
}

impl<DB: DrawingBackend> Pen<DB> {
    fn draw(&self, plot: &Plot) -> Result<()> {
        let [left, top, right, bottom] = FRAME;
        let points = || plot.series.iter().flat_map(|s| &s.points);
        let shown = |&(x, y): &(f64, f64)| showable(plot.log_x, x) && showable(plot.log_y, y);
        let visible = || points().copied().filter(shown);
        let x = Axis::new(plot.log_x, visible().map(|p| p.0), left, right);
        let y = Axis::new(plot.log_y, visible().map(|p| p.1), bottom, top);
        self.put(&Rectangle::new(
            [(0, 0), (WIDTH as i32 * FINE, HEIGHT as i32 * FINE)],
            RGBColor(255, 255, 255).filled(),
        ))?;

        // Grid, numbers, frame, names.
        for v in x.ticks() {
            self.line(&[(x.at(v), top * FINE), (x.at(v), bottom * FINE)], GRID, 1)?;
            self.text(&font::number(v), (x.at(v), (bottom + 8) * FINE), HPos::Center)?;
        }
        for v in y.ticks() {
            self.line(&[(left * FINE, y.at(v)), (right * FINE, y.at(v))], GRID, 1)?;
            self.text(&font::number(v), ((left - 8) * FINE, y.at(v) - 7 * DOT / 2), HPos::Right)?;
        }
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)];
        self.line(&corners.map(|(x, y)| (x * FINE, y * FINE)), BLACK, 1)?;
        self.text(&plot.title, (left * FINE, 12 * FINE), HPos::Left)?;
        self.text(&plot.y_label, (left * FINE, 40 * FINE), HPos::Left)?;
        self.text(&plot.x_label, ((left + right) / 2 * FINE, (bottom + 34) * FINE), HPos::Center)?;

        // Guide, series, legend.
        let mut legend = (right + 16, top);
        if let (Some(slope), true, Some(through)) = (plot.guide, plot.log_x && plot.log_y, visible().next()) {
            self.guide(&x, &y, slope, through)?;
            let name = if slope == -0.5 { "slope -1/2".into() } else { format!("slope {}", font::number(slope)) };
            self.legend(&mut legend, &name, GUIDE, None)?;
        }
        for (i, series) in plot.series.iter().enumerate() {
            let color = COLORS[i % COLORS.len()];
            let line: Vec<(i32, i32)> =
                series.points.iter().filter(|&p| shown(p)).map(|p| (x.at(p.0), y.at(p.1))).collect();
            self.line(&line, color, 2)?;
            let markers = line.len() <= MAX_MARKERS;
            for &(px, py) in line.iter().filter(|_| markers) {
                self.marker((px, py), color, i / COLORS.len())?;
            }
            let hidden = series.points.len() - line.len();
            let name = if hidden == 0 { series.name.clone() } else { format!("{} ({hidden} not shown)", series.name) };
            self.legend(&mut legend, &name, color, markers.then_some(i / COLORS.len()))?;
        }
        self.area.present().map_err(drawing_error)
    }

    /// A dashed line of the given slope in decades through a point, inside the frame.
    fn guide(&self, x: &Axis, y: &Axis, slope: f64, through: (f64, f64)) -> Result<()> {
        let height = |lx: f64| through.1.log10() + slope * (lx - through.0.log10());
        let inside = |lx: f64| (y.low..=y.high).contains(&height(lx));
        const DASHES: usize = 60;
        for i in 0..DASHES {
            let [a, b] = [0.0, 0.55].map(|d| x.low + (x.high - x.low) * (i as f64 + d) / DASHES as f64);
            if inside(a) && inside(b) {
                let ends = [a, b].map(|lx| (x.at(10f64.powf(lx)), y.at(10f64.powf(height(lx)))));
                self.line(&ends, GUIDE, 1)?;
            }
        }
        Ok(())
    }

    /// A line of the legend; names too long for the margin are broken.
    fn legend(&self, at: &mut (i32, i32), name: &str, color: RGBColor, marker: Option<usize>) -> Result<()> {
        let (x, y) = (at.0 * FINE, at.1 * FINE + 7 * DOT / 2);
        self.line(&[(x, y), (x + 24 * FINE, y)], color, if color == GUIDE { 1 } else { 2 })?;
        if let Some(shape) = marker {
            self.marker((x + 12 * FINE, y), color, shape)?;
        }
        let room = (WIDTH as i32 - at.0 - 32) * FINE / (DOT * font::ADVANCE as i32);
        for line in font::wrap(name, room as usize) {
            self.text(&line, ((at.0 + 32) * FINE, at.1 * FINE), HPos::Left)?;
            at.1 += 20;
        }
        at.1 += 4;
        Ok(())
    }

    /// Circles first, squares when the colours come round again.
    fn marker(&self, (x, y): (i32, i32), color: RGBColor, shape: usize) -> Result<()> {
        let r = 4 * FINE;
        match shape % 2 {
            0 => self.put(&Circle::new((x, y), r, color.filled())),
            _ => self.put(&Rectangle::new([(x - r, y - r), (x + r, y + r)], color.filled())),
        }
    }

    /// `width` in pixels.
    fn line(&self, points: &[(i32, i32)], color: RGBColor, width: u32) -> Result<()> {
        if points.len() < 2 {
            return Ok(());
        }
        self.put(&PathElement::new(points.to_vec(), color.stroke_width(width * FINE as u32)))
    }

    /// A line of text whose top is at `y`.
    fn text(&self, text: &str, (x, y): (i32, i32), anchor: HPos) -> Result<()> {
        if self.native_text {
            let style =
                TextStyle::from(("sans-serif", 17.0 * f64::from(FINE)).into_font()).pos(Pos::new(anchor, VPos::Top));
            return self.put(&Text::new(text.to_string(), (x, y), style));
        }
        let width = font::text_width(text) as i32 * DOT;
        let x = match anchor {
            HPos::Left => x,
            HPos::Center => x - width / 2,
            HPos::Right => x - width,
        };
        for (dx, dy, length) in font::runs(text) {
            let (x, y) = (x + dx as i32 * DOT, y + dy as i32 * DOT);
            // The bitmap backend leaves out the last row and column of a filled rectangle.
            let end = (x + length as i32 * DOT, y + DOT);
            self.put(&Rectangle::new([(x, y), end], BLACK.filled()))?;
        }
        Ok(())
    }

    fn put<E>(&self, element: &E) -> Result<()>
    where
        for<'a> &'a E: PointCollection<'a, (i32, i32)>,
        E: Drawable<DB>,
    {
        self.area.draw(element).map_err(drawing_error)
    }
}

fn drawing_error(e: impl std::fmt::Display) -> Error {
    Error::Runtime(format!("cannot draw the plot: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sqrt_law(name: &str, scale: f64, n: i32) -> Series {
        let wobble = |i: i32| 1.0 + 0.15 * f64::from(i * 7 % 5 - 2);
        let points = (0..n).map(|i| (0.1 * 2f64.powi(i), scale * wobble(i) / 2f64.powf(0.5 * f64::from(i))));
        Series { name: name.into(), points: points.collect() }
    }

    fn folder() -> (std::path::PathBuf, tempfile::TempDir) {
        let dir = tempfile::tempdir().unwrap();
        (std::env::var_os("TYNDALL_TEST_PICTURES").map_or_else(|| dir.path().into(), Into::into), dir)
    }

    #[test]
    fn error_plot_is_written_in_both_formats() {
        let (dir, _keep) = folder();
        let mut without = sqrt_law("without surface_edge", 0.2, 12);
        without.points.iter_mut().for_each(|p| p.1 = p.1.hypot(0.05));
        without.points.push((100.0, f64::NAN));
        let series = vec![sqrt_law("tyndall", 0.1, 12), sqrt_law("finite differences", 3.0, 12), without];
        let plot =
            Plot::error_over_time("penumbra in fog: d/d light_x", "relative error (rms over 8 x 8 blocks)", series);
        plot.write(&dir.join("error.png")).unwrap();
        plot.write(&dir.join("error.svg")).unwrap();
        let svg = std::fs::read_to_string(dir.join("error.svg")).unwrap();
        assert!(svg.starts_with("<svg width=\"960\" height=\"600\" viewBox=\"0 0 2880 1800\""), "{}", &svg[..80]);
        assert!(svg.contains("slope -1/2") && svg.contains("not shown") && svg.trim_end().ends_with("</svg>"));
        let png = std::fs::read(dir.join("error.png")).unwrap();
        assert!(png.starts_with(b"\x89PNG"));
        assert!(plot.write(&dir.join("error.pdf")).is_err());
    }

    #[test]
    fn line_plot_and_edge_cases_are_drawn() {
        let (dir, _keep) = folder();
        let history = |k: f64| (0..200).map(|i| (f64::from(i), 2.0 - k * (-f64::from(i) / 40.0).exp())).collect();
        let names = ["light_x", "smoke.sigma_t"];
        let series =
            names.into_iter().zip([1.5, 3.0]).map(|(name, k)| Series { name: name.into(), points: history(k) });
        let plot = Plot::lines("fit: parameters", "iteration", "value", series.collect());
        plot.write(&dir.join("fit.png")).unwrap();
        // Nothing to show, one point, equal values, huge values.
        let empty = Plot::error_over_time("empty", "", vec![Series::default()]);
        assert!(empty.draw_png().is_ok());
        for points in
            [vec![(0.0, 0.0)], vec![(1.0, 5.0); 3], vec![(1.0, 1e300), (2.0, -1e300)], vec![(1.0, 1e-9), (9.0, 1e-9)]]
        {
            for log in [false, true] {
                let series = vec![Series { name: "s".into(), points: points.clone() }];
                let plot = Plot { log_x: log, log_y: log, guide: Some(-0.5), series, ..Plot::default() };
                assert!(plot.draw_svg().is_ok());
            }
        }
    }

    #[test]
    fn ticks_are_round_and_few() {
        let a = Axis::new(false, [0.0, 199.0].into_iter(), 0, 100);
        assert_eq!(a.ticks(), [0.0, 50.0, 100.0, 150.0, 200.0]);
        let a = Axis::new(true, [1e-4, 1.0].into_iter(), 0, 100);
        assert_eq!(a.ticks().len(), 5);
        let a = Axis::new(true, [1e-60, 1.0].into_iter(), 0, 100);
        assert!((5..12).contains(&a.ticks().len()));
    }
}
