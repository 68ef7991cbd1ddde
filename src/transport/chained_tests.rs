use super::super::first::Later;
use super::super::motion::later;
use super::super::{Beginning, Sweep, SweepFacts, Tally};
use super::*;
use crate::math::rng::Rng;
use crate::params::Forward;
use crate::scene::compile::LoadOptions;
use crate::scene::desc::SceneDesc;
use std::path::Path;
use std::sync::Arc;

/// A block and a lamp that the camera sees, both of which move in a box of fog.
const ROOM: &str = r#"<scene version="3.0.0"><default name="x" value="0.1"/><integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.6"/><float name="albedo" value="0.9"/></medium>
  <sensor type="perspective"><float name="fov" value="50"/><transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.3"/><rotate x="1" y="0.4" angle="30"/><translate x="$x" y="-0.3"/></transform><bsdf type="diffuse"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.5"/><translate x="$x" y="0.5" z="-0.7"/></transform>
    <emitter type="area"><rgb name="radiance" value="3"/></emitter><bsdf type="diffuse"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.2"/><translate x="$x" y="-0.1" z="0.4"/></transform>
    <emitter type="area"><rgb name="radiance" value="3"/></emitter><bsdf type="null"/></shape></scene>"#;

/// What `test` is told of every path: its record, and the legs in it.
fn with_paths(mut test: impl FnMut(&Scene, &Moving, &PathRecord, &Starts)) {
    let desc = SceneDesc::parse(ROOM, Path::new("room.xml"), &[]).unwrap();
    let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
    let params = scene.param_set(&desc, &["x".to_string()]).unwrap();
    let sensor = &scene.sensors[0];
    let facts = Arc::new(SweepFacts::of(&scene, sensor, &params).unwrap());
    let sweep = Sweep { scene: &scene, set: &scene.settings, params: &params, facts: facts.clone(), sensor };
    let (mut rec, mut starts) = (PathRecord::new(), Starts::default());
    for k in 0..4000 {
        let mut rng = Rng::keyed(5, 1, 0, k);
        let (o, w) = sensor.ray(8.0 * rng.uniform(), 8.0 * rng.uniform());
        let begin = Beginning::new(rng, o, w, sensor.medium);
        sweep.sample(&begin, Rng::keyed(5, 2, 0, k), &mut rec, &mut Forward::new(&params), &mut Tally::default());
        starts.find_all(&scene, &facts.moving, &rec, &Opening::NEW);
        test(&scene, &facts.moving, &rec, &starts);
    }
}

fn told(x: &impl std::fmt::Debug) -> String {
    format!("{x:?}")
}

/// Chains that begin alike share their first vertex: it is the one that each would have by itself.
#[test]
fn shared_first_vertices_are_those_of_each_chain() {
    let mut shared = 0;
    with_paths(|scene, moving, rec, starts| {
        let mut before: Vec<Seen> = Vec::new();
        for start in starts.legs().iter().filter(|s| s.place != At::Nowhere) {
            let mut opening = Opening::default();
            let own = rec.events[start.begin..].iter().skip(1).take_while(|e| !matches!(e, Event::Chain));
            own.for_each(|e| opening.follow(e));
            assert_eq!(told(start.first()), told(&start.line(scene, moving).opening(&opening)));
            let seen = opening.first.unwrap();
            shared += u32::from(before.contains(&seen));
            before.push(seen);
        }
    });
    assert!(shared > 20, "{shared}");
}

/// The first vertex of a connection's own carries nothing that its lamp's point would not have with all that a path could ask for.
#[test]
fn bare_first_vertices_lack_nothing_that_is_asked() {
    let (mut bare, mut carried) = (0, 0);
    with_paths(|scene, moving, rec, starts| {
        for (k, e) in rec.events.iter().enumerate() {
            let Event::Connect { via: Some(via), end, .. } = e else { continue };
            let via = &rec.drawn[*via as usize];
            let (End::Shape { p, .. }, Some((start, Nth::First))) = (end, starts.next_at(k)) else { continue };
            let [own, path] = [later(scene, *end), Later::Path]
                .map(|later| start.line(scene, moving).medium(via.p, &via.span, later));
            let [own_point, point] = [&own, &path].map(|first| Moving::on_surface(first, *p, false));
            assert_eq!(told(&own_point), told(&point));
            bare += u32::from(path.carries() && !own.carries());
            carried += u32::from(!point.0.is_zero());
        }
    });
    assert!(bare > 20 && carried > 5, "{bare} {carried}");
}
