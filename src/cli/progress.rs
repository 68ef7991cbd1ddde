//! Progress on stderr: of one run how far, how fast, how noisy, how long still; of a study, which is many runs, what it has found so far.

use super::format;
use super::log::Log;
use super::options::ProgressKind;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tyndall::render::driver::Progress;

const BAR_STEPS: u64 = 1000;
const BAR_PAUSE: Duration = Duration::from_millis(100);
const JSON_PAUSE: Duration = Duration::from_secs(1);
const PLAIN_PAUSE: Duration = Duration::from_secs(10);

/// What a run aims at: the time left follows from whichever comes first.
#[derive(Clone, Copy, Debug, Default)]
pub struct Goal {
    pub max_time: Option<Duration>,
    pub target_error: Option<f64>,
}

pub struct Display<'a> {
    log: &'a Log,
    kind: ProgressKind,
    goal: Goal,
    bar: Option<ProgressBar>,
    start: Instant,
    /// Milliseconds after `start` at which to speak next.
    next: AtomicU64,
}

impl<'a> Display<'a> {
    pub fn new(log: &'a Log, kind: ProgressKind, goal: Goal) -> Self {
        let kind = kind_for(log, kind);
        let bar = bar(log, kind, "{bar:30} {msg}");
        Display { log, kind, goal, bar, start: Instant::now(), next: AtomicU64::new(0) }
    }

    /// Called from worker threads after every tile: cheap unless it is time to speak.
    pub fn update(&self, p: Progress) {
        let pause = match self.kind {
            ProgressKind::None | ProgressKind::Auto => return,
            ProgressKind::Bar => BAR_PAUSE,
            ProgressKind::Json => JSON_PAUSE,
            ProgressKind::Plain => PLAIN_PAUSE,
        };
        let now = self.start.elapsed().as_millis() as u64;
        let next = self.next.load(Ordering::Relaxed);
        // A plain log of a short run stays empty.
        let early = self.kind == ProgressKind::Plain && now < pause.as_millis() as u64;
        let then = now + pause.as_millis() as u64;
        let turn = now >= next && !early;
        if turn && self.next.compare_exchange(next, then, Ordering::Relaxed, Ordering::Relaxed).is_ok() {
            self.show(&p);
        }
    }

    fn show(&self, p: &Progress) {
        let rate = p.samples as f64 / p.elapsed.as_secs_f64();
        // Past its goal a run still finishes the batches that it needs; how long that takes is not known.
        let left = Some(time_left(p, &self.goal)).filter(|&t| t > 0.0 || t.is_nan() || p.done >= 1.0);
        if self.kind == ProgressKind::Json {
            let finite = |x: f64| x.is_finite().then_some(x);
            self.log.info(serde_json::json!({
                "done": p.done,
                "elapsed_seconds": p.elapsed.as_secs_f64(),
                "samples": p.samples,
                "samples_per_second": finite(rate),
                "relative_error": finite(p.error),
                "seconds_left": left.and_then(finite),
            }));
            return;
        }
        let text = format!(
            "{:5.1} %  {}samples/s  error {}  {}",
            p.done * 100.0,
            format::count(rate),
            format::percent(p.error),
            left.map_or("finishing".into(), |t| format!("{} left", format::time(t)))
        );
        match &self.bar {
            Some(bar) => {
                bar.set_position((p.done * BAR_STEPS as f64) as u64);
                bar.set_message(text);
            }
            None => self.log.info(text),
        }
    }
}

impl Drop for Display<'_> {
    fn drop(&mut self) {
        clear(self.log, &self.bar);
    }
}

/// How a study goes on. Every line goes to the log file, and to stderr with `-v`.
pub struct Study<'a> {
    log: &'a Log,
    kind: ProgressKind,
    bar: Option<ProgressBar>,
    start: Instant,
    spoken: Instant,
}

impl<'a> Study<'a> {
    pub fn new(log: &'a Log, kind: ProgressKind) -> Self {
        let kind = kind_for(log, kind);
        let bar = bar(log, kind, "{bar:30} {elapsed} {msg}");
        // Between two findings minutes may pass.
        if let Some(bar) = &bar {
            bar.enable_steady_tick(JSON_PAUSE);
        }
        let now = Instant::now();
        Study { log, kind, bar, start: now, spoken: now }
    }

    pub fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// What has been found; `done`: the share used up of the time, or of the iterations, that the study may take at most.
    pub fn say(&mut self, done: f64, text: String) {
        let done = done.clamp(0.0, 1.0);
        if let Some(bar) = &self.bar {
            bar.set_position((done * BAR_STEPS as f64) as u64);
            bar.set_message(text.clone());
        }
        let pause = match self.kind {
            ProgressKind::Json => JSON_PAUSE,
            ProgressKind::Plain => PLAIN_PAUSE,
            _ => Duration::MAX,
        };
        if self.spoken.elapsed() < pause {
            return self.log.detail(text);
        }
        self.spoken = Instant::now();
        if self.kind == ProgressKind::Plain {
            return self.log.info(text);
        }
        let seconds = self.elapsed().as_secs_f64();
        self.log.info(serde_json::json!({ "done": done, "elapsed_seconds": seconds, "message": text }));
    }
}

impl Drop for Study<'_> {
    fn drop(&mut self) {
        clear(self.log, &self.bar);
    }
}

/// What `auto` is here.
fn kind_for(log: &Log, kind: ProgressKind) -> ProgressKind {
    match kind {
        _ if log.quiet() => ProgressKind::None,
        ProgressKind::Auto if std::io::stderr().is_terminal() => ProgressKind::Bar,
        ProgressKind::Auto => ProgressKind::Plain,
        kind => kind,
    }
}

/// A bar, where one is wanted; lines of the log go above it.
fn bar(log: &Log, kind: ProgressKind, template: &str) -> Option<ProgressBar> {
    let bar = (kind == ProgressKind::Bar).then(|| {
        let bar = ProgressBar::new(BAR_STEPS);
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar
    });
    log.set_bar(bar.clone());
    bar
}

fn clear(log: &Log, bar: &Option<ProgressBar>) {
    log.set_bar(None);
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
}

/// Seconds until the samples, the time or the error is reached; errors fall with the square root of time.
fn time_left(p: &Progress, goal: &Goal) -> f64 {
    let elapsed = p.elapsed.as_secs_f64();
    let mut left = if p.done > 0.0 { elapsed * (1.0 - p.done) / p.done } else { f64::NAN };
    if let Some(t) = goal.max_time {
        left = left.min((t.as_secs_f64() - elapsed).max(0.0));
    }
    if let Some(target) = goal.target_error.filter(|_| p.error.is_finite()) {
        left = left.min((elapsed * ((p.error / target).powi(2) - 1.0)).max(0.0));
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_goal_sets_the_time_left() {
        let p = Progress { done: 0.25, elapsed: Duration::from_secs(10), samples: 1, error: 0.02 };
        assert_eq!(time_left(&p, &Goal::default()), 30.0);
        assert_eq!(time_left(&p, &Goal { max_time: Some(Duration::from_secs(15)), target_error: None }), 5.0);
        let left = time_left(&p, &Goal { max_time: None, target_error: Some(0.01) });
        assert!((left - 30.0).abs() < 1e-9);
    }
}
