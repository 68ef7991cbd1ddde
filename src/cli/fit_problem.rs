//! From the options of `fit` and its fit.toml to a problem: unknowns with bounds, starts, seeds, and the picture to match.

use super::fit::FitArgs;
use super::log::Log;
use super::options::{SceneOptions, parameters, parameters_and_arrays};
use super::run::{Setup, find_sensor, left_out};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tyndall::error::{Error, Result};
use tyndall::image::RgbImage;
use tyndall::image::exr::{self, ExrImage};
use tyndall::inverse::adam::StopRule;
use tyndall::inverse::album::{self, Targets};
use tyndall::inverse::fit::{Problem, Unknown};
use tyndall::inverse::loss::{self, Loss};
use tyndall::inverse::settings::{Rendered, Settings, Target, bare};
use tyndall::math::Rgb;
use tyndall::render::family::{Family, View};
use tyndall::render::health::Health;
use tyndall::render::plan::Terms;
use tyndall::scene::arrays;
use tyndall::scene::desc::suggest;
use tyndall::scene::parts::Parts;

/// Defaults of options.
const RATE: f64 = 0.03;
const HALF_LIFE: f64 = 40.0;
const ITERATIONS: usize = 300;
const SPP: u64 = 16;
const MAX_TIME: Duration = Duration::from_secs(600);
const TARGET_SPP: u64 = 1024;

/// The inputs, read.
pub struct Given {
    scene: SceneOptions,
    pub settings: Settings,
    /// Where names of the settings start.
    base: PathBuf,
}

impl Given {
    pub fn new(args: &FitArgs) -> Result<Self> {
        let is_toml = |p: &Path| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
        let file = if is_toml(&args.input) { Some(&args.input) } else { args.settings.as_ref() };
        let settings = file.map_or(Ok(Settings::default()), |f| Settings::read(f))?;
        let base = file.and_then(|f| f.parent()).map_or(PathBuf::new(), PathBuf::from);
        let scene = match (&settings.scene, is_toml(&args.input)) {
            (_, false) => args.input.clone(),
            (Some(name), true) => base.join(name),
            (None, true) => {
                let what = format!("{} names no scene", args.input.display());
                return Err(Error::usage(what, "add `scene = \"scene.xml\"`, relative to the file"));
            }
        };
        let mut define = args.define.clone();
        for (name, value) in &settings.define {
            if !define.iter().any(|(n, _)| n == name) {
                define.push((name.clone(), format!("{value:?}")));
            }
        }
        Ok(Given { scene: SceneOptions { scene, define, orders: None, frame: None }, settings, base })
    }
}

/// Everything but the pictures.
pub struct Prepared {
    pub setup: Setup,
    pub family: Family,
    /// Scalars.
    pub unknowns: Vec<Unknown>,
    /// Arrays of voxels.
    pub fields: Vec<Unknown>,
    /// Sensors that are fitted, by number, and the names of all.
    pub sensors: Vec<usize>,
    pub sensor_names: Vec<String>,
    /// One picture a fitted sensor, where files are given.
    files: Vec<(usize, String)>,
    /// Scalars, then fields: NaN where the file's own values are meant.
    pub starts: Vec<Vec<f64>>,
    pub seeds: Vec<u64>,
    /// True values of the unknowns where the target is rendered from values.
    pub truth: Vec<Option<f64>>,
    pub target_name: String,
    target: Target,
    pub loss: Loss,
    pub spp: u64,
    pub iterations: usize,
    pub max_time: Duration,
    pub half_life: f64,
    pub rule: StopRule,
    pub terms: Vec<String>,
}

