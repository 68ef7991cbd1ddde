//! The plan: which terms of the derivative a scene needs for the parameters asked, which are left out and why.
//! The table of [T] section 3 as code, in two steps: facts of the scene and of what moves, then rules. Renders nothing,
//! loads no grid.

use super::cause::{
    Cause, cause, dark_behind, has_known_borders, is_outlined, is_smooth, nearest_grid, unlit, zero_measure,
};
use crate::error::{Error, Result};
use crate::math::Dual;
use crate::params::Quantity;
use crate::scene::arrays::Target;
use crate::scene::desc::suggest;
use crate::scene::parts::{LightKindPart, Movable, Parts, ShapeKind, ShapePart, SurfacePart, VolumePart};
use crate::scene::{SceneDesc, arrays};
use crate::transport::border;
use serde::Serialize;
use std::collections::BTreeMap;

/// The terms of [T] section 3 by their letters, in the order of reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Term {
    /// Material and light values.
    P,
    /// Interior motion: attached vertices.
    M,
    /// Specular attachment.
    S,
    /// Manifold connections.
    C,
    /// Pixel edges.
    E1,
    /// Silhouettes of in-scattering.
    E2,
    /// Silhouettes of surface scattering.
    E3,
    /// Face sweep.
    D,
    /// Null interfaces.
    N,
    /// Shadow roots in media.
    G,
    /// Receiver shadow curves.
    R,
    /// Hard light profiles.
    H,
    /// Virtual edges.
    VE,
}

impl Term {
    pub const ALL: [Term; 13] = [
        Term::P,
        Term::M,
        Term::S,
        Term::C,
        Term::E1,
        Term::E2,
        Term::E3,
        Term::D,
        Term::N,
        Term::G,
        Term::R,
        Term::H,
        Term::VE,
    ];

    /// Its letters in [T].
    pub fn letters(self) -> String {
        format!("{self:?}")
    }

    /// The name that commands, layers and reports use: `interior`, or the room.
    pub fn room(self) -> &'static str {
        match self {
            Term::P | Term::M | Term::S | Term::C => "interior",
            Term::E1 => "pixel_edge",
            Term::E2 => "medium_edge",
            Term::E3 => "surface_edge",
            Term::D => "face_sweep",
            Term::N => "null_interface",
            Term::G | Term::R => "light_shadow",
            Term::H => "hard_profile",
            Term::VE => "virtual_edge",
        }
    }

    fn what(self) -> &'static str {
        match self {
            Term::P => "material and light values",
            Term::M => "interior motion",
            Term::S => "specular attachment",
            Term::C => "connections through interfaces",
            Term::E1 => "pixel edges",
            Term::E2 => "silhouettes seen from a medium",
            Term::E3 => "silhouettes seen from surfaces",
            Term::D => "medium swept by a moving face",
            Term::N => "moving medium borders",
            Term::G => "volumetric shadow of a zero-measure light",
            Term::R => "shadow of a zero-measure light on a receiver",
            Term::H => "hard light profile",
            Term::VE => "edges seen through specular chains",
        }
    }

    /// Whether this program computes it for such a motion.
    pub fn exists(self, m: &Motion) -> bool {
        let unknown = m.ior || m.interface || m.other_volume.is_some();
        match self {
            Term::P => m.environment.is_none() && m.other_volume.is_none(),
            Term::M => m.other_volume.is_none(),
            Term::S => true,
            Term::H => m.other_volume.is_none(),
            Term::E1 | Term::E2 | Term::E3 | Term::VE => m.other_volume.is_none(),
            Term::G | Term::R => !unknown,
            Term::N => !unknown && m.box_border.is_none(),
            _ => false,
        }
    }
}

