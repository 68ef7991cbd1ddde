//! OpenEXR: one part, float32, ZIP16; channels `R G B`, `d_<param>.R/G/B`, `var.R/G/B`, `var_<param>.R/G/B`, ...
//!
//! Values survive bit by bit. The bytes of the file do not: the library writes header attributes in no fixed order.

use std::io::{BufReader, BufWriter, Write};
use std::path::Path;

use ::exr::prelude::*;
use ::exr::prelude::{Error as ExrError, Result as ExrResult};

use crate::error::{Error, Result};
use crate::image::environment::RgbImage;
use crate::image::output::{io_error, write_atomically};

/// A header attribute.
#[derive(Clone, Debug, PartialEq)]
pub enum Attribute {
    Text(String),
    Real(f64),
    /// Written as the format's 32-bit `int` where it fits, else as text.
    Integer(i64),
}

impl Attribute {
    pub fn as_text(&self) -> Option<&str> {
        if let Attribute::Text(t) = self { Some(t) } else { None }
    }

    /// An integer, whichever way it was written.
    pub fn as_integer(&self) -> Option<i64> {
        match self {
            Attribute::Integer(i) => Some(*i),
            Attribute::Text(t) => t.parse().ok(),
            Attribute::Real(_) => None,
        }
    }

    pub fn as_real(&self) -> Option<f64> {
        match self {
            Attribute::Integer(i) => Some(*i as f64),
            Attribute::Real(x) => Some(*x),
            Attribute::Text(_) => None,
        }
    }
}

impl From<&str> for Attribute {
    fn from(t: &str) -> Self {
        Attribute::Text(t.into())
    }
}

impl From<String> for Attribute {
    fn from(t: String) -> Self {
        Attribute::Text(t)
    }
}

impl From<f64> for Attribute {
    fn from(x: f64) -> Self {
        Attribute::Real(x)
    }
}

impl From<i64> for Attribute {
    fn from(i: i64) -> Self {
        Attribute::Integer(i)
    }
}

/// Named channels of one size, rows from the top, and header attributes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrImage {
    pub width: usize,
    pub height: usize,
    /// Where the data lie in the full picture (`--crop`).
    pub origin: [i32; 2],
    pub full_size: [usize; 2],
    /// Sorted by name when read.
    pub channels: Vec<(String, Vec<f32>)>,
    /// Sorted by name when read.
    pub attributes: Vec<(String, Attribute)>,
}

impl ExrImage {
    /// An image without channels, not cropped.
    pub fn new(width: usize, height: usize) -> Self {
        ExrImage { width, height, full_size: [width, height], ..ExrImage::default() }
    }

    /// Add three channels: `R G B` for an empty layer name, else `<layer>.R` and so on.
    pub fn push_rgb(&mut self, layer: &str, pixels: &[[f32; 3]]) {
        for (c, channel) in ["R", "G", "B"].into_iter().enumerate() {
            self.channels.push((channel_name(layer, channel), pixels.iter().map(|p| p[c]).collect()));
        }
    }

    pub fn set(&mut self, name: impl Into<String>, value: impl Into<Attribute>) {
        self.attributes.push((name.into(), value.into()));
    }

    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|(n, _)| n == name).map(|(_, v)| v)
    }

    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|(n, _)| n == name).map(|(_, v)| v.as_slice())
    }

    /// The three channels of a layer (empty name: the picture).
    pub fn rgb(&self, layer: &str) -> Option<Vec<[f32; 3]>> {
        let [r, g, b] = ["R", "G", "B"].map(|c| self.channel(&channel_name(layer, c)));
        let (r, g, b) = (r?, g?, b?);
        Some((0..r.len()).map(|i| [r[i], g[i], b[i]]).collect())
    }
}

fn channel_name(layer: &str, channel: &str) -> String {
    if layer.is_empty() { channel.into() } else { format!("{layer}.{channel}") }
}

/// Text is kept as UTF-8 bytes, as OpenEXR does.
fn to_text(s: &str) -> Text {
    Text::from_slice_unchecked(s.as_bytes())
}

fn from_text(t: &Text) -> String {
    String::from_utf8_lossy(t.as_slice()).into_owned()
}

/// Attributes for which the format has a name and the library a field.
fn standard_text<'a>(header: &'a mut LayerAttributes, name: &str) -> Option<&'a mut Option<Text>> {
    match name {
        "software" => Some(&mut header.software_name),
        "comments" => Some(&mut header.comments),
        "owner" => Some(&mut header.owner),
        "capDate" => Some(&mut header.capture_date),
        _ => None,
    }
}