impl Prepared {
    pub fn new(given: &Given, args: &FitArgs, log: &Log) -> Result<Self> {
        let s = &given.settings;
        let wrt = if args.wrt.is_empty() { s.wrt.as_deref().unwrap_or(&[]) } else { &args.wrt };
        let mut wrt = parameters_and_arrays(wrt)?;
        let others: Vec<String> = wrt.iter().filter(|n| !arrays::is_voxels(n)).cloned().collect();
        parameters(&others, "fit")?;
        // Scalars first.
        wrt.sort_by_key(|n| arrays::is_voxels(n));
        if wrt.is_empty() {
            return Err(Error::usage("nothing to find", "give --wrt a,b, or `wrt = [\"a\", \"b\"]` in the fit.toml"));
        }
        let target = match (&args.target, &s.target) {
            (Some(path), _) => Target::File(path.display().to_string()),
            (None, Some(Target::File(name))) => Target::File(given.base.join(name).display().to_string()),
            (None, Some(t)) => t.clone(),
            (None, None) if !s.targets.is_empty() => Target::File(String::new()),
            (None, None) => {
                let remedy = "give --target REF.exr, or a `target` in the fit.toml: a file, or a table of values";
                return Err(Error::usage("there is no picture to match", remedy));
            }
        };
        let terms = match (&s.terms, args.study.terms.as_slice()) {
            (Some(t), [all]) if all == "all" => t.clone(),
            (_, t) => t.to_vec(),
        };
        let chosen = Terms::parse(&terms)?;
        let mut render = args.study.render(args.spp);
        let listed = match (&render.sensor, &s.sensors) {
            (Some(_), _) => None,
            (None, Some(list)) => Some(list.get_ref().clone()),
            (None, None) if !s.targets.is_empty() => Some(s.targets.keys().cloned().collect()),
            (None, None) => None,
        };
        let all = render.sensor.as_deref().or(s.sensor.as_deref()) == Some("all") && listed.is_none();
        render.sensor = listed.as_ref().map(|l| l[0].clone()).or(render.sensor.or(s.sensor.clone()).filter(|_| !all));
        let setup = Setup::new(&given.scene, &render, &wrt, log)?;
        if let Some(w) = left_out(&setup, &chosen) {
            log.warn(w);
        }
        let parts = Parts::read(&setup.desc, &setup.desc.values::<f64>())?;
        let sensor_names: Vec<String> = parts.sensors.iter().map(|s| s.name.clone()).collect();
        let sensors: Vec<usize> = match &listed {
            Some(list) => list.iter().map(|n| find_sensor(Some(n), &parts)).collect::<Result<_>>()?,
            None if all => (0..sensor_names.len()).collect(),
            None => vec![setup.sensor],
        };
        if let Some(twice) = sensors.iter().enumerate().find(|(i, n)| sensors[..*i].contains(n)) {
            let what = format!("sensors: `{}` is named twice", sensor_names[*twice.1]);
            return Err(Error::usage(what, "a number and an id may mean the same sensor: name each once"));
        }
        if args.study.crop.is_some() && sensors.len() > 1 {
            return Err(Error::usage(
                "`--crop` is for one sensor, several are fitted",
                "give the films crops of their own",
            ));
        }
        let files = picture_files(&target, s, &given.base, &sensors, &sensor_names, &parts)?;
        if let Some((name, _)) = args.bounds.iter().find(|(n, _)| !wrt.contains(n)) {
            let what = format!("--bounds: `{name}` is not among the parameters to find");
            return Err(Error::usage(what, suggest(name, wrt.iter().map(String::as_str))));
        }
        let family = Family::file(&given.scene.scene, &given.scene.define, given.scene.load(args.study.repair_voxels));
        let all = wrt.iter().map(|n| unknown(n, &setup, s, args)).collect::<Result<Vec<_>>>()?;
        let (fields, unknowns): (Vec<Unknown>, Vec<Unknown>) =
            all.iter().cloned().partition(|u| arrays::is_voxels(&u.name));
        unknowns.iter().try_for_each(|u| try_bounds(u, &family, s, args))?;
        let starts = starts(&all, &setup, s, args)?;
        let rendered = if let Target::Values(r) = &target { Some(r) } else { None };
        if let Some(name) = rendered.and_then(|r| r.values.keys().find(|n| !has(&setup, n))) {
            let names = setup.desc.params.iter().map(|p| p.name.as_str());
            return Err(Error::usage(
                format!("[target] values: the scene has no parameter `{name}`"),
                suggest(name, names),
            ));
        }
        let scene_value = |n: &str| setup.desc.params.iter().find(|p| p.name == n).map(|p| p.value);
        let truth = |n: &String| rendered.and_then(|r| r.values.get(n).copied().or_else(|| scene_value(n)));
        let seeds = match (&args.seeds[..], args.study.seed, &s.seeds) {
            ([], Some(seed), _) => vec![seed],
            ([], None, Some(seeds)) => seeds.get_ref().clone(),
            ([], ..) => vec![setup.seed],
            (seeds, ..) => seeds.to_vec(),
        };
        let rule = StopRule {
            window: args.window.map(|n| n as usize).or(bare(&s.stop.window)).unwrap_or(StopRule::default().window),
            tolerance: args.tolerance.or(bare(&s.stop.tolerance)).unwrap_or(StopRule::default().tolerance),
        };
        Ok(Prepared {
            family,
            truth: unknowns.iter().map(|u| truth(&u.name)).collect(),
            target_name: match &target {
                Target::File(f) => f.clone(),
                Target::Values(_) => "target.exr".into(),
            },
            target,
            unknowns,
            fields,
            sensors,
            sensor_names,
            files,
            starts,
            seeds,
            loss: args.loss.map(Into::into).or(s.loss).unwrap_or_default(),
            spp: args.spp.or(bare(&s.spp)).unwrap_or(SPP),
            iterations: args.iterations.map(|n| n as usize).or(bare(&s.iterations)).unwrap_or(ITERATIONS),
            max_time: args.max_time.or(s.max_time.map(|t| t.0)).unwrap_or(MAX_TIME),
            half_life: args.half_life.or(bare(&s.half_life)).unwrap_or(HALF_LIFE),
            rule,
            terms,
            setup,
        })
    }