/// What the scene is, as far as the table asks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Facts {
    pub medium: bool,
    /// Anything opaque or refracting.
    pub surfaces: bool,
    /// Surfaces that reflect light on.
    pub reflecting: bool,
    /// Of those, some that are neither glass nor mirrors.
    pub receivers: bool,
    /// Opaque things that can stand between a light and what it lights (a lamp's own shape alone does not).
    pub occluders: bool,
    /// Point, spot or directional light.
    pub zero_measure_light: bool,
    /// Of those, one with a position.
    pub local_light: bool,
    pub hard_profile: bool,
    /// A collimated beam.
    pub beam: bool,
    pub area_light: bool,
    /// The density of some medium jumps at a visible border (its box, its shape).
    pub border_jump: bool,
    pub dielectric: bool,
    /// All glass and metal is rectangles, and disks of glass.
    pub only_panes: bool,
    /// All that is opaque is rectangles.
    pub opaque_rectangles: bool,
    /// All that casts shadows, glass too, has known borders.
    pub known_borders: bool,
    /// None of what mirrors or refracts smoothly is round, or a mesh.
    pub flat_smooth: bool,
    /// A dielectric or mirror with facets or other edges.
    pub polygonal_dielectric: bool,
    /// A ball or cylinder of glass or metal, and something outside of it that scatters.
    pub rims: bool,
    /// Something with an outline (occluder, lamp) can be seen or cast by way of an interface.
    pub beyond_interface: bool,
    /// A tube that mirrors on one side alone.
    pub dark_behind: bool,
    /// A zero-measure light whose light has to cross an interface.
    pub light_across_interface: bool,
    /// Rough glass of GGX facets, and light without extent, beams too.
    pub facets: bool,
}

impl Facts {
    /// Of a beam that something opaque may stand in, beside glass or mirrors, all borders are known (`term::cast`).
    fn knows_cut_beams(&self) -> bool {
        self.beam && self.beyond_interface && self.known_borders && self.flat_smooth
    }
}

/// What moves or changes for the parameters asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Motion {
    /// Material values, light values.
    pub values: bool,
    /// An environment map turns: which light it is.
    pub environment: Option<usize>,
    /// A volume moves by its transform.
    pub volume: bool,
    /// Of those, one of albedo or emission that ends at a box: of which medium.
    pub other_volume: Option<usize>,
    /// The border at which its density jumps moves with it.
    pub border: bool,
    /// That border is the box of a grid: of which medium.
    pub box_border: Option<usize>,
    /// Point, spot or directional light.
    pub zero_measure_light: bool,
    /// Of those, one with a position moves its position.
    pub local_light: bool,
    /// Angles of a spot.
    pub profile: bool,
    /// A collimated beam: where it is, its direction, its radius.
    pub beam: bool,
    /// Its direction.
    pub beam_turns: bool,
    pub area_light: bool,
    pub opaque: bool,
    pub camera: bool,
    pub ior: bool,
    /// Of rough surfaces.
    pub facet_ior: bool,
    pub interface: bool,
}