/// Write atomically, replacing an existing file.
pub fn write(path: &Path, image: &ExrImage) -> Result<()> {
    let bad = |what: String| Error::Runtime(format!("cannot write {}: {what}", path.display()));
    let (width, height) = (image.width, image.height);
    if width * height == 0 || image.channels.is_empty() {
        return Err(bad("the image is empty".into()));
    }

    // Channels, each of the image's size, no name twice.
    let mut names: Vec<&String> = image.channels.iter().map(|(n, _)| n).collect();
    names.sort();
    if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
        return Err(bad(format!("channel `{}` is given twice", twice[0])));
    }
    if let Some((name, data)) = image.channels.iter().find(|(_, data)| data.len() != width * height) {
        return Err(bad(format!("channel `{name}` has {} values, not {width} x {height}", data.len())));
    }
    let channels = image.channels.iter().map(|(name, data)| AnyChannel {
        name: to_text(name),
        sample_data: FlatSamples::F32(data.clone()),
        quantize_linearly: false,
        sampling: Vec2(1, 1),
    });
    let channels = AnyChannels::sort(channels.collect());

    // Header.
    let mut header =
        LayerAttributes { layer_position: Vec2(image.origin[0], image.origin[1]), ..LayerAttributes::default() };
    for (name, value) in &image.attributes {
        let value = match value {
            Attribute::Real(x) => AttributeValue::F64(*x),
            Attribute::Integer(i) if i32::try_from(*i).is_ok() => AttributeValue::I32(*i as i32),
            Attribute::Integer(i) => AttributeValue::Text(to_text(&i.to_string())),
            Attribute::Text(t) => AttributeValue::Text(to_text(t)),
        };
        match (standard_text(&mut header, name), value) {
            (Some(slot), AttributeValue::Text(t)) => *slot = Some(t),
            (_, value) => drop(header.other.insert(to_text(name), value)),
        }
    }
    let encoding =
        Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer = Layer::new((width, height), header, encoding, channels);
    let display = IntegerBounds::new((0, 0), (image.full_size[0], image.full_size[1]));
    let file_image = Image { attributes: ImageAttributes::new(display), layer_data: layer };

    write_atomically(path, |file| {
        let mut out = BufWriter::new(file);
        file_image.write().to_buffered(&mut out).map_err(|e| exr_error("cannot write", path, e))?;
        out.flush().map_err(|e| io_error("cannot write", path, e))
    })
}

fn exr_error(doing: &str, path: &Path, e: ExrError) -> Error {
    match e {
        ExrError::Io(e) => io_error(doing, path, e),
        other => Error::Runtime(format!("{doing} {}: {other}", path.display())),
    }
}

/// Read every channel of every part as float32 (half is exact, unsigned integers are rounded). Parts must have one size;
/// the channels of a second part are named `<part>.<channel>`.
pub fn read(path: &Path) -> Result<ExrImage> {
    let file = std::fs::File::open(path).map_err(|e| io_error("cannot read", path, e))?;
    let file_image = read_parts(BufReader::new(file)).map_err(|e| exr_error("cannot read", path, e))?;
    let bad = |what: String| Error::Runtime(format!("cannot read {}: {what}", path.display()));
    let first = file_image.layer_data.first().ok_or_else(|| bad("the file has no image".into()))?;
    let display = file_image.attributes.display_window;
    let mut image = ExrImage {
        width: first.size.x(),
        height: first.size.y(),
        origin: [0, 1].map(|i| pair(first.attributes.layer_position)[i].wrapping_sub(pair(display.position)[i])),
        full_size: pair(display.size),
        ..ExrImage::default()
    };

    for (i, layer) in file_image.layer_data.iter().enumerate() {
        if layer.size != first.size || layer.attributes.layer_position != first.attributes.layer_position {
            return Err(bad("its parts differ in size".into()));
        }
        let part = layer.attributes.layer_name.as_ref().map_or_else(|| i.to_string(), from_text);
        let part = if i == 0 { String::new() } else { part };
        for channel in &layer.channel_data.list {
            if channel.sampling != Vec2(1, 1) {
                return Err(bad(format!("channel `{}` is subsampled", from_text(&channel.name))));
            }
            let name = channel_name(&part, &from_text(&channel.name));
            image.channels.push((name, channel.sample_data.values_as_f32().collect()));
        }
    }
    image.channels.sort_by(|a, b| a.0.cmp(&b.0));

    // Attributes that the format knows and ours; other kinds (matrices, previews) are not for us.
    let mut header = first.attributes.clone();
    for name in ["software", "comments", "owner", "capDate"] {
        if let Some(Some(t)) = standard_text(&mut header, name) {
            image.set(name, from_text(t));
        }
    }
    for (name, value) in header.other.iter().chain(&file_image.attributes.other) {
        match value {
            AttributeValue::Text(t) => image.set(from_text(name), from_text(t)),
            AttributeValue::F64(x) => image.set(from_text(name), *x),
            AttributeValue::F32(x) => image.set(from_text(name), *x as f64),
            AttributeValue::I32(x) => image.set(from_text(name), *x as i64),
            _ => {}
        }
    }
    image.attributes.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(image)
}

fn pair<T>(v: Vec2<T>) -> [T; 2] {
    [v.0, v.1]
}

fn read_parts(input: impl std::io::Read + std::io::Seek + Send) -> ExrResult<Image<Layers<AnyChannels<FlatSamples>>>> {
    ::exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(input)
}

