//! Slots: the flat list of every differentiable scalar of a scene, in the order in which `scene::parts` lists them.

use crate::math::Rgb;

/// Index of a differentiable scalar.
pub type Slot = u32;

/// What a block of slots is, for plans, reports and `--wrt` by object id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// Extinction before `scale`, 1/length: per channel, or of every voxel.
    SigmaT,
    /// Single-scattering albedo likewise.
    Albedo,
    /// Factor on a medium's extinction.
    MediumScale,
    /// Mean cosine of the phase function.
    G,
    /// Diffuse reflectance, per channel.
    Reflectance,
    /// Indices of refraction of a dielectric: interior, exterior; of a conductor: eta and k, per channel.
    Ior,
    /// Roughness of a surface.
    Alpha,
    /// Indices of a rough interface or metal, likewise: values of its scattering at fixed directions.
    FacetIor,
    /// Radiance, intensity or irradiance of a light, per channel.
    Emission,
    /// Emitted radiance of a medium (multiplied by sigma_a) likewise.
    Glow,
    /// Factor on a medium's emission.
    GlowScale,
    /// Temperature of a medium that shines as a black body, its scale to kelvin, and what is subtracted before.
    Temperature,
    TemperatureScale,
    TemperatureOffset,
    /// Factor on an environment map.
    EnvironmentScale,
    /// Position of a point or spot light, world space.
    Position,
    /// Axis of a spot, direction of travel of a directional light; unit, world space.
    Direction,
    /// Beam width and cutoff of a spot, radians.
    Angles,
    /// Of a beam.
    Radius,
    /// Motion of a shape or camera: displacement of its pivot, world space.
    Shift,
    /// The linear part of its motion about the pivot, row by row ([`super::Mover`]).
    Deformation,
    /// The same two of a medium's emission grid.
    GlowShift,
    GlowDeformation,
    /// The same two of its albedo grid.
    AlbedoShift,
    AlbedoDeformation,
    /// A perspective camera's tangent of half the field of view, and its principal point.
    Lens,
    /// Vertices of a mesh, three numbers each, world space.
    Vertices,
}

impl Quantity {
    pub fn name(self) -> &'static str {
        match self {
            Quantity::SigmaT => "sigma_t",
            Quantity::Albedo => "albedo",
            Quantity::MediumScale => "scale",
            Quantity::G => "g",
            Quantity::Reflectance => "reflectance",
            Quantity::Ior | Quantity::FacetIor => "ior",
            Quantity::Alpha => "alpha",
            Quantity::Emission | Quantity::Glow => "emission",
            Quantity::GlowScale => "emission_scale",
            Quantity::Temperature => "temperature",
            Quantity::TemperatureScale => "temperature_scale",
            Quantity::TemperatureOffset => "temperature_offset",
            Quantity::EnvironmentScale => "scale",
            Quantity::Position => "position",
            Quantity::Direction => "direction",
            Quantity::Angles => "angles",
            Quantity::Radius => "radius",
            Quantity::Shift | Quantity::GlowShift | Quantity::AlbedoShift => "shift",
            Quantity::Deformation | Quantity::GlowDeformation | Quantity::AlbedoDeformation => "deformation",
            Quantity::Lens => "lens",
            Quantity::Vertices => "vertices",
        }
    }

    /// Whether it is a value at fixed points; otherwise something moves.
    pub fn is_value(self) -> bool {
        use Quantity::{
            AlbedoDeformation, AlbedoShift, Angles, Deformation, Direction, GlowDeformation, GlowShift, Ior, Lens,
            Position, Radius, Shift, Vertices,
        };
        let grids = matches!(self, GlowShift | GlowDeformation | AlbedoShift | AlbedoDeformation);
        let moves = matches!(self, Position | Direction | Shift | Deformation | Vertices);
        !(grids || moves || matches!(self, Ior | Angles | Radius | Lens))
    }
}

/// Whose slots: an index into the scene's media, surfaces, lights, shapes or sensors. Names need not be unique, indices are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Owner {
    Medium(usize),
    Surface(usize),
    Light(usize),
    Shape(usize),
    Sensor(usize),
}

/// Consecutive slots of one quantity of one object.
#[derive(Clone, Debug)]
pub struct Block {
    pub owner: Owner,
    /// The object's name, for reports.
    pub name: String,
    pub quantity: Quantity,
    pub first: Slot,
    pub len: u32,
}

/// All blocks of a scene. Arrays (vertices, voxels) have slots when they are asked for only, behind all others.
#[derive(Clone, Debug, Default)]
pub struct SlotTable {
    pub blocks: Vec<Block>,
    /// Of the scalars.
    pub values: Vec<f64>,
    /// Slots that every scene has; those of arrays come after them.
    pub scalars: usize,
    /// All slots.
    pub count: usize,
}

