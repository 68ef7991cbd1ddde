//! The planes of a chain of flat faces that a ray has met ([`crate::math::fermat`]).

use crate::math::fermat::{Onward, PLANES, Planes};
use crate::math::fold::Fold;
use crate::scene::Scene;
use crate::shape::Geometry;
use crate::surface::Surface;
use crate::transport::ray::Specular;

/// `None` if a face is not flat, or there are too many.
pub fn planes(scene: &Scene, chain: &[Specular]) -> Option<Planes> {
    let last = chain.last().filter(|_| chain.len() <= PLANES)?;
    let fold = |s: &Specular| {
        let shape = &scene.shapes[s.hit.shape as usize];
        if shape.shape.is_round() {
            return None;
        }
        let n = shape.shape.normal(s.hit.face, s.hit.p);
        let index = match &scene.surfaces[shape.surface as usize] {
            Surface::Dielectric { interior, exterior, .. } if s.w.dot(n) < 0.0 => [*exterior, *interior],
            Surface::Dielectric { interior, exterior, .. } => [*interior, *exterior],
            _ => [1.0; 2],
        };
        Some(Fold { p: s.hit.p, n, through: s.through, index })
    };
    let folds = chain.iter().map(fold).collect::<Option<Vec<Fold>>>()?;
    let onward = match scene.surface_of(last.hit.shape) {
        Surface::Dielectric { .. } => {
            let n = folds.last()?.n;
            Onward::Side(n * n.dot(last.out).signum())
        }
        _ => Onward::Both,
    };
    Some(Planes::new(folds, onward))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::DVec3;
    use crate::math::fermat::{Eye, Start, Way};
    use crate::math::rng::Rng;
    use crate::scene::SceneDesc;
    use crate::scene::compile::LoadOptions;
    use crate::transport::chance::{self, TO_EDGES};
    use crate::transport::shot::Place;

    /// Light goes on from a pane to the side that it left by; a mirror behind it may be met, by the same steps, from either side.
    #[test]
    fn where_light_goes_on_to() {
        let text = r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>
      <shape type="rectangle"><transform name="to_world"><translate z="2"/></transform>
        <bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf></shape>
      <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="4"/></transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>
      <emitter type="constant"/></scene>"#;
        let desc = SceneDesc::parse(text, std::path::Path::new("ways.xml"), &[]).unwrap();
        let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
        // Through the pane, then against one side of the mirror or the other.
        for side in [1.0, -1.0] {
            let (o, place) = (DVec3::new(0.0, 0.4 * side, 3.0), Place::within(None));
            let start = Start { o, w: (DVec3::new(0.0, 0.0, 0.2) - o).normalize() };
            let mut rng = Rng::keyed(8, 0, 0, 0);
            let mut chain = || chance::random_chain(&scene, &Eye::Point(o), start, &place, TO_EDGES, &mut rng);
            let mut chains = std::iter::repeat_with(|| chain().map(|c| c.faces)).take(1000).flatten();
            let chain: Vec<Specular> = chains.find(|c| c.len() == 2 && c[0].through).unwrap();
            let mirror = planes(&scene, &chain).unwrap();
            let pane = planes(&scene, &chain[..1]).unwrap();
            let at = |y: f64, z: f64| DVec3::new(0.1, y, z);
            let is_lit = |p: &Planes, e: DVec3| matches!(p.ray(&Eye::Point(o), o, e), Way::Found(_));
            assert!(!is_lit(&mirror, at(0.0, 0.5)) && is_lit(&pane, at(0.3, 1.0)));
            assert!(!is_lit(&pane, at(0.3, 2.5)) && !is_lit(&pane, at(0.3, 2.0)));
            let e = at(0.5 * side, -1.0);
            assert!(matches!(mirror.ray(&Eye::Point(o), o, e), Way::Found(_)));
            // From the other side of the same mirror, by way of the same steps.
            let other = DVec3::new(o.x, -o.y, o.z);
            assert!(matches!(mirror.ray(&Eye::Point(other), other, at(-0.5 * side, -1.0)), Way::Found(_)));
        }
    }
}
