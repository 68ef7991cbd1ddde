//! Progress on stderr: how far, how fast, how noisy, how long still.

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
        let terminal = std::io::stderr().is_terminal();
        let kind = match kind {
            _ if log.quiet() => ProgressKind::None,
            ProgressKind::Auto if terminal => ProgressKind::Bar,
            ProgressKind::Auto => ProgressKind::Plain,
            kind => kind,
        };
        let bar = (kind == ProgressKind::Bar).then(|| {
            let bar = ProgressBar::new(BAR_STEPS);
            if let Ok(style) = ProgressStyle::with_template("{bar:30} {msg}") {
                bar.set_style(style);
            }
            bar
        });
        log.set_bar(bar.clone());
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
        self.log.set_bar(None);
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
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
