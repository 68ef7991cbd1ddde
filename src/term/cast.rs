//! Where lights without extent, and beams that something cuts, begin and cease to shine by a way of flat smooth faces, or of a ball of metal: at the border of a face that light meets, or of one that comes between, or at the rim or outline of something opaque and round, or of the ball (terms G of [T] section 3, by way of interfaces).
//!
//! By given planes ([`crate::math::fermat`]), or the ball, light comes to every point y in one way at most, and all that it brings is smooth in the places of all ([`crate::transport::way_motion`]), but at y whose way
//! goes by such a border (`cast_border`). These y form a *sheet*: rays from the points z of the border, which light comes to by the planes before it and leaves by those behind. A face that stands between counts as a plane
//! that does nothing. A path's span crosses a sheet where it meets one of its rays. Points of the span move with ẋ; there light grows by
//!
//! ```text
//! (L⁺ - L⁻) <m, ẋ_k - ė> / |∂f/∂t|,    f = <x_k - e, m>
//! ```
//!
//! per length of the span ([T] (35) for a sheet that is told by f; ẋ_k is (46)), x_k being where the way meets the plane of the border, e the border and m the direction across it in that plane; L on either side is asked of the connection itself, so that it does not matter what stands where.
//! Every span of a camera path is looked at ([`super::spans`]): light of any order counts.
//!
//! Where two faces in turn share an edge, light passes both at one point of it: such a border is the first one's alone.

use super::cast_border;
use super::cast_route::lone_mirror;
use super::cast_sheet::{Met, Sheet, around, count, of_light};
use super::cast_trace::Traces;
use super::interfaces::{self, FACETS};
use super::sheet::Partials;
use super::spans::{self, Bare, Moves, Walked};
use super::{Context, LightMotion, Motion, Sample};
use crate::error::{Error, Result};
use crate::light::Light;
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::params::{Partial, Slot};
use crate::phase::one_minus_cos;
use crate::scene::bodies::is_convex;
use crate::scene::chains::has_flat_faces;
use crate::scene::{Instance, On, Scene, effort};
use crate::sensor::Sensor;
use crate::shape::{Geometry, Shape};
use crate::transport::Tally;
use crate::transport::motion::Moving;
use crate::transport::velocity::Velocity;
use crate::transport::way_motion::Slide;

/// Faces of an opaque mesh at most.
const OPAQUE: u32 = 4096;
/// Sheets of a scene at most.
const SHEETS: usize = 1 << 18;

pub struct Casts {
    ended: Ended,
    traces: Option<Traces>,
}

/// Where light ends.
pub struct Ended {
    /// Those that are asked for more often first.
    sheets: Vec<Sheet>,
    /// Of each light the slot of its position or direction, where that moves.
    slots: Vec<Option<Slot>>,
    /// Of each sheet whether it moves by itself, and not only as others see it.
    moves: Vec<bool>,
}

impl Ended {
    fn new(scene: &Scene, moving: &Moving, sheets: Vec<Sheet>, slots: Vec<Option<Slot>>) -> Ended {
        let turns = |k: u32| moving.moves(k) || moving.refracts(scene.shapes[k as usize].surface as usize);
        let own = |s: &Sheet| {
            let by_border = s.border.matter().is_none_or(|(shape, _)| moving.moves(shape));
            slots[s.light as usize].is_some() || by_border || s.route.shapes(scene).any(turns)
        };
        let moves = sheets.iter().map(own).collect();
        Ended { sheets, slots, moves }
    }

    pub fn moves(&self, sheet: usize) -> bool {
        self.moves[sheet]
    }

    pub fn sheets(&self) -> &[Sheet] {
        &self.sheets
    }

    /// `<m, ẋ_k - ė>` as the point that the way leads to moves with `start`, if anything but lights does; `by_light`: what the light's own motion adds. `None` where that does not settle.
    pub fn partials(
        &self,
        cx: &Context,
        (sheet, met): (&Sheet, &Met),
        (slide, by_light): (&Slide, DVec3),
        start: Option<&Velocity>,
    ) -> Option<Partials> {
        let (scene, m, z) = (cx.scene, met.m, met.place.z);
        let mut partials = Partials::default();
        if let Some(start) = start {
            let velocity = slide.velocity(cx.moving, start)?;
            velocity.forms(scene, cx.sensor, m, |q| partials.push(q));
            match sheet.border.matter() {
                Some((shape, face)) => scene.matter(shape, face).forms(z, -m, |q| partials.push(q)),
                None => scene.lights[sheet.light as usize].edge_forms(z, -m, |q| partials.push(q)),
            }
        }
        let light = self.slots[sheet.light as usize].map(|slot| Partial { slot, v: by_light, len: 3 });
        partials.extend(light);
        Some(partials)
    }
}

/// Whether all of lights without extent are known where something moves: whatever casts shadows has straight borders or is opaque, and no border of a medium alone moves.
pub fn are_known(scene: &Scene, motion: &Motion) -> bool {
    scene.lights.iter().any(Light::is_delta) && borders_are_known(scene, motion)
}