impl SlotTable {
    pub fn push(&mut self, owner: Owner, name: &str, quantity: Quantity, values: &[f64]) -> Slot {
        debug_assert_eq!(self.scalars, self.count, "arrays come last");
        let first = self.push_block(owner, name, quantity, values.len());
        self.values.extend_from_slice(values);
        self.scalars = self.count;
        first
    }

    /// The slots of an array, one after the other; no scalars may come after them. `None` if there are more than can be numbered.
    pub fn push_array(&mut self, owner: Owner, name: &str, quantity: Quantity, len: usize) -> Option<Slot> {
        (len < Slot::MAX as usize - self.count).then(|| self.push_block(owner, name, quantity, len))
    }

    fn push_block(&mut self, owner: Owner, name: &str, quantity: Quantity, len: usize) -> Slot {
        let first = self.count as Slot;
        self.blocks.push(Block { owner, name: name.into(), quantity, first, len: len as u32 });
        self.count += len;
        first
    }
}

/// An array of parameters: consecutive slots that are parameters themselves, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Array {
    /// As in `--wrt`.
    pub name: String,
    pub first: Slot,
    pub shape: Vec<usize>,
}

impl Array {
    /// Its slots, as indices.
    pub fn range(&self) -> std::ops::Range<usize> {
        let first = self.first as usize;
        first..first + self.shape.iter().product::<usize>()
    }
}

/// The parameters asked for: K names with the tangent of every scalar slot with respect to each of them, and arrays.
///
/// `tangent[slot * K + k] = d slot / d parameter k`. The same set serves both modes: forward contracts partials with it,
/// reverse multiplies the slot gradient by its transpose. Slots of arrays are parameters as they are, for reverse mode only.
#[derive(Clone, Debug, Default)]
pub struct ParamSet {
    pub names: Vec<String>,
    pub arrays: Vec<Array>,
    /// Of scalar slots.
    tangent: Vec<f64>,
    active: Vec<bool>,
}

impl ParamSet {
    /// `columns[k][slot]`.
    pub fn new(names: Vec<String>, columns: &[Vec<f64>], slots: usize) -> Self {
        let k = names.len();
        let mut tangent = vec![0.0; slots * k];
        for (j, col) in columns.iter().enumerate() {
            for (s, &t) in col.iter().enumerate() {
                tangent[s * k + j] = t;
            }
        }
        let active = (0..slots).map(|s| tangent[s * k..(s + 1) * k].iter().any(|&t| t != 0.0)).collect();
        ParamSet { names, arrays: Vec::new(), tangent, active }
    }

    /// With arrays besides, in a scene of so many slots.
    #[must_use]
    pub fn with_arrays(mut self, arrays: Vec<Array>, slots: usize) -> Self {
        self.active.resize(slots, false);
        arrays.iter().for_each(|a| self.active[a.range()].fill(true));
        ParamSet { arrays, ..self }
    }

    /// The same with all slots still but those that `keep` takes.
    #[must_use]
    pub fn only(&self, keep: impl Fn(Slot) -> bool) -> ParamSet {
        let (mut p, k) = (self.clone(), self.len());
        for s in 0..p.active.len() {
            if p.active[s] && !keep(s as Slot) {
                p.active[s] = false;
                p.tangent.get_mut(s * k..(s + 1) * k).into_iter().for_each(|t| t.fill(0.0));
            }
        }
        p
    }

    /// K.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Neither names nor arrays.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty() && self.arrays.is_empty()
    }

    /// Whether any parameter moves any slot at all.
    pub fn any_active(&self) -> bool {
        self.active.iter().any(|&a| a)
    }

    #[inline]
    pub fn is_active(&self, slot: Slot) -> bool {
        self.active[slot as usize]
    }

    /// Whether any of `len` slots from `first` is active.
    pub fn block_active(&self, first: Slot, len: u32) -> bool {
        (first..first + len).any(|s| self.is_active(s))
    }

    /// Of a scalar slot by each name; of an array's none.
    #[inline]
    pub fn tangents(&self, slot: Slot) -> &[f64] {
        let k = self.names.len();
        self.tangent.get(slot as usize * k..(slot as usize + 1) * k).unwrap_or(&[])
    }

    /// Gradient over named parameters from the gradient over slots (the transpose).
    pub fn pull_back(&self, slot_gradient: &[f64]) -> Vec<f64> {
        let mut g = vec![0.0; self.len()];
        for (x, tangents) in slot_gradient.iter().zip(self.tangent.chunks_exact(self.len().max(1))) {
            for (gk, t) in g.iter_mut().zip(tangents) {
                *gk += x * t;
            }
        }
        g
    }
}

/// Partial of a pixel with respect to a block of three slots of which slot `c` touches channel `c` only.
pub fn channels(first: Slot, w: Rgb) -> [(Slot, Rgb); 3] {
    std::array::from_fn(|c| (first + c as Slot, Rgb::channel(c, w[c])))
}