/// The table of [T] section 3: every term that the motion needs in such a scene, with its reason.
pub fn needed(f: &Facts, m: &Motion) -> BTreeMap<Term, &'static str> {
    use Term::*;
    let mut need = BTreeMap::new();
    let mut add = |when: bool, terms: &[Term], why: &'static str| {
        if when {
            for &t in terms {
                need.entry(t).or_insert(why);
            }
        }
    };
    add(m.values, &[P], "material or light values change");
    add(m.environment.is_some(), &[P], "an environment map turns");
    add(m.volume, &[P], "a volume moves: its values change at fixed points");
    add(m.border, &[P, N], "a border at which the density jumps moves");

    add(m.area_light, &[M], "an area light moves");
    add(m.area_light, &[E1], "an area light moves, its outline may be seen");
    let lit = m.area_light && f.occluders;
    add(lit && f.medium, &[E2], "an area light moves, its light is cut by silhouettes");
    add(lit && f.surfaces, &[E3], "an area light moves, its light is cut by silhouettes");

    add(m.zero_measure_light, &[M], "a zero-measure light moves");
    add((m.zero_measure_light || m.profile) && f.hard_profile, &[H], "its profile has a hard edge");
    let matter = m.opaque || m.area_light || m.camera && f.surfaces;
    add(matter && f.hard_profile, &[H], "what a hard-edged profile lights moves");
    add(m.profile && !f.hard_profile, &[P], "a smooth light profile changes");
    let followed = m.local_light && f.hard_profile && f.medium && f.occluders;
    add(followed, &[E2], "points of a medium follow a hard-edged light that stands in it");
    add(followed && f.reflecting, &[E3], "points of a medium follow a hard-edged light that stands in it");
    add(m.beam, &[M], "a beam moves, or its profile changes");
    add(m.beam && f.hard_profile, &[H], "its profile has a hard edge");
    let any = m.beam || m.opaque || m.area_light || m.camera || m.ior || m.interface || m.zero_measure_light;
    // Where nothing mirrors or refracts.
    let straight_beam = f.beam && !f.dielectric;
    add(any && straight_beam && f.medium, &[H], "a beam may begin inside a medium");
    let cut = any && f.beam && f.beyond_interface;
    let why = "something opaque may stand in a beam, beside glass or mirrors";
    add(cut && f.medium, &[G], why);
    // Its own edge on surfaces is told with all other borders there.
    add(cut && f.receivers, &[R], why);
    add(cut && !f.knows_cut_beams(), &[C], why);
    let shadow = (m.zero_measure_light || m.beam_turns && straight_beam) && f.occluders;
    add(shadow && f.medium, &[G], "a light moves, occluders cast shadows in a medium");
    add(shadow && f.reflecting, &[R], "a light moves, occluders cast shadows on surfaces");

    // Straight beams cast shadows like a light without extent.
    let casts = f.zero_measure_light || straight_beam;
    let both = casts && (m.opaque || m.area_light);
    add(m.opaque, &[M, E1], "something opaque moves");
    add(m.opaque && f.medium, &[E2], "something opaque moves in a medium");
    add(m.opaque && (!f.medium || f.reflecting), &[E3], "something opaque moves, surfaces scatter");
    add(both && f.medium, &[G], "an occluder of a zero-measure light moves in a medium");
    add(both && (!f.medium || f.reflecting), &[R], "an occluder of a zero-measure light moves");

    add(m.camera, &[M], "the camera moves");
    let seen = m.camera && f.surfaces;
    add(seen, &[E1], "the camera moves past surfaces");
    add(seen && f.medium, &[E2], "vertices ride on camera rays past static silhouettes");
    add(seen && f.reflecting, &[E3], "hits ride on camera rays");
    add(seen && casts && f.medium, &[G], "vertices ride on camera rays through shadows");
    add(seen && casts && f.reflecting, &[R], "hits ride on camera rays through shadows");

    let anything = m.opaque || m.camera || m.zero_measure_light || m.area_light;
    // No D: where medium points go with what their ray meets ([T] (58), (60)) no face is swept.
    add(m.ior, &[S], "the refractive index changes");
    add(m.interface, &[S], "an interface moves");
    add(m.interface && f.medium, &[M], "medium points near an interface that moves go with it");
    add(m.camera && f.dielectric, &[S], "camera rays turn at interfaces");
    let specular = m.ior || m.interface;
    add(specular && f.light_across_interface, &[C], "a zero-measure light shines through an interface");
    add(specular && f.beam, &[M], "a beam shines through an interface");
    add(specular && f.hard_profile, &[H], "the beam has a hard edge");
    let parts = m.camera || m.beam || specular;
    add(parts && f.beam && f.polygonal_dielectric, &[H], "the light of a beam parts at the edges of an interface");
    // Vertices behind an interface go with their rays: what they see pass is one term, whatever it is ([T] section 3 has E1 to E3 for it).
    add(specular && f.beyond_interface, &[VE], "outlines are seen by way of an interface whose rays turn");
    let beside = m.interface && f.beyond_interface;
    add(beside && f.medium, &[E2], "medium points near an interface that moves see static edges");
    add(beside && f.reflecting, &[E3], "the light of surfaces is cut by what moves");
    let across = specular && f.beyond_interface && f.light_across_interface && f.occluders;
    add(across && f.medium, &[G], "a point light casts shadows across an interface");
    add(across && f.reflecting, &[R], "a point light casts shadows across an interface");
    add(m.interface && f.polygonal_dielectric, &[E1], "an interface with edges moves");
    add(specular && f.polygonal_dielectric, &[VE], "rays part at the edges of an interface");
    add(anything && f.polygonal_dielectric, &[VE], "rays part at the edges of an interface");
    add(
        anything && f.dielectric && f.occluders && f.beyond_interface,
        &[VE],
        "an occluder is seen through an interface",
    );
    let turns = m.facet_ior || m.beam || anything;
    add(turns && !specular && f.facets, &[R], "rough glass cuts light without extent off at some angles");
    add(
        (anything || specular) && f.rims,
        &[VE],
        "segments end at the outlines of balls and cylinders of glass or metal",
    );
    need
}

