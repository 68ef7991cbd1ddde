//! `make figures`: what puts pictures together, and that its script names what there is.

use std::path::Path;
use tyndall::image::RgbImage;
use tyndall::render::montage::{self, Row};
use tyndall::render::png::{self, Exposure};

fn decode(path: &Path) -> (usize, usize, Vec<[u8; 3]>) {
    let mut reader = ::png::Decoder::new(std::fs::File::open(path).unwrap()).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size()];
    let frame = reader.next_frame(&mut bytes).unwrap();
    let pixels = bytes.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    (frame.width as usize, frame.height as usize, pixels)
}

#[test]
fn pictures_stand_in_rows_below_their_titles() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str| dir.path().join(name);
    let picture = |name: &str, width: usize, height: usize, value: f32| {
        let image = RgbImage { width, height, pixels: vec![[value; 3]; width * height] };
        png::write_picture(&file(name), &image, Exposure::Scale(1.0)).unwrap();
    };
    picture("black.png", 256, 128, 0.0);
    picture("white.png", 300, 40, 1.0);
    let row = |title: &str, names: &[&str]| Row { title: title.into(), files: names.iter().map(|n| file(n)).collect() };
    let out = file("out.png");

    montage::write(&out, &[row("", &["white.png", "black.png"]), row("", &["black.png"])]).unwrap();
    let (width, height, pixels) = decode(&out);
    assert_eq!((width, height), (556, 256));
    let at = |x: usize, y: usize| pixels[y * width + x][0];
    assert_eq!([at(299, 39), at(300, 39), at(299, 127), at(255, 255), at(256, 255)], [255, 0, 255, 0, 255]);

    // A title takes room above its row, and as much width as it needs.
    let title = "a title that is wider than the picture";
    montage::write(&out, &[row(title, &["black.png"])]).unwrap();
    let (width, height, pixels) = decode(&out);
    assert!(width > 256 && height > 128, "{width} {height}");
    let text = &pixels[..(height - 128) * width];
    assert!(text.contains(&[0; 3]) && pixels[(height - 1) * width] == [0; 3]);
    assert!((0..height - 128).all(|y| text[y * width + width - 1] == [255; 3]), "clipped");

    // Errors name the file.
    std::fs::write(file("text.png"), "no picture").unwrap();
    for name in ["text.png", "none.png"] {
        let e = montage::write(&out, &[row("", &["black.png", name])]).unwrap_err().to_string();
        assert!(e.contains(name), "{e}");
    }
}

#[test]
fn the_script_names_scenes_and_parameters_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let script = std::fs::read_to_string(root.join("scripts/figures.sh")).unwrap();
    let of = |command: &str| -> Vec<Vec<String>> {
        let words = |l: &str| l.split_whitespace().skip(1).map(String::from).collect();
        script.lines().filter(|l| l.split(' ').next() == Some(command)).map(words).collect()
    };
    let (checks, fits) = (of("check"), of("fit"));
    assert_eq!((checks.len(), fits.len()), (3, 3));
    for c in &checks {
        let desc = tyndall::scene::SceneDesc::load(&root.join(format!("scenes/{}/scene.xml", c[0])), &[]).unwrap();
        desc.wrt(&c[1]).unwrap();
    }
    for f in &fits {
        assert!(root.join(format!("scenes/{}/fit.toml", f[0])).is_file(), "{f:?}");
    }
}