/// The picture of any EXR: `R G B`, else the only `<layer>.R/G/B`, else luminance (`Y`) or the only channel, as grey.
pub fn read_rgb(path: &Path) -> Result<RgbImage> {
    let image = read(path)?;
    let layers: Vec<&str> = image.channels.iter().filter_map(|(n, _)| n.strip_suffix(".R")).collect();
    let grey = |data: &[f32]| data.iter().map(|&y| [y; 3]).collect::<Vec<_>>();
    let pixels = match (image.rgb(""), image.channel("Y")) {
        (Some(rgb), _) => Some(rgb),
        (None, Some(y)) if image.channel("RY").is_none() => Some(grey(y)),
        _ if layers.len() == 1 => image.rgb(layers[0]),
        _ if image.channels.len() == 1 => Some(grey(&image.channels[0].1)),
        _ => None,
    };
    let pixels = pixels.ok_or_else(|| {
        let names: Vec<&str> = image.channels.iter().map(|(n, _)| n.as_str()).collect();
        Error::Runtime(format!(
            "cannot read {}: neither R, G, B nor luminance among its channels: {}",
            path.display(),
            names.join(", ")
        ))
    })?;
    Ok(RgbImage { width: image.width, height: image.height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> ExrImage {
        let mut image = ExrImage::new(19, 33);
        let rgb: Vec<[f32; 3]> = (0..19 * 33).map(|i| [i as f32, -0.1 * i as f32, f32::MIN_POSITIVE]).collect();
        for layer in ["", "d_light_x", "d_light_x.interior", "var", "var_light_x"] {
            image.push_rgb(layer, &rgb);
        }
        image.set("software", "tyndall 0.1.0");
        image.set("sceneHash", "äöü ✓ 0123456789abcdef");
        image.set("renderTimeSeconds", 1.25);
        image.set("param.light_x", 0.1);
        image.set("spp", 64i64);
        image.set("seed", i64::MAX);
        image.set("complete", 0i64);
        image
    }

    #[test]
    fn everything_survives_a_round_trip() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let mut image = sample();
        image.origin = [5, 6];
        image.full_size = [64, 48];
        write(&path, &image).unwrap();
        let back = read(&path).unwrap();
        image.channels.sort_by(|a, b| a.0.cmp(&b.0));
        image.attributes.sort_by(|a, b| a.0.cmp(&b.0));
        assert_eq!(back.attribute("seed").unwrap().as_integer(), Some(i64::MAX));
        assert_eq!(back.attribute("spp"), Some(&Attribute::Integer(64)));
        assert_eq!(back.attribute("param.light_x").unwrap().as_real(), Some(0.1));
        image.attributes.iter_mut().filter(|(n, _)| n == "seed").for_each(|(_, v)| *v = i64::MAX.to_string().into());
        assert_eq!(back, image);
        assert_eq!(back.rgb("d_light_x.interior"), back.rgb(""));
        assert_eq!(read_rgb(&path).unwrap().pixels, back.rgb("").unwrap());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn file_is_one_float_zip_part() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        write(&path, &sample()).unwrap();
        let meta = MetaData::read_from_file(&path, true).unwrap();
        assert_eq!(meta.headers.len(), 1);
        assert_eq!(meta.headers[0].compression, Compression::ZIP16);
        assert!(meta.headers[0].channels.list.iter().all(|c| c.sample_type == SampleType::F32));
    }

    #[test]
    fn bad_images_and_files_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let mut image = sample();
        image.channels[3].1.pop();
        assert!(write(&path, &image).unwrap_err().to_string().contains("d_light_x.R"));
        let mut image = sample();
        image.channels[3].0 = "R".into();
        assert!(write(&path, &image).unwrap_err().to_string().contains("twice"));
        assert!(write(&path, &ExrImage::new(0, 4)).is_err());
        assert!(!path.exists());
        assert!(write(&dir.path().join("no/a.exr"), &sample()).is_err());

        // Cut files and other files.
        write(&path, &sample()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for cut in [0, 3, 100, bytes.len() / 2, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let e = read(&path).unwrap_err().to_string();
            assert!(e.contains("a.exr"), "{e}");
        }
        assert!(read(&dir.path().join("none.exr")).unwrap_err().to_string().contains("none.exr"));
    }

    #[test]
    fn half_and_luminance_are_read_as_rgb() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let rgb = SpecificChannels::rgb(|p: Vec2<usize>| {
            (f16::from_f32(p.x() as f32), f16::from_f32(0.5), f16::from_f32(p.y() as f32))
        });
        Image::from_channels((4, 3), rgb).write().to_file(&path).unwrap();
        let image = read_rgb(&path).unwrap();
        assert_eq!((image.width, image.height, image.pixels[4 + 2]), (4, 3, [2.0, 0.5, 1.0]));

        let mut grey = ExrImage::new(2, 1);
        grey.channels.push(("Y".into(), vec![0.25, 4.0]));
        write(&path, &grey).unwrap();
        assert_eq!(read_rgb(&path).unwrap().pixels, [[0.25; 3], [4.0; 3]]);

        grey.channels = vec![("A".into(), vec![0.0; 2]), ("Z".into(), vec![0.0; 2])];
        write(&path, &grey).unwrap();
        assert!(read_rgb(&path).unwrap_err().to_string().contains("A, Z"));
    }
}
