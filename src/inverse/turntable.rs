//! An animated picture of what a fit found while one parameter of the scene runs through a range: a camera that goes around, a light that rises.

use super::album::image;
use crate::error::Result;
use crate::render::animation;
use crate::render::family::{Family, Member, View, stream};
use crate::render::png::{Exposure, Panel, Sheet, exposure_scale};
use std::path::Path;

/// A parameter's way.
#[derive(Clone, Debug)]
pub struct Way<'a> {
    pub parameter: &'a str,
    pub from: f64,
    /// Not reached: the film repeats.
    pub to: f64,
    pub frames: usize,
    pub spp: u64,
}

/// Frames of what was found (`dress` puts it into a member of the family) and, with `beside`, of the scene as its file has it.
pub fn write(
    path: &Path,
    family: &Family,
    values: &[(&str, f64)],
    view: View,
    way: &Way,
    dress: &dyn Fn(&mut Member) -> Result<()>,
    beside: Option<&[(&str, f64)]>,
) -> Result<()> {
    let (mut sheets, mut scale) = (Vec::new(), None);
    for i in 0..way.frames {
        let x = way.from + (way.to - way.from) * i as f64 / way.frames as f64;
        let mut sheet = Sheet { columns: 2, ..Sheet::default() };
        let shown = [("found", Some(values)), ("target", beside)];
        for (title, values) in shown.into_iter().filter_map(|(t, v)| Some((t, v?))) {
            let mut values: Vec<(&str, f64)> = values.iter().filter(|v| v.0 != way.parameter).copied().collect();
            values.push((way.parameter, x));
            let mut member = family.at(&values)?;
            if title == "found" {
                dress(&mut member)?;
            }
            let picture = image(&view.picture(&member.scene, way.spp, stream(0, 12, i as u64))?);
            let scale = *scale.get_or_insert_with(|| exposure_scale(&picture.pixels, Exposure::Auto));
            sheet.panels.push(Panel::picture(title, &picture, Exposure::Scale(scale)));
        }
        sheets.push(sheet);
    }
    animation::write(path, &sheets, 8)
}