/// A selection of terms by the names of rooms, `interior` among them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Terms(Option<Vec<String>>);

impl Terms {
    /// All that are needed.
    pub const ALL: Terms = Terms(None);

    /// `all`, or names of terms.
    pub fn parse(names: &[String]) -> Result<Terms> {
        let mut chosen = Vec::new();
        for n in names {
            let valid = || {
                let mut v: Vec<&str> = std::iter::once("all").chain(Term::ALL.iter().map(|t| t.room())).collect();
                v.dedup();
                v
            };
            match n.as_str() {
                "all" => return Ok(Terms::ALL),
                n if n == "interior" || n == border::NAME || crate::term::ROOMS.contains(&n) => {
                    chosen.push(n.to_string());
                }
                n if valid().contains(&n) => {
                    let what = format!("`--terms {n}`: this term is not available yet");
                    let list = crate::term::ROOMS.join(", ");
                    return Err(Error::usage(what, format!("available: all, interior, {}, {list}", border::NAME)));
                }
                n => return Err(Error::usage(format!("`--terms {n}`: unknown term"), suggest(n, valid()))),
            }
        }
        Ok(Terms(Some(chosen)))
    }

    pub fn wants(&self, term: &str) -> bool {
        self.0.as_ref().is_none_or(|v| v.iter().any(|n| n == term))
    }
}

/// One line of a plan.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PlanLine {
    /// Name of the room or `interior`.
    pub term: String,
    /// Letters in [T] section 3.
    pub letters: String,
    /// `use`, `skip` or `missing`.
    pub decision: String,
    pub reason: String,
}

#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    pub wrt: Vec<String>,
    pub lines: Vec<PlanLine>,
    #[serde(skip)]
    missing: Vec<Missing>,
}

/// A term that is needed and does not exist.
#[derive(Clone, Debug)]
struct Missing {
    parameter: String,
    term: Term,
    why: &'static str,
    /// What of the scene asks for it, and what to do.
    cause: Option<Cause>,
}