    fn view(&self) -> View<'_> {
        self.view_of(self.setup.sensor)
    }

    /// A sensor's view: cropped as the command line or its film asks.
    pub fn view_of(&self, sensor: usize) -> View<'_> {
        let s = &self.setup;
        let crop = if sensor == s.sensor { s.crop } else { s.scene.films[sensor].part.crop };
        View { sensor, crop, terms: &self.terms, stop: Some(s.stop.flag()) }
    }

    /// Whether the fit goes in reverse mode: for voxels, and for several views.
    pub fn is_reverse(&self) -> bool {
        !self.fields.is_empty() || self.sensors.len() > 1
    }

    /// Whether targets are rendered from values.
    pub fn rendered(&self) -> Option<&Rendered> {
        if let Target::Values(r) = &self.target { Some(r) } else { None }
    }

    /// What every sensor should see: read, or rendered from the target's values.
    pub fn targets(&self, health: &Health) -> Result<Targets> {
        let mut targets = vec![None; self.setup.scene.sensors.len()];
        match &self.target {
            Target::File(_) => {
                for (sensor, name) in &self.files {
                    let image = exr::read_rgb(Path::new(name)).map_err(|e| {
                        Error::usage(e.to_string(), "give an .exr with the channels R, G and B as --target")
                    })?;
                    let (crop, film) = (self.view_of(*sensor).crop, &self.setup.scene.sensors[*sensor]);
                    let pixels = loss::crop_of(&image, name, crop, [film.width, film.height])?;
                    targets[*sensor] = Some(RgbImage {
                        width: crop[2] - crop[0],
                        height: crop[3] - crop[1],
                        pixels: pixels.iter().map(|p| p.0.map(|x| x as f32)).collect(),
                    });
                }
            }
            Target::Values(Rendered { values, spp, seed }) => {
                let values: Vec<(&str, f64)> = values.iter().map(|(n, x)| (n.as_str(), *x)).collect();
                let member = self.family.at(&values)?;
                // A seed that no run has, unless the user wants it so.
                let seed = seed.unwrap_or(0x7461_7267_6574);
                for view in album::views(&member, self.view()) {
                    let o = view.picture(&member.scene, bare(spp).unwrap_or(TARGET_SPP), seed)?;
                    health.merge(&o.film.health);
                    targets[view.sensor] = Some(album::image(&o));
                }
            }
        }
        Ok(targets)
    }

    /// A target that was rendered is kept beside the fit.
    pub fn write_target(&self, folder: &Path, targets: &Targets) -> Result<()> {
        if self.rendered().is_none() {
            return Ok(());
        }
        for &sensor in &self.sensors {
            let Some(t) = &targets[sensor] else { continue };
            let name = match self.sensors.len() {
                1 => self.target_name.clone(),
                _ => format!("target_{}.exr", self.sensor_names[sensor]),
            };
            let mut file = ExrImage::new(t.width, t.height);
            file.push_rgb("", &t.pixels);
            exr::write(&folder.join(name), &file)?;
        }
        Ok(())
    }

    pub fn problem<'a>(&'a self, targets: &'a Targets) -> Result<Problem<'a>> {
        let fitted = targets[self.setup.sensor].as_ref();
        let fitted = fitted.ok_or_else(|| Error::Runtime("the fitted sensor has no target".into()))?;
        Ok(Problem {
            family: &self.family,
            view: self.view(),
            unknowns: &self.unknowns,
            target: fitted.pixels.iter().map(|p| Rgb(p.map(f64::from))).collect(),
            loss: self.loss,
            spp: self.spp,
            iterations: self.iterations,
            max_time: self.max_time,
            half_life: self.half_life,
            rule: self.rule,
        })
    }
}