fn borders_are_known(scene: &Scene, motion: &Motion) -> bool {
    let chains = &scene.chains;
    let any = !(chains.faces.is_empty() && scene.balls.is_empty());
    any && !(chains.cut || chains.touching) && unknown(scene, motion).next().is_none()
}

/// Neither smooth nor null.
pub fn is_opaque(scene: &Scene, s: &Instance) -> bool {
    let surface = &scene.surfaces[s.surface as usize];
    !surface.is_null() && !surface.is_smooth()
}

/// Whether something may stand in a beam, beside glass or mirrors, or these part it: [`super::hard_beam`] knows of no shadows.
pub fn cut_beams(scene: &Scene) -> bool {
    let has_beam = scene.lights.iter().any(Light::is_beam);
    let opaque = || scene.shapes.iter().any(|s| is_opaque(scene, s));
    has_beam && scene.has_smooth() && (opaque() || !scene.beams.parted.is_empty())
}

/// Whether the borders of such beams are told here.
pub fn takes_beams(scene: &Scene, motion: &Motion) -> bool {
    motion.surfaces() && cut_beams(scene) && borders_are_known(scene, motion)
}

/// Shapes whose borders are not known.
pub fn unknown<'a>(scene: &'a Scene, motion: &'a Motion) -> impl Iterator<Item = &'a Instance> {
    let known = |id: u32, s: &Instance| {
        if scene.is_null(s) {
            return !motion.moves(id);
        }
        let smooth = scene.surface_of(id).is_smooth();
        match &s.shape {
            Shape::Cube(_) => true,
            Shape::Sphere(_) => !smooth || lone_mirror(scene).is_some(),
            Shape::Cylinder(_) => !smooth,
            Shape::Disk(_) => !smooth || scene.is_round_mirror(s),
            // One of glass bounds a half-space, whose border has to be out of sight.
            Shape::Rectangle(_) => !(smooth && scene.surface_of(id).is_transparent()),
            Shape::Mesh(_) if !smooth => has_flat_faces(s) && s.shape.face_count() <= OPAQUE,
            Shape::Mesh(m) => {
                has_flat_faces(s) && s.shape.face_count() <= FACETS && is_convex(m, scene.tolerance(m.bounds().max))
            }
        }
    };
    (0..).zip(&scene.shapes).filter(move |(id, s)| !known(*id, s)).map(|(_, s)| s)
}

/// What would make borders more than can be told: to be asked where they are known ([`are_known`]).
pub fn check(scene: &Scene, motion: &Motion) -> Result<()> {
    let is_smooth = |k: u32| scene.surface_of(k).is_smooth();
    if let Some(&(a, b)) = motion.crossed.iter().find(|&&(a, b)| is_smooth(a) || is_smooth(b)) {
        let [a, b] = [a, b].map(|k| &scene.shapes[k as usize]);
        let what = format!(
            "the shapes `{}` and `{}` pass through each other, one of which mirrors or refracts: where light without extent ends there cannot be told yet",
            a.name, b.name
        );
        return Err(Error::scene(&a.span, what, "keep them apart"));
    }
    interfaces::touching(scene, motion)?;
    interfaces::contacts(scene, motion)?;
    if let Some((a, b)) = cast_border::overlapping(scene, &motion.rims, |a, b| motion.class(a) != motion.class(b)) {
        let [a, b] = [a, b].map(|k| &scene.shapes[k as usize]);
        let what = format!(
            "edges of `{}` and `{}` lie on each other in part, or move apart, beside glass or mirrors: the shadow that they cast in light without extent cannot be told yet",
            a.name, b.name
        );
        return Err(Error::scene(
            &b.span,
            what,
            "leave a gap between them (a ten-thousandth of their size is enough), or let whole edges meet",
        ));
    }
    let beams = takes_beams(scene, motion);
    let counts = |l: &Light| l.is_delta() || l.is_beam() && beams;
    let lights = (0..scene.lights.len() as u32).filter(|&id| counts(&scene.lights[id as usize]));
    let borders = cast_border::borders(scene, &motion.rims);
    let sheets: usize = lights.map(|id| count(scene, &borders, id)).sum();
    if sheets > SHEETS {
        let first = &scene.shapes[borders[0].own().0 as usize];
        let what = format!(
            "light without extent ends at the borders of `{}` and others in {sheets} ways, more than {SHEETS}: too many to differentiate",
            first.name
        );
        return Err(Error::scene(&first.span, what, "use fewer faces, or a smaller max_depth"));
    }
    Ok(())
}

