//! `tyndall fit` in reverse mode: fields of voxels, several views, states that can be resumed. What it writes: `history.csv`, `loss.svg`, `fit.json`, `views.png`, and of every
//! run its state, its fields and its turntable.

use super::fit::FitArgs;
use super::fit_problem::Prepared;
use super::format;
use super::log::Log;
use super::progress::Study;
use super::run::{find_sensor, to_json};
use serde_json::{Map, Value, json};
use std::path::Path;
use std::time::Instant;
use tyndall::error::{Error, Result};
use tyndall::image::output;
use tyndall::inverse::album::Targets;
use tyndall::inverse::reverse::{Problem, Recovered, Step, fit};
use tyndall::inverse::settings::{Settings, bare};
use tyndall::inverse::{turntable, views};
use tyndall::math::Rgb;
use tyndall::native::vdb;
use tyndall::render::family::{Member, View};
use tyndall::render::health::Health;
use tyndall::render::plot::{Plot, Series};
use tyndall::scene::parts::Parts;

/// Samples a pixel at which what was found is compared with the targets.
const LOOK_SPP: u64 = 256;
const TURNTABLE_FRAMES: usize = 36;
const TURNTABLE_SPP: u64 = 64;

/// A run that is over.
struct Done {
    seed: u64,
    start: Vec<Option<f64>>,
    result: Recovered,
    seen: Vec<views::Seen>,
    /// Root mean square of the difference to the scene's own field, and of that field, where targets were rendered from it.
    errors: Vec<Option<[f64; 2]>>,
}