/// The picture of every fitted sensor, where files are given.
fn picture_files(
    target: &Target,
    s: &Settings,
    base: &Path,
    sensors: &[usize],
    names: &[String],
    parts: &Parts<f64>,
) -> Result<Vec<(usize, String)>> {
    let Target::File(one) = target else { return Ok(Vec::new()) };
    if !one.is_empty() {
        return match sensors {
            [only] => Ok(vec![(*only, one.clone())]),
            _ => Err(Error::usage(
                format!("one picture ({one}) for {} sensors", sensors.len()),
                "write targets = { ID = \"ID.exr\", ... } in the fit.toml: a picture for each sensor",
            )),
        };
    }
    let mut files = Vec::new();
    for (name, file) in &s.targets {
        files.push((find_sensor(Some(name), parts)?, base.join(file).display().to_string()));
    }
    match sensors.iter().find(|s| !files.iter().any(|f| f.0 == **s)) {
        None => Ok(files),
        Some(&lost) => {
            let what = format!("targets: there is no picture for the sensor `{}`", names[lost]);
            Err(Error::usage(
                what,
                format!("add {} = \"FILE.exr\" to `targets`, or leave it out of `sensors`", names[lost]),
            ))
        }
    }
}

fn has(setup: &Setup, name: &str) -> bool {
    setup.desc.params.iter().any(|p| p.name == name)
}

/// Bounds from options, the fit.toml, or the scene's hint, in this order.
fn unknown(name: &str, setup: &Setup, s: &Settings, args: &FitArgs) -> Result<Unknown> {
    let option = args.bounds.iter().rev().find(|b| b.0 == name).map(|b| b.1);
    let file = s.bounds.get(name).map(|b| *b.get_ref());
    if arrays::is_voxels(name) {
        return field(name, option.or(file), option.is_some(), s, args);
    }
    let hint = setup.desc.params[setup.desc.wrt(name)?].hint;
    let [min, max] = option.or(file).or(hint.min.zip(hint.max).map(|(a, b)| [a, b])).ok_or_else(|| {
        let remedy = format!(
            "give --bounds {name}=MIN,MAX, or [bounds] in the fit.toml, or `<?diff param=\"{name}\" min=\"\" max=\"\"?>` in the scene"
        );
        Error::usage(format!("`{name}` has no bounds"), remedy)
    })?;
    let rate = args.rate.or(s.rate.as_ref().and_then(|r| r.get_ref().of(name))).unwrap_or(RATE);
    Ok(Unknown { name: name.into(), min, max, rate })
}

