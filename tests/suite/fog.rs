//! A small scene for commands that render many times, and a folder to run them in.

use std::path::PathBuf;
use std::process::Command;
use tempfile::TempDir;

/// A ball in a fog cube under a lamp, coarse: 16 x 16 pixels. `tint` is that of a ball that no light reaches.
pub const SCENE: &str = r#"<scene version="3.0.0">
  <default name="sigma_t" value="0.6"/><default name="albedo" value="0.8"/><default name="full" value="1"/>
  <default name="tint" value="0.5"/><?diff param="sigma_t" min="0" max="3"?>
  <integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="$sigma_t"/><float name="albedo" value="$albedo"/></medium>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="sphere"><float name="radius" value="0.5"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.5, $full"/></bsdf></shape>
  <shape type="sphere"><float name="radius" value="0.3"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="$tint"/></bsdf></shape>
  <sensor type="perspective"><float name="fov" value="30"/>
    <transform name="to_world"><lookat origin="0, 0, -4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/><rfilter type="box"/></film></sensor>
  <emitter type="point"><point name="position" value="1.5, 2, -1.2"/><rgb name="intensity" value="10, 8, 6"/></emitter>
</scene>"#;

pub struct Folder(TempDir);

impl Folder {
    /// With the scene as `fog.xml`.
    pub fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("fog.xml"), SCENE).unwrap();
        Folder(dir)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Run and expect an exit code: standard output and error.
    #[track_caller]
    pub fn run(&self, code: i32, line: &str) -> (String, String) {
        let program = env!("CARGO_BIN_EXE_tyndall");
        let o = Command::new(program).args(line.split_whitespace()).current_dir(self.0.path()).output().unwrap();
        let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
        let (out, err) = (text(&o.stdout), text(&o.stderr));
        assert_eq!(o.status.code(), Some(code), "`{line}`\n{out}\n{err}");
        (out, err)
    }
}