pub fn run(
    args: &FitArgs,
    p: &Prepared,
    s: &Settings,
    targets: &Targets,
    folder: &Path,
    health: &Health,
    log: &Log,
) -> Result<u8> {
    let fitted: Vec<(View, Vec<Rgb>)> = p.sensors.iter().map(|&i| fitted(p, i, targets)).collect::<Result<_>>()?;
    let subset = bare(&s.views).unwrap_or(fitted.len()).min(fitted.len());
    let refine: &[usize] = s.refine.as_ref().map_or(&[], |r| r.get_ref());
    let way = s.turntable.as_ref().map(|t| way(p, t.get_ref())).transpose()?;
    let variation = bare(&s.total_variation).unwrap_or(0.0);
    let pixels: Vec<Vec<u64>> =
        fitted.iter().map(|v| v.1.iter().flat_map(|x| x.0).map(f64::to_bits).collect()).collect();
    let identity = format!(
        "{:016x} {:?} {:?} {:?} {:?} {} {} {:?} {:?} {:?} {subset} {refine:?} {variation:?} {pixels:?}",
        p.setup.desc.hash,
        p.unknowns,
        p.fields,
        p.sensors,
        p.loss,
        p.spp,
        p.half_life,
        p.rule,
        p.terms,
        args.study.crop
    );
    let problem = Problem {
        family: &p.family,
        views: &fitted,
        subset,
        scalars: &p.unknowns,
        fields: &p.fields,
        loss: p.loss,
        spp: p.spp,
        iterations: p.iterations,
        max_time: p.max_time,
        half_life: p.half_life,
        rule: p.rule,
        refine,
        total_variation: variation,
        identity,
    };
    let all: Vec<(View, String, bool)> =
        (0..p.sensor_names.len()).map(|i| (p.view_of(i), p.sensor_names[i].clone(), p.sensors.contains(&i))).collect();
    let runs = p.starts.len() * p.seeds.len();
    let several = runs > 1;
    let mut study = Study::new(log, args.study.progress);
    let mut done: Vec<Done> = Vec::new();
    'runs: for start in &p.starts {
        for &seed in &p.seeds {
            let tail = if several { format!("_{}", done.len() + 1) } else { String::new() };
            let start: Vec<Option<f64>> = start.iter().map(|x| Some(*x).filter(|x| !x.is_nan())).collect();
            let place = folder.join(format!("state{tail}.bin"));
            if args.resume && done.is_empty() && !place.exists() {
                return Err(Error::usage(
                    format!("--resume: {} does not exist", place.display()),
                    "name the folder that the fit was begun in, with its number of starts and seeds, or leave out --resume",
                ));
            }
            let saved = if args.resume && place.exists() { Some(read(&place)?) } else { None };
            let (number, mut kept) = (done.len() + 1, Instant::now());
            let mut tell = |i: usize, step: &Step| {
                study.say(
                    (number as f64 - 1.0 + i as f64 / p.iterations as f64) / runs as f64,
                    line(number, i, step, p),
                );
                let late = kept.elapsed() >= args.checkpoint_every;
                if late {
                    kept = Instant::now();
                }
                late
            };
            let mut keep = |bytes: Vec<u8>| output::write_bytes(&place, &bytes);
            let result = fit(&problem, &start, seed, saved.as_deref(), health, &mut tell, &mut keep)?;
            let values: Vec<(&str, f64)> =
                p.unknowns.iter().map(|u| u.name.as_str()).zip(result.scalars.iter().copied()).collect();
            let mut member = p.family.at(&values)?;
            let errors = errors(p, &member, &result)?;
            dress(&result, &mut member)?;
            for (f, v) in p.fields.iter().zip(&result.fields) {
                let grid = member.scene.stand_in(&member.desc, v)?;
                let name = f.name.trim_end_matches(".grid");
                vdb::write(&folder.join(format!("{name}{tail}.vdb")), &[grid])?;
            }
            // A signal ends the comparison, not what comes after it.
            let compare = || {
                if p.setup.stop.exit_code().is_some() {
                    return Err(Error::Interrupted);
                }
                log.info(format!("run {number}: comparing {} views at {LOOK_SPP} samples", all.len()));
                let seen = views::look(&member.scene, &all, targets, LOOK_SPP, seed)?;
                views::write(&folder.join(format!("views{tail}.png")), &seen, &all, targets)?;
                if let Some((view, way)) = way.as_ref().filter(|_| args.frames > 0) {
                    let truth: Option<Vec<(&str, f64)>> =
                        p.rendered().map(|r| r.values.iter().map(|(n, x)| (n.as_str(), *x)).collect());
                    let path = folder.join(format!("turntable{tail}.png"));
                    let dress = |m: &mut Member| dress(&result, m);
                    turntable::write(&path, &p.family, &values, *view, way, &dress, truth.as_deref())?;
                }
                Ok(seen)
            };
            let seen = match compare() {
                Err(Error::Interrupted) => Vec::new(),
                seen => seen?,
            };
            let stopped = p.setup.stop.exit_code().is_some();
            done.push(Done { seed, start, result, seen, errors });
            // What is done is kept, whatever comes.
            history(&folder.join("history.csv"), p, &done)?;
            if stopped {
                break 'runs;
            }
        }
    }
    drop(study);
    plot(&folder.join("loss.svg"), &done)?;
    let report = report(p, &problem, &done, health);
    let text = to_json(&report)?;
    output::write_bytes(&folder.join("fit.json"), format!("{text}\n").as_bytes())?;
    if let Some(code) = p.setup.stop.exit_code() {
        log.warn(format!("stopped by a signal: what is there is in {}; go on with --resume", folder.display()));
        return Ok(code);
    }
    if log.json {
        log.result(text)?;
    } else {
        log.summary(format!("{}\nwrote {}", table(p, &done), folder.display()))?;
    }
    let iterations: u64 = done.iter().map(|d| d.result.state.history.len() as u64).sum();
    let pixels = fitted.iter().map(|v| v.0.pixels() as u64).max().unwrap_or(0);
    health.check(iterations * 2 * p.spp * subset as u64 * pixels, args.study.health_limit)?;
    let open: Vec<String> = done
        .iter()
        .enumerate()
        .filter(|(_, d)| !d.result.converged)
        .map(|(i, d)| format!("run {} ({})", i + 1, d.result.reason))
        .collect();
    if open.is_empty() {
        return Ok(0);
    }
    Err(Error::Check {
        what: format!("not converged: {}", open.join(", ")),
        remedy: "look at history.csv and loss.svg; go on with --resume and more --iterations or --max-time, or begin anew with more --spp or another --rate".into(),
    })
}

