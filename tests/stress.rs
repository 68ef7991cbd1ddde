//! The stability suite. Here a fast part of it with few paths; all of it with `make stress`, or
//! `cargo test --release --test stress -- --ignored --nocapture`.
//!
//! Each comparison of the suite allows 4 standard errors: a false-alarm rate of 6e-5; seeds are fixed.

use tyndall::study::{StressOptions, StressRow, Suite, Summary, Verdict, run};

fn rows(options: &StressOptions) -> (Vec<StressRow>, Summary) {
    let mut rows = Vec::new();
    println!("{}", StressRow::HEADER);
    let summary = run(options, &mut |r| {
        println!("{r}");
        rows.push(r.clone());
    });
    (rows, summary.unwrap_or_else(|e| panic!("{e}")))
}

/// A case with a fraction of its paths, untimed: every row ok or not yet due.
fn quick(case: &str, effort: f64) -> Vec<StressRow> {
    let (rows, summary) = rows(&StressOptions { case: Some(case.into()), effort, threads: 2, ..Default::default() });
    let bad: Vec<String> =
        rows.iter().filter(|r| !matches!(r.verdict, Verdict::Ok | Verdict::NotYet)).map(|r| r.to_string()).collect();
    assert!(bad.is_empty() && summary.check().is_ok(), "{}", bad.join("\n"));
    assert!(!rows.is_empty());
    rows
}

#[test]
fn benign() {
    let rows = quick("benign", 0.1);
    assert_eq!(rows.len(), 8);
}

/// All rows, printed; fails if one is not ok. `STRESS_CASE` names one case, `STRESS_SUITE=all` adds the extended ones.
#[test]
#[ignore = "minutes: run by `make stress`"]
fn full_core_suite() {
    let suite = if std::env::var("STRESS_SUITE").is_ok_and(|s| s == "all") { Suite::All } else { Suite::Core };
    let case = std::env::var("STRESS_CASE").ok();
    let (_, summary) = rows(&StressOptions { case, suite, ..Default::default() });
    println!("{summary:?}");
    summary.check().unwrap_or_else(|e| panic!("{e}"));
}