impl Plan {
    /// Facts, motion and rules for the named parameters.
    pub fn new(desc: &SceneDesc, wrt: &[String]) -> Result<Plan> {
        let parts = Parts::read(desc, &desc.values::<f64>())?;
        desc.finish()?;
        let facts = facts(&parts);
        let mut all: BTreeMap<Term, String> = BTreeMap::new();
        let mut missing = Vec::new();
        for name in wrt {
            let motion = match arrays::split(name) {
                Some(_) => match arrays::target(&parts, name)? {
                    Target::Vertices(shape) => motion_of_mesh(&parts, shape),
                    Target::Voxels(..) => Motion { values: true, ..Motion::default() },
                },
                None => motion(&parts, &Parts::read(desc, &desc.dual(desc.wrt(name)?))?),
            };
            let matter = motion.opaque || motion.area_light || motion.camera;
            let light = motion.zero_measure_light || motion.profile;
            // By way of flat faces all light of lights without extent is known, where they are parallel and nothing casts shadows (`term::panes` sees to that), or all shadows have known borders (`term::cast`), by a single ball of metal, too.
            let turns = motion.camera || motion.ior || motion.interface;
            let moved = motion.opaque || motion.area_light;
            // Spots that turn or open move no shadow.
            let clear = facts.opaque_rectangles || !(turns || motion.zero_measure_light);
            let known = (facts.only_panes && !moved && clear || facts.known_borders)
                && (light || facts.zero_measure_light && (turns || moved));
            if known {
                let why = if turns || moved {
                    "a light shines by way of glass or mirrors"
                } else {
                    "a light moves that shines by way of glass or mirrors"
                };
                all.entry(Term::C).or_insert_with(|| format!("{why} ({name})"));
                if facts.known_borders {
                    all.entry(Term::G).or_insert_with(|| format!("{why}, which end ({name})"));
                    if facts.receivers {
                        all.entry(Term::R).or_insert_with(|| format!("{why}, which end ({name})"));
                    }
                }
            }
            for (term, why) in needed(&facts, &motion) {
                let covered = match term {
                    Term::G | Term::R => true,
                    Term::VE => !(turns || moved),
                    Term::C => !(facts.beam && facts.beyond_interface) || facts.knows_cut_beams(),
                    _ => false,
                };
                if known && covered {
                    continue;
                }
                let by_beams = facts.knows_cut_beams() && (known || !facts.zero_measure_light);
                if !(term.exists(&motion) || by_beams && matches!(term, Term::G | Term::R)) {
                    let cause = cause(&parts, term, &motion);
                    missing.push(Missing { parameter: name.clone(), term, why, cause });
                }
                all.entry(term).or_insert_with(|| format!("{why} ({name})"));
            }
            let mut miss = |term: Term, why: &'static str, cause: Option<Cause>| {
                missing.push(Missing { parameter: name.clone(), term, why, cause });
                all.entry(term).or_insert_with(|| format!("{why} ({name})"));
            };
            if facts.dielectric
                && !known
                && (light || facts.zero_measure_light && (matter || motion.ior || motion.interface))
            {
                let why = "what moves may be seen or lit by way of an interface";
                let remedy = "use an area light that is a rectangle, an environment or, where nothing is opaque, a collimated beam; or keep of glass and mirrors only rectangles and disks that are parallel to one another, where nothing opaque moves; or of glass only cubes and convex meshes, of metal rectangles and disks too (or nothing but a ball of metal), and of all else anything but meshes with vertex normals";
                miss(Term::S, why, unlit(&parts, remedy));
            }
            let turns = motion.ior || motion.interface || motion.beam;
            if facts.dark_behind && (matter || turns) {
                let why = "a tube mirrors on one side alone";
                let remedy = "make it two-sided";
                miss(Term::VE, why, dark_behind(&parts).map(|s| Cause::of_shape(s, remedy)));
            }
            if let Some(m) = nearest_grid(&parts).filter(|_| light || matter) {
                let why = "a nearest-neighbour grid jumps at every cell face";
                miss(Term::N, why, Some(Cause::of_medium(m, "use filter_type trilinear")));
            }
        }
        let lines = Term::ALL
            .iter()
            .map(|&t| {
                let own = || missing.iter().filter(|m| m.term == t);
                let cause = own().find_map(|m| m.cause.as_ref());
                let cause =
                    cause.map_or(String::new(), |c| format!(" because of `{}` ({}): {}", c.name, c.span, c.remedy));
                let (decision, reason) = match all.get(&t) {
                    Some(why) if own().next().is_some() => ("missing", format!("{why}: not available yet{cause}")),
                    Some(why) => ("use", why.clone()),
                    None if wrt.is_empty() => ("skip", "no parameter is asked for".into()),
                    None => ("skip", format!("{}: nothing that enters it changes", t.what())),
                };
                PlanLine { term: t.room().into(), letters: t.letters(), decision: decision.into(), reason }
            })
            .collect();
        Ok(Plan { wrt: wrt.to_vec(), lines, missing })
    }

    /// An error that names the parameter, the term and the object where one is missing: never a biased picture.
    pub fn refuse(&self) -> Result<()> {
        // Best where there is something to do.
        let Some(m) = self.missing.iter().find(|m| m.cause.is_some()).or(self.missing.first()) else { return Ok(()) };
        let of = |t: &Term| self.missing.iter().any(|m| m.term == *t);
        let rest: Vec<String> =
            Term::ALL.iter().filter(|t| of(t)).map(|t| format!("{} ({})", t.room(), t.letters())).collect();
        let (name, term, why) = (&m.parameter, m.term, m.why);
        let what = format!("d/d{name} needs {} ({}), which is not available yet: {why}", term.room(), term.what());
        let rest = format!(
            "without it the picture would be biased; missing: {}. `tyndall plan` shows all terms",
            rest.join(", ")
        );
        Err(match &m.cause {
            Some(c) => Error::scene(&c.span, format!("{what}: `{}`", c.name), format!("{}; {rest}", c.remedy)),
            None => Error::usage(what, rest),
        })
    }
}