fn fitted<'a>(p: &'a Prepared, sensor: usize, targets: &Targets) -> Result<(View<'a>, Vec<Rgb>)> {
    let target = targets[sensor].as_ref();
    let target =
        target.ok_or_else(|| Error::Runtime(format!("the sensor `{}` has no target", p.sensor_names[sensor])))?;
    Ok((p.view_of(sensor), target.pixels.iter().map(|x| Rgb(x.map(f64::from))).collect()))
}

/// The turntable's view and way.
fn way<'a>(p: &'a Prepared, t: &'a tyndall::inverse::settings::Turntable) -> Result<(View<'a>, turntable::Way<'a>)> {
    let desc = &p.setup.desc;
    desc.wrt(&t.parameter)?;
    let sensor = find_sensor(t.sensor.as_deref(), &Parts::read(desc, &desc.values::<f64>())?)?;
    let (frames, spp) = (t.frames.unwrap_or(TURNTABLE_FRAMES), t.spp.unwrap_or(TURNTABLE_SPP));
    let [from, to] = t.range;
    Ok((p.view_of(sensor), turntable::Way { parameter: &t.parameter, from, to, frames, spp }))
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|source| Error::Io { what: format!("reading {}", path.display()), source })
}

/// Put fields that were found into a scene.
fn dress(r: &Recovered, m: &mut Member) -> Result<()> {
    r.fields.iter().try_for_each(|v| m.scene.set_voxels(v))
}

/// Against the fields of the scene's own files.
fn errors(p: &Prepared, member: &Member, r: &Recovered) -> Result<Vec<Option<[f64; 2]>>> {
    let one = |(u, found): (&tyndall::inverse::fit::Unknown, &tyndall::scene::voxels::Voxels)| {
        let own = member.scene.voxels(&member.desc, &u.name)?.filter(|_| p.rendered().is_some());
        Ok(own.map(|own| {
            let n = own.field.active().count().max(1) as f64;
            let pairs = found.field.active().zip(own.field.active());
            let squares = pairs.fold([0.0, 0.0], |s, (a, b)| [s[0] + (a - b).powi(2), s[1] + b * b]);
            squares.map(|s| (s / n).sqrt())
        }))
    };
    p.fields.iter().zip(&r.fields).map(one).collect()
}

fn line(number: usize, iteration: usize, s: &Step, p: &Prepared) -> String {
    let (loss, error) = (format::number(s.loss), format::number(s.error));
    let values: Vec<String> = s.scalars.iter().map(|&x| format::number(x)).collect();
    let lattice = if p.fields.is_empty() { String::new() } else { format!(", every {} voxels", s.spacing) };
    format!("run {number} iteration {iteration}: loss {loss} +- {error}{lattice} {}", values.join(" "))
        .trim_end()
        .into()
}

/// One line an iteration of every run.
fn history(path: &Path, p: &Prepared, done: &[Done]) -> Result<()> {
    let mut text = String::from("run,seed,iteration,seconds,loss,loss_error,total_variation,spacing");
    p.unknowns.iter().for_each(|u| text += &format!(",{}", u.name));
    p.unknowns.iter().chain(&p.fields).for_each(|u| text += &format!(",gradient_{}", u.name));
    text.push('\n');
    for (i, d) in done.iter().enumerate() {
        for (k, s) in d.result.state.history.iter().enumerate() {
            let Step { seconds, loss, error, variation, spacing, .. } = s;
            text += &format!("{},{},{k},{seconds:.3},{loss:e},{error:e},{variation:e},{spacing}", i + 1, d.seed);
            // In units of the parameters, as in forward mode; of a field the norm over its nodes.
            let extents = p.unknowns.iter().chain(&p.fields).map(tyndall::inverse::fit::Unknown::extent);
            let gradient = s.gradient.iter().zip(extents).map(|(g, e)| g / e);
            s.scalars.iter().copied().chain(gradient).for_each(|x| text += &format!(",{x:e}"));
            text.push('\n');
        }
    }
    output::write_bytes(path, text.as_bytes())
}

