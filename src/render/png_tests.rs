use super::*;

/// Where test pictures go: `TYNDALL_TEST_PICTURES`, to look at them, else a folder that is removed.
fn folder() -> (std::path::PathBuf, Option<tempfile::TempDir>) {
    match std::env::var_os("TYNDALL_TEST_PICTURES") {
        Some(dir) => (dir.into(), None),
        None => {
            let dir = tempfile::tempdir().unwrap();
            (dir.path().into(), Some(dir))
        }
    }
}

fn decode(path: &Path) -> (usize, usize, Vec<[u8; 3]>) {
    let mut reader = ::png::Decoder::new(std::fs::File::open(path).unwrap()).read_info().unwrap();
    let mut buffer = vec![0; reader.output_buffer_size()];
    let info = reader.next_frame(&mut buffer).unwrap();
    let pixels = buffer[..info.buffer_size()].chunks(3).map(|c| [c[0], c[1], c[2]]).collect();
    (info.width as usize, info.height as usize, pixels)
}

fn image(width: usize, height: usize, f: impl Fn(f32, f32) -> [f32; 3]) -> RgbImage {
    let at = |i: usize| f((i % width) as f32 / width as f32 - 0.5, (i / width) as f32 / height as f32 - 0.5);
    RgbImage { width, height, pixels: (0..width * height).map(at).collect() }
}

#[test]
fn quantiles_are_the_nearest_rank() {
    let v = || (1..=1000).map(f64::from);
    assert_eq!(quantile(v(), 0.99), Some(990.0));
    assert_eq!(quantile(v(), 1.0), Some(1000.0));
    assert_eq!(quantile(v(), 0.0), Some(1.0));
    assert_eq!(quantile([f64::NAN].into_iter(), 0.5), None);
    // Few pixels carry the derivative: the largest decides.
    let mut sparse = vec![0.0f32; 1000];
    assert_eq!(symmetric_range([&sparse[..]]), 1.0);
    sparse[3] = -2.0;
    assert_eq!(symmetric_range([&sparse[..]]), 2.0);
}

#[test]
fn tone_map_follows_its_rule() {
    let pixels: Vec<[f32; 3]> = (1..=100).map(|i| [i as f32; 3]).collect();
    assert!((exposure_scale(&pixels, Exposure::Auto) - 1.0 / 99.0).abs() < 1e-6);
    assert!((exposure_scale(&pixels, Exposure::Quantile(0.9)) - 1.0 / 90.0).abs() < 1e-6);
    let mapped = tone_map(&pixels, Exposure::Auto);
    assert_eq!((mapped[98], mapped[99]), ([255; 3], [255; 3]));
    assert!(mapped[97][0] < 255);
    assert_eq!(tone_map(&[[0.18, 0.0, 2.0]], Exposure::Scale(1.0)), [[118, 0, 255]]);
    assert_eq!(tone_map(&[[f32::NAN, 0.0, 0.0]], Exposure::Auto), [NOT_A_NUMBER]);
}

#[test]
fn colour_map_is_white_at_zero_and_symmetric_in_lightness() {
    assert_eq!(diverging(0.0), WHITE);
    assert_eq!(diverging(f64::NAN), NOT_A_NUMBER);
    assert_eq!(diverging(7.0), diverging(1.0));
    let linear = |v: u8| (f64::from(v) / 255.0).powf(2.2);
    let light = |t: f64| Rgb(diverging(t).map(linear)).luminance();
    for i in 1..=10 {
        let t = f64::from(i) / 10.0;
        let (blue, red) = (diverging(-t), diverging(t));
        assert!(blue[2] > blue[0] && red[0] > red[2]);
        assert!(light(t) < light(t - 0.1) && light(-t) < light(0.1 - t), "not monotone at {t}");
        // Oklab's lightness weighs red more than luminance does; they agree to a few per cent.
        assert!((light(t).sqrt() - light(-t).sqrt()).abs() < 0.08, "{t}: {} {}", light(t), light(-t));
    }
}

#[test]
fn small_pictures_are_enlarged_exactly() {
    let (dir, _keep) = folder();
    let path = dir.join("picture.png");
    let picture = image(64, 64, |x, y| [x + 0.5, y + 0.5, 0.2]);
    write_picture(&path, &picture, Exposure::Scale(1.0)).unwrap();
    let (w, h, pixels) = decode(&path);
    assert_eq!((w, h), (256, 256));
    let mapped = tone_map(&picture.pixels, Exposure::Scale(1.0));
    assert!((0..h).all(|y| (0..w).all(|x| pixels[y * w + x] == mapped[y / 4 * 64 + x / 4])));
}

#[test]
fn sheet_shares_one_range() {
    let (dir, _keep) = folder();
    let path = dir.join("sheet.png");
    let blob = |x: f32, y: f32, s: f32| (-(x * x + y * y) / (s * s)).exp();
    let picture = image(64, 64, |x, y| [blob(x, y, 0.3), 0.8 * blob(x, y, 0.25), 0.4 * blob(x, y, 0.2)]);
    let d = |k: f32| image(64, 64, |x, y| [k * x * blob(x, y, 0.3); 3]);
    let sheet = Sheet {
        panels: vec![
            Panel::picture("picture", &picture, Exposure::Auto),
            Panel::derivative("d/d light_x", &d(8.0)),
            Panel::derivative("finite differences", &d(7.6)),
            Panel::derivative("interior (4 %)", &d(-2.0)),
            Panel::derivative("d_light_x.surface_edge", &d(0.25)),
        ],
        columns: 3,
        unit: "radiance / m".into(),
        range: None,
    };
    let range = sheet.shown_range().unwrap();
    // The largest value is 8 * 0.3 / sqrt(2 e) = 1.029.
    assert!(range > 0.9 && range < 1.029, "{range}");
    sheet.write(&path).unwrap();
    let (w, h, pixels) = decode(&path);
    assert_eq!((w, h), sheet_size(&sheet));
    // The pixel at the middle of the second panel is neutral.
    let canvas = sheet.draw();
    assert_eq!(pixels, canvas.pixels);
    let cell = (font::text_width("d_light_x.surface_edge") * TEXT).max(CELL);
    assert_eq!(pixels[(GAP + LINE + GAP / 2 + 130) * w + GAP + cell + GAP + 130], WHITE);

    assert_eq!(Sheet { panels: sheet.panels[..1].to_vec(), ..Sheet::default() }.shown_range(), None);
    Sheet::default().draw();
}

#[test]
fn joined_sheets_keep_their_ranges() {
    let sheet = |x: f32| {
        let content = Content::Derivative(vec![x; 4]);
        Sheet { panels: vec![Panel { title: "d".into(), width: 2, height: 2, content }], ..Sheet::default() }
    };
    let (a, b) = (sheet(1.0), sheet(1e-3));
    let (one, other) = (a.draw(), b.draw());
    let all = join(&[a.clone(), b.clone(), a], 2);
    assert_eq!((all.width, all.height), (one.width + other.width, 2 * one.height));
    // The small one is as red as the large one.
    let at = |x: usize, y: usize| all.pixels[(y + GAP + LINE + GAP) * all.width + x + 2 * GAP];
    assert_eq!((at(0, 0), at(one.width, 0), at(0, one.height)), ([diverging(1.0); 3]).into());
}

fn sheet_size(sheet: &Sheet) -> (usize, usize) {
    let canvas = sheet.draw();
    (canvas.width, canvas.height)
}