/// Bounds of all voxels of an array: what no grid may hold is refused.
fn field(name: &str, bounds: Option<[f64; 2]>, by_option: bool, s: &Settings, args: &FitArgs) -> Result<Unknown> {
    let share = name.ends_with(".albedo.grid");
    let [min, max] = bounds.or(share.then_some([0.0, 1.0])).ok_or_else(|| {
        let remedy = format!("give --bounds {name}=0,MAX, or [bounds] \"{name}\" = [0, MAX] in the fit.toml");
        Error::usage(format!("`{name}` has no bounds"), remedy)
    })?;
    if min < 0.0 || share && max > 1.0 {
        let what = format!("bounds of `{name}`: voxels cannot be {}", if min < 0.0 { min } else { max });
        let remedy = if share { "give bounds between 0 and 1" } else { "give a lower bound of 0 or more" };
        return Err(match s.places.get(name) {
            Some(place) if !by_option => Error::scene(place, what, remedy),
            _ => Error::usage(format!("--bounds: {what}"), remedy),
        });
    }
    let rate = args.rate.or(s.rate.as_ref().and_then(|r| r.get_ref().of(name))).unwrap_or(RATE);
    Ok(Unknown { name: name.into(), min, max, rate })
}

/// The scene has to exist at both ends of the bounds, the others at their values: a fit may go there.
fn try_bounds(u: &Unknown, family: &Family, s: &Settings, args: &FitArgs) -> Result<()> {
    for x in [u.min, u.max] {
        let Err(e) = family.at(&[(&u.name, x)]) else { continue };
        let why = match e {
            Error::Scene { span, what, .. } => format!("{span}: {what}"),
            e => e.to_string(),
        };
        let what = format!("`{}` cannot be {x}: {why}", u.name);
        let remedy = "give bounds between which the scene can be rendered";
        return Err(if args.bounds.iter().any(|b| b.0 == u.name) {
            Error::usage(format!("--bounds: {what}"), remedy)
        } else if let Some(place) = s.places.get(&u.name) {
            Error::scene(place, format!("[bounds]: {what}"), remedy)
        } else {
            Error::usage(format!("bounds of the scene's <?diff?> hint: {what}"), remedy)
        });
    }
    Ok(())
}

/// Every start in full: what it does not name begins at the scene's value.
fn starts(unknowns: &[Unknown], setup: &Setup, s: &Settings, args: &FitArgs) -> Result<Vec<Vec<f64>>> {
    let file = s.start.iter().map(|t| t.iter().map(|(n, x)| (n.clone(), *x.get_ref())).collect());
    let mut given: Vec<Vec<(String, f64)>> = if args.start.is_empty() { file.collect() } else { args.start.clone() };
    if given.is_empty() {
        given.push(Vec::new());
    }
    let one = |start: &Vec<(String, f64)>| -> Result<Vec<f64>> {
        if let Some((name, _)) = start.iter().find(|(n, _)| !unknowns.iter().any(|u| u.name == *n)) {
            let remedy = suggest(name, unknowns.iter().map(|u| u.name.as_str()));
            return Err(Error::usage(format!("start: `{name}` is not among the parameters to find"), remedy));
        }
        let value = |u: &Unknown| {
            let own = start.iter().find(|(n, _)| *n == u.name).map(|p| p.1);
            let scene = setup.desc.params.iter().find(|p| p.name == u.name).map_or(f64::NAN, |p| p.value);
            let x = own.unwrap_or(scene);
            // A field begins with its file's values.
            if own.is_none() && arrays::is_voxels(&u.name) {
                return Ok(x);
            }
            if (u.min..=u.max).contains(&x) {
                return Ok(x);
            }
            let what = format!("start: `{}` = {x} lies outside its bounds {} to {}", u.name, u.min, u.max);
            Err(Error::usage(what, "give --start inside, or wider bounds"))
        };
        unknowns.iter().map(value).collect()
    };
    given.iter().map(one).collect()
}
