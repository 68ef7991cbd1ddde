//! What fits leave behind in numbers and lines: `history.csv`, plots of the loss and of every parameter.

use super::fit::{Recovered, Unknown};
use crate::error::Result;
use crate::image::output;
use crate::render::plot::{Plot, Series};
use std::path::Path;

/// One line an iteration of every run: run (from 1), seed, iteration, seconds, loss, its standard error, values, gradients.
pub fn write_csv(path: &Path, unknowns: &[Unknown], runs: &[Recovered]) -> Result<()> {
    let mut text = String::from("run,seed,iteration,seconds,loss,loss_error");
    unknowns.iter().for_each(|u| text += &format!(",{}", u.name));
    unknowns.iter().for_each(|u| text += &format!(",gradient_{}", u.name));
    text.push('\n');
    for (i, run) in runs.iter().enumerate() {
        for s in &run.history {
            text += &format!("{},{},{},{:.3},{:e},{:e}", i + 1, run.seed, s.iteration, s.seconds, s.loss, s.error);
            s.values.iter().chain(&s.gradient).for_each(|x| text += &format!(",{x:e}"));
            text.push('\n');
        }
    }
    output::write_bytes(path, text.as_bytes())
}

/// `loss.svg` and `.png`, and the same of every parameter with its true value where that is known.
pub fn write_plots(folder: &Path, unknowns: &[Unknown], runs: &[Recovered], truth: &[Option<f64>]) -> Result<()> {
    let lines = |y: &dyn Fn(&super::fit::Step) -> f64| -> Vec<Series> {
        let series = |(i, run): (usize, &Recovered)| Series {
            name: format!("run {}, seed {}", i + 1, run.seed),
            points: run.history.iter().map(|s| (s.iteration as f64, y(s))).collect(),
        };
        runs.iter().enumerate().map(series).collect()
    };
    let mut loss = Plot::lines("loss", "iteration", "", lines(&|s| s.loss));
    // Unbiased estimates of a small loss fall below 0, too, and a logarithmic axis would hide them.
    loss.log_y = runs.iter().flat_map(|r| &r.history).all(|s| s.loss > 0.0);
    let write = |plot: &Plot, name: &str| {
        ["svg", "png"].iter().try_for_each(|kind| plot.write(&folder.join(format!("{name}.{kind}"))))
    };
    write(&loss, "loss")?;
    let last = runs.iter().map(|r| r.iterations.saturating_sub(1)).max().unwrap_or(0) as f64;
    for (k, u) in unknowns.iter().enumerate() {
        let mut series = lines(&|s| s.values[k]);
        series.extend(truth[k].map(|t| Series { name: "truth".into(), points: vec![(0.0, t), (last, t)] }));
        let plot = Plot::lines(u.name.as_str(), "iteration", "", series);
        write(&plot, &u.name)?;
    }
    Ok(())
}