/// Whether segments between scattering points may end at the outline of a smooth ball or cylinder: as `term::virtual_edge` has it.
fn rims(p: &Parts<f64>) -> bool {
    let smooth = |s: usize| is_smooth(p, s);
    let null = |s: usize| matches!(p.surfaces[s], SurfacePart::Null);
    let fog = |m: Option<usize>| m.is_some();
    let is_round =
        |k: &ShapeKind<f64>, s: usize| matches!(k, ShapeKind::Sphere { .. } | ShapeKind::Cylinder { .. }) && smooth(s);
    let several = p.shapes.iter().filter(|s| is_round(&s.kind, s.surface)).count() > 1;
    let beside = |s: &ShapePart<f64>| {
        let opaque = !null(s.surface) && !smooth(s.surface);
        opaque || fog(s.exterior) || (several || !is_round(&s.kind, s.surface)) && fog(s.interior)
    };
    p.shapes.iter().any(|s| is_round(&s.kind, s.surface))
        && (p.shapes.iter().any(beside) || p.sensors.iter().any(|s| fog(s.medium)))
}

/// Facts of a scene from its parts.
pub fn facts(p: &Parts<f64>) -> Facts {
    let opaque = |s: usize| !matches!(p.surfaces[s], SurfacePart::Null);
    let reflects = |s: usize| match &p.surfaces[s] {
        SurfacePart::Diffuse { reflectance, .. } => reflectance.iter().any(|&x| x > 0.0),
        SurfacePart::Dielectric { .. } | SurfacePart::Conductor { .. } | SurfacePart::Rough { .. } => true,
        SurfacePart::Null => false,
    };
    let smooth = |s: usize| is_smooth(p, s);
    let through = |s: usize| matches!(p.surfaces[s], SurfacePart::Dielectric { .. });
    // The border of an open interface counts as out of sight (`term::interfaces`), that of a mirror does not.
    let edged = |k: &ShapeKind<f64>| !matches!(k, ShapeKind::Sphere { .. } | ShapeKind::Rectangle | ShapeKind::Disk);
    let outlined = |s: usize| is_outlined(p, s);
    let is_mirror = |s: &ShapePart<f64>| {
        matches!(s.kind, ShapeKind::Rectangle | ShapeKind::Disk)
            && matches!(p.surfaces[s.surface], SurfacePart::Conductor { .. })
    };
    let local = |k: &LightKindPart<f64>| matches!(k, LightKindPart::Point { .. } | LightKindPart::Spot { .. });
    let beam = |k: &LightKindPart<f64>| matches!(k, LightKindPart::Beam { .. });
    let zero_measure_light = zero_measure(p).is_some();
    let solid: Vec<_> = p.shapes.iter().filter(|s| opaque(s.surface)).collect();
    Facts {
        medium: !p.media.is_empty(),
        surfaces: !solid.is_empty(),
        reflecting: solid.iter().any(|s| reflects(s.surface)),
        receivers: solid.iter().any(|s| reflects(s.surface) && !smooth(s.surface)),
        // A single lamp does not shade itself; anything else may.
        occluders: solid.iter().any(|s| s.light.is_none()) || solid.len() > 1,
        zero_measure_light,
        local_light: p.lights.iter().any(|l| local(&l.kind)),
        hard_profile: p.lights.iter().any(|l| match l.kind {
            LightKindPart::Spot { beam, cutoff, .. } => beam >= cutoff,
            LightKindPart::Beam { gaussian, .. } => !gaussian,
            _ => false,
        }),
        beam: p.lights.iter().any(|l| beam(&l.kind)),
        area_light: p.lights.iter().any(|l| matches!(l.kind, LightKindPart::Area { .. })),
        border_jump: p.media.iter().any(|m| !matches!(m.density, VolumePart::Vdb { .. })),
        only_panes: p.shapes.iter().any(|s| smooth(s.surface))
            && p.shapes.iter().all(|s| match s.kind {
                ShapeKind::Rectangle => true,
                ShapeKind::Disk => !matches!(p.surfaces[s.surface], SurfacePart::Conductor { .. }),
                _ => !smooth(s.surface),
            }),
        opaque_rectangles: p.shapes.iter().all(|s| matches!(s.kind, ShapeKind::Rectangle) || !outlined(s.surface)),
        known_borders: p.shapes.iter().any(|s| smooth(s.surface)) && solid.iter().all(|s| has_known_borders(p, s)),
        flat_smooth: p
            .shapes
            .iter()
            .all(|s| !smooth(s.surface) || matches!(s.kind, ShapeKind::Rectangle | ShapeKind::Disk | ShapeKind::Cube)),
        dielectric: p.shapes.iter().any(|s| smooth(s.surface)),
        polygonal_dielectric: p.shapes.iter().any(|s| smooth(s.surface) && (edged(&s.kind) || is_mirror(s))),
        rims: rims(p),
        // Whatever there is besides, or behind, may be seen in it.
        beyond_interface: p.shapes.iter().any(|s| smooth(s.surface)) && p.shapes.iter().any(|s| outlined(s.surface)),
        dark_behind: dark_behind(p).is_some(),
        light_across_interface: p.shapes.iter().any(|s| through(s.surface)) && zero_measure_light,
        facets: p.shapes.iter().any(|s| p.surfaces[s.surface].upright().is_some())
            && (zero_measure_light || p.lights.iter().any(|l| beam(&l.kind))),
    }
}

