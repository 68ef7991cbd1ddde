//! `grad --wrt ID.vertices`: its JSON, and what is refused.

use crate::fog::Folder;
use serde_json::Value;
use std::fs;

/// A block of four triangles over a floor; `$` stands for a further shape.
const SCENE: &str = r#"<scene version="3.0.0">
  <default name="light_x" value="0.7"/>
  <integrator type="path"><integer name="max_depth" value="2"/></integrator>
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0.2, 1.2, 4" target="0, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="5"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform><bsdf type="diffuse"/></shape>
  <shape type="sphere" id="ball"><point name="center" value="-0.9, 0.4, 0.3"/><float name="radius" value="0.3"/></shape>
  <shape type="obj" id="mesh"><string name="filename" value="m.obj"/></shape>
  <emitter type="point" id="lamp"><point name="position" value="$light_x, 2.3, 0.6"/></emitter>
  <!-- more -->
</scene>"#;

/// The last position is named first.
const MESH: &str = "v -0.3 0.5 0\nv 0.4 0.5 -0.1\nv 0 0.6 0.5\nv 0 1.1 0\nf 4 1 3\nf 4 3 2\nf 4 2 1\nf 1 2 3\n";

fn folder() -> Folder {
    let f = Folder::new();
    fs::write(f.path("m.obj"), MESH).unwrap();
    let normals = "vn 0 0 1\n".to_string() + &MESH.replace("f 4 1 3", "f 4//1 1//1 3//1");
    fs::write(f.path("smooth.obj"), normals).unwrap();
    fs::write(f.path("s.xml"), SCENE).unwrap();
    let more = |name: &str, text: &str| fs::write(f.path(name), SCENE.replace("<!-- more -->", text)).unwrap();
    more(
        "null.xml",
        r#"<shape type="obj" id="veil"><string name="filename" value="m.obj"/><bsdf type="null"/></shape>"#,
    );
    more("smooth.xml", r#"<shape type="obj" id="smooth"><string name="filename" value="smooth.obj"/></shape>"#);
    more(
        "fog.xml",
        r#"<medium type="homogeneous" id="fog"/><shape type="cube"><transform name="to_world"><scale value="3"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>"#,
    );
    f.run(0, "render s.xml --spp 4 --seed 5 -o ref.exr");
    f
}

#[test]
fn a_gradient_is_three_numbers_a_vertex() {
    let f = folder();
    let (out, _) = f.run(0, "grad s.xml --wrt mesh.vertices,light_x --loss l2 --target ref.exr --spp 128 --json");
    let v: Value = serde_json::from_str(&out).unwrap();
    let (g, e) = (&v["gradient"]["mesh.vertices"], &v["standard_error"]["mesh.vertices"]);
    for x in [g, e] {
        assert_eq!(x["shape"], serde_json::json!([4, 3]));
        let values = x["values"].as_array().unwrap();
        assert_eq!(values.len(), 12);
        assert!(values.iter().all(|x| x.as_f64().unwrap().is_finite() && x.as_f64().unwrap() != 0.0), "{x}");
    }
    // The mesh's first vertex is the file's last.
    assert_eq!(g["file_order"], serde_json::json!([3, 0, 2, 1]));
    assert!(
        v["gradient"]["light_x"].as_f64().unwrap() != 0.0 && v["standard_error"]["light_x"].as_f64().unwrap() > 0.0
    );
    // Bits, threads, files; the table shows the vector's length.
    f.run(0, "render s.xml --spp 1 -o a.exr");
    for t in 1..3 {
        f.run(0, &format!("grad s.xml --wrt mesh.vertices --adjoint a.exr --spp 32 -t {t} -o g{t}.json"));
    }
    let read = |name: &str| -> Value { serde_json::from_str(&fs::read_to_string(f.path(name)).unwrap()).unwrap() };
    let (a, b) = (read("g1.json"), read("g2.json"));
    assert_eq!((&a["gradient"], &a["standard_error"]), (&b["gradient"], &b["standard_error"]));
    let (out, _) = f.run(0, "grad s.xml --wrt mesh.vertices --adjoint a.exr --spp 32 -o g.json");
    assert!(out.contains("|mesh.vertices|"), "{out}");
    let (out, _) = f.run(0, "plan s.xml --wrt mesh.vertices");
    assert!(out.contains("an occluder of a zero-measure light moves (mesh.vertices)"), "{out}");
    // In fog.
    let (out, _) = f.run(0, "plan fog.xml --wrt mesh.vertices");
    assert!(out.lines().any(|l| l.contains("medium_edge") && l.contains("use")), "{out}");
    f.run(0, "grad fog.xml --wrt mesh.vertices --adjoint a.exr --spp 8 -o fog.json");
    assert_eq!(read("fog.json")["gradient"]["mesh.vertices"]["shape"], serde_json::json!([4, 3]));
}

#[test]
fn what_has_no_such_gradient_is_refused_by_name() {
    let f = folder();
    let reverse = "--loss l2 --target ref.exr";
    for (line, parts) in [
        ("grad s.xml --wrt mesh.vertices".to_string(), ["no derivative images", "--adjoint A.exr"]),
        (format!("grad s.xml --wrt mehs.vertices {reverse}"), ["no shape `mehs`", "did you mean `mesh`"]),
        (format!("grad s.xml --wrt ball.vertices {reverse}"), ["`ball` is no mesh", "`mesh`"]),
        (format!("grad s.xml --wrt lamp.vertices {reverse}"), ["`lamp` is an emitter", "`mesh`"]),
        (format!("grad s.xml --wrt mesh.normals {reverse}"), ["`normals` of `mesh`", "ID.vertices"]),
        (format!("grad s.xml --wrt mesh.vertices,mesh.vertices {reverse}"), ["twice", "once"]),
        (format!("grad null.xml --wrt veil.vertices {reverse}"), ["`veil` has a null bsdf", "to_world"]),
        (format!("grad smooth.xml --wrt smooth.vertices {reverse}"), ["vertex normals", "face_normals"]),
        (format!("grad fog.xml --wrt fog.vertices {reverse}"), ["`fog` is a medium", "`mesh`"]),
        ("check s.xml --wrt mesh.vertices".into(), ["`check` takes `$parameters` only", "tyndall grad"]),
        ("converge s.xml --wrt mesh.vertices".into(), ["`converge` takes `$parameters` only", "tyndall grad"]),
        ("fit s.xml --wrt mesh.vertices --target ref.exr".into(), ["`fit` takes `$parameters` only", "tyndall grad"]),
    ] {
        let (out, err) = f.run(2, &line);
        assert!(out.is_empty() && err.starts_with("error: "), "`{line}`: {err}");
        assert!(parts.iter().all(|p| err.contains(p)), "`{line}`: {err}");
    }
}