impl Casts {
    /// Of the lights that `counts` names; `None` where nothing casts such shadows.
    pub fn prepare(
        scene: &Scene,
        sensor: &Sensor,
        motion: &Motion,
        margin: f64,
        counts: impl Fn(&Light) -> bool,
    ) -> Option<Casts> {
        if scene.chains.faces.is_empty() && scene.balls.is_empty() {
            return None;
        }
        let slot = |(l, m): (&Light, &LightMotion)| match l.center() {
            Some(_) if m.position => Some(l.place.position),
            None if m.direction => Some(l.place.direction),
            _ => None,
        };
        let slots: Vec<Option<Slot>> = scene.lights.iter().zip(&motion.lights).map(slot).collect();
        let moves = |id: usize| motion.surfaces() || slots[id].is_some();
        let lights = scene.lights.iter().enumerate().filter(|(id, l)| counts(l) && moves(*id));
        let lights: Vec<(usize, &Light)> = lights.collect();
        if lights.is_empty() {
            return None;
        }
        let borders = cast_border::borders(scene, &motion.rims);
        let mut sheets: Vec<Sheet> =
            lights.into_iter().flat_map(|(id, _)| of_light(scene, &borders, id as u32)).collect();
        sheets.sort_by(|a, b| b.asked.total_cmp(&a.asked));
        let ended = Ended::new(scene, &motion.moving, sheets, slots);
        let traces = Traces::prepare(scene, sensor, margin, &ended);
        (!ended.sheets.is_empty()).then_some(Casts { ended, traces })
    }

    /// Whether any of them ends on something that scatters.
    pub fn has_traces(&self) -> bool {
        self.traces.is_some()
    }

    /// Where they end on surfaces, as the camera sees it.
    pub fn outward(&self, cx: &mut Context, lead: &Numbers, rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        if let Some(traces) = &self.traces {
            traces.outward(cx, &self.ended, lead, rng, emit);
        }
    }

    /// All crossings of a camera path with sheets, and where they end on surfaces that its vertices see.
    pub fn along(&self, cx: &mut Context, film: [f64; 2], rng: Rng, emit: &mut dyn FnMut(&Sample)) {
        if let Some(traces) = &self.traces {
            traces.along(cx, &self.ended, film, &mut { rng }, emit);
        }
        if cx.scene.media.is_empty() {
            return;
        }
        let mut rec = Bare(spans::record());
        let mut chosen = rng.beside(Rng::next_u64(&mut { rng }));
        spans::walk(cx, film, rng, &mut rec);
        let starts = spans::starts(cx, &rec.0);
        let mut tally = Tally::default();
        let mut emit = |flux: Rgb, partials: &Partials| {
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
        };
        spans::each(cx, &rec.0, &starts, &mut |walked, moves| {
            let within = around(cx.scene, &walked.span);
            // One of 1/asked each.
            let mut next = chosen.uniform();
            for sheet in self.ended.sheets.iter().filter(|s| !s.border.is_of_beam()) {
                next += sheet.asked;
                if next >= 1.0 {
                    next -= 1.0;
                    if sheet.within == within {
                        self.cross(cx, sheet, walked, moves, &mut tally, &mut emit);
                    }
                }
            }
        });
        cx.tally = cx.tally.plus(&tally);
    }

    fn cross(
        &self,
        cx: &Context,
        sheet: &Sheet,
        walked: &Walked,
        moves: Moves,
        tally: &mut Tally,
        emit: &mut dyn FnMut(Rgb, &Partials),
    ) {
        let (scene, span) = (cx.scene, &walked.span);
        let order = walked.depth + 1 + sheet.route.len() as u32;
        if order < cx.set.min_order || order >= cx.set.max_depth {
            return;
        }
        effort::note(1);
        for (s, t) in sheet.crossings(scene, span.o, span.w, [span.t0, span.t1]) {
            effort::note(4);
            let p = span.o + span.w * t;
            // Where the planes before the border are not met in turn no light comes.
            let Some(met) = sheet.met(scene, s, &mut tally.unsettled) else { continue };
            let Some(slide) = met.slide(scene, sheet.at, p) else {
                tally.unsettled += 1;
                continue;
            };
            let m = met.m;
            let [by_end, by_light] = slide.by_ends(m);
            let slope = by_end.dot(span.w);
            let off = by_end * (sheet.aside(scene) / by_end.length_squared());
            let at = |y: DVec3| (y, On::default(), Some(span.medium));
            let sides = [p + off, p - off].map(|y| sheet.arrives(scene, met.first, at(y), &mut tally.unsettled));
            let medium = &scene.media[span.medium as usize];
            let f = medium.phase.eval(one_minus_cos(span.w, -met.w)) / (sheet.asked * slope.abs());
            let flux = (walked.weight)(t) * medium.coefficients(p).1 * (sides[0] - sides[1]) * f;
            if flux.is_zero() || !flux.is_finite() {
                tally.nonfinite += u64::from(!flux.is_finite());
                continue;
            }
            let start = cx.moving.any().then(|| moves(&walked.whole, p));
            let Some(partials) = self.ended.partials(cx, (sheet, &met), (&slide, by_light), start.as_ref()) else {
                tally.unsettled += 1;
                continue;
            };
            emit(flux, &partials);
        }
    }
}