fn plot(path: &Path, done: &[Done]) -> Result<()> {
    let series = |(i, d): (usize, &Done)| Series {
        name: format!("run {}, seed {}", i + 1, d.seed),
        points: d.result.state.history.iter().enumerate().map(|(k, s)| (k as f64, s.loss)).collect(),
    };
    let mut plot = Plot::lines("loss", "iteration", "loss", done.iter().enumerate().map(series).collect());
    plot.log_y = true;
    plot.write(path)
}

fn report(p: &Prepared, problem: &Problem, done: &[Done], health: &Health) -> Value {
    let named = |names: &[tyndall::inverse::fit::Unknown], v: Vec<Value>| -> Map<String, Value> {
        names.iter().map(|u| u.name.clone()).zip(v).collect()
    };
    let run = |d: &Done| {
        let r = &d.result;
        let scalars: Vec<Value> = r.scalars.iter().map(|x| json!(x)).collect();
        let field = |(v, e): (&tyndall::scene::voxels::Voxels, &Option<[f64; 2]>)| {
            json!({ "voxels": v.field.len(), "channels": v.field.channels(),
                "rms_error_to_truth": e.map(|e| e[0]), "rms_truth": e.map(|e| e[1]) })
        };
        json!({
            "seed": d.seed, "start": d.start, "values": named(&p.unknowns, scalars),
            "fields": named(&p.fields, r.fields.iter().zip(&d.errors).map(field).collect()),
            "converged": r.converged, "reason": r.reason, "iterations": r.state.history.len(), "seconds": r.seconds,
            "loss": r.loss, "views": d.seen, "look_spp": LOOK_SPP,
        })
    };
    json!({
        "tool": "tyndall fit", "version": env!("TYNDALL_VERSION"), "command": std::env::args().collect::<Vec<_>>(),
        "scene": p.setup.desc.path.display().to_string(), "scene_hash": format!("{:016x}", p.setup.desc.hash),
        "target": p.target_name, "loss": p.loss, "bias": p.loss.bias(), "spp": p.spp, "max_iterations": p.iterations, "terms": p.terms,
        "sensors": p.sensors.iter().map(|&i| &p.sensor_names[i]).collect::<Vec<_>>(), "views": problem.subset,
        "refine": problem.refine, "total_variation": problem.total_variation,
        "window": p.rule.window, "tolerance": p.rule.tolerance, "unknowns": p.unknowns, "fields": p.fields,
        "converged": done.iter().all(|d| d.result.converged), "runs": done.iter().map(run).collect::<Vec<_>>(),
        "peak_memory_bytes": tyndall::render::report::peak_memory_bytes(), "health": health,
    })
}

/// One row a run, and one a view.
fn table(p: &Prepared, done: &[Done]) -> String {
    let text = |v: &[&str]| -> Vec<String> { v.iter().map(|s| s.to_string()).collect() };
    let mut head = text(&["run", "seed", "end", "iterations", "time", "loss"]);
    head.extend(p.unknowns.iter().map(|u| u.name.clone()));
    let mut rows = vec![head];
    for (i, d) in done.iter().enumerate() {
        let r = &d.result;
        let mut row = vec![(i + 1).to_string(), d.seed.to_string(), r.reason.into(), r.state.history.len().to_string()];
        row.extend([format::time(r.seconds), format::number(r.loss)]);
        row.extend(r.scalars.iter().map(|x| format!("{x:.5}")));
        rows.push(row);
    }
    let mut views = vec![text(&["run", "view", "seen by the fit", "PSNR / dB"])];
    for (i, d) in done.iter().enumerate() {
        for v in d.seen.iter().filter(|v| v.psnr.is_some()) {
            let psnr = v.psnr.map_or(String::new(), |x| format!("{x:.2}"));
            let fitted = if v.fitted { "yes" } else { "no" };
            views.push(vec![(i + 1).to_string(), v.sensor.clone(), fitted.into(), psnr]);
        }
    }
    format!("{}\n\n{}", format::table(&rows), format::table(&views))
}