impl Motion {
    /// A shape moves.
    fn shape(&mut self, p: &Parts<f64>, i: usize) {
        let s = &p.shapes[i];
        match (&p.surfaces[s.surface], s.light) {
            (SurfacePart::Null, light) => {
                self.border |= s.interior.is_some() || s.exterior.is_some();
                self.area_light |= light.is_some();
            }
            (_, Some(_)) => {
                self.area_light = true;
                // A lamp is opaque too: alone it hides nothing but itself.
                self.opaque |=
                    p.shapes.iter().filter(|s| !matches!(p.surfaces[s.surface], SurfacePart::Null)).count() > 1;
            }
            (SurfacePart::Dielectric { .. } | SurfacePart::Conductor { .. }, None) => self.interface = true,
            _ => self.opaque = true,
        }
    }
}

/// What moves where the vertices of a mesh do: other than a lamp that goes as a whole, it may shade itself.
fn motion_of_mesh(p: &Parts<f64>, i: usize) -> Motion {
    let mut m = Motion::default();
    m.shape(p, i);
    Motion { opaque: true, ..m }
}

/// What moves: which tangents of the parts are not zero.
pub fn motion(p: &Parts<f64>, d: &Parts<Dual<1>>) -> Motion {
    let slots = d.slots();
    let mut values = slots.iter().filter(|s| s.quantity.is_value()).flat_map(|s| &s.values);
    let changes = |q: Quantity| slots.iter().filter(|s| s.quantity == q).flat_map(|s| &s.values).any(|x| x.d[0] != 0.0);
    let (ior, facet_ior) = (changes(Quantity::Ior), changes(Quantity::FacetIor));
    let mut m = Motion { ior, facet_ior, values: values.any(|x| x.d[0] != 0.0), ..Motion::default() };
    for (what, x) in d.movable() {
        if x.iter().all(|x| x.d[0] == 0.0) {
            continue;
        }
        match what {
            Movable::Shape(i) => m.shape(p, i),
            Movable::LightPosition(i) | Movable::LightDirection(i) | Movable::LightProfile(i)
                if matches!(p.lights[i].kind, LightKindPart::Beam { .. }) =>
            {
                m.beam = true;
                m.beam_turns |= matches!(what, Movable::LightDirection(_));
            }
            Movable::LightPosition(_) => {
                m.zero_measure_light = true;
                m.local_light = true;
            }
            // The axis of a spot turns its profile; shadows stay where they are.
            Movable::LightDirection(i) => match p.lights[i].kind {
                LightKindPart::Spot { .. } => m.profile = true,
                _ => m.zero_measure_light = true,
            },
            Movable::LightProfile(_) => m.profile = true,
            Movable::Environment(i) => m.environment = Some(i),
            Movable::Density(i) => {
                m.volume = true;
                let ends = matches!(p.media[i].density, VolumePart::Vol { .. });
                m.border |= ends;
                m.box_border = Some(i).filter(|_| ends).or(m.box_border);
            }
            Movable::Glow(i) => {
                m.volume = true;
                // A field that jumps at its box would sweep it.
                let emission = p.media[i].emission.as_ref();
                let ends = emission.is_some_and(|e| matches!(e.volume, VolumePart::Vol { .. }));
                m.other_volume = Some(i).filter(|_| ends).or(m.other_volume);
            }
            Movable::Albedo(i) => {
                m.volume = true;
                let ends = matches!(p.media[i].albedo, VolumePart::Vol { .. });
                m.other_volume = Some(i).filter(|_| ends).or(m.other_volume);
            }
            Movable::Sensor(_) => m.camera = true,
        }
    }
    m
}
