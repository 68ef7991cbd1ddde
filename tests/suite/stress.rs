//! The stability suite. Here a fast part of it with few paths; all of it with `make stress`, or
//! `cargo test --release --test suite stress:: -- --ignored --nocapture`.
//!
//! Each comparison of the suite allows 4 standard errors: a false-alarm rate of 6e-5; seeds are fixed.

use tyndall::study::{StressOptions, StressRow, Suite, Summary, Verdict, run};

/// Rows that are known not to be ok, by what the engine still lacks. They may become ok.
const OPEN: [(&str, &str, Verdict); 5] = [
    // The film's quantum rests on a pilot of 512 paths: what it misses may be too large.
    ("film-accumulation", "1 beside 1e-30", Verdict::Nan),
    // Samples that are not finite are counted, but not at their pixel.
    ("nan-policy", "", Verdict::Bias),
    // So near 1 an index changes what either way gets by 1/(n-1), and the two nearly cancel: single paths may still rule.
    ("ior-1.0001", "R_1:d_n", Verdict::Noise),
    ("ior-1.0001", "T_1:d_n", Verdict::Noise),
    ("white-furnace-glass", "n1.0001:d_n", Verdict::Noise),
];

fn rows(options: &StressOptions) -> (Vec<StressRow>, Summary) {
    let mut rows = Vec::new();
    println!("{}", StressRow::HEADER);
    let summary = run(options, &mut |r| {
        println!("{r}");
        rows.push(r.clone());
    });
    (rows, summary.unwrap_or_else(|e| panic!("{e}")))
}

fn open(r: &StressRow) -> bool {
    OPEN.iter().any(|(c, q, v)| *c == r.case && (q.is_empty() || *q == r.quantity) && *v == r.verdict)
}

/// A case with a fraction of its paths, untimed: every row ok, open or not yet due.
fn quick(case: &str, effort: f64) -> Vec<StressRow> {
    let (rows, _) = rows(&StressOptions { case: Some(case.into()), effort, threads: 2, ..Default::default() });
    let fine = |r: &&StressRow| matches!(r.verdict, Verdict::Ok | Verdict::NotYet) || open(r);
    let bad: Vec<String> = rows.iter().filter(|r| !fine(r)).map(|r| r.to_string()).collect();
    assert!(bad.is_empty(), "{}", bad.join("\n"));
    assert!(rows.iter().any(|r| r.verdict == Verdict::Ok));
    rows
}

macro_rules! quick {
    ($($test:ident: $case:literal, $effort:literal;)*) => {
        $(#[test]
        fn $test() {
            quick($case, $effort);
        })*
    };
}

quick! {
    thin_1e_6: "thin-1e-6", 0.1;
    thin_1e_3: "thin-1e-3", 0.1;
    vacuum_derivative: "vacuum-derivative", 0.1;
    black_1e5: "black-1e5", 0.1;
    thick_absorbing: "thick-absorbing-underflow", 0.1;
    g_minus_099: "g-minus-0.99", 0.1;
    airlight_1e_6: "airlight-h1e-6-s0-g0", 0.1;
    airlight_s10: "airlight-h1e-3-s10-g0.5", 0.1;
    light_on_ray: "light-on-ray", 0.1;
    shadow_edge: "shadow-edge-0", 0.1;
    index_of_a_lit_slab: "ior-1.5", 0.1;
    point_irradiance_near: "point-irradiance-s1-r1e-4", 0.1;
    point_irradiance_dark: "point-irradiance-s100-r1", 0.1;
    linear_density: "T-linear-density-00", 0.1;
    linear_density_dark: "T-linear-density-04", 0.1;
    exponential_density: "T-exponential-density-02", 0.1;
    grid_equals_homogeneous: "grid-equals-homogeneous", 0.05;
    grid_all_zero: "grid-all-zero", 0.1;
    grid_invalid_voxels: "grid-invalid-voxels", 0.1;
    camera_on_boundary: "camera-on-boundary", 0.05;
    thick_forward: "thick-forward-10", 0.5;
    ior_near_1: "ior-1.0001", 0.1;
    ior_high: "ior-2.4-conservative", 0.1;
    furnace_of_glass: "white-furnace-glass", 0.1;
    translation: "translation-invariance", 0.05;
    rng_endpoints: "rng-endpoints", 0.1;
    film_accumulation: "film-accumulation", 0.1;
    nan_policy: "nan-policy", 0.1;
    thread_determinism: "thread-determinism", 0.1;
    g_endpoints: "g-endpoints", 0.1;
    invalid_input: "invalid-input", 0.1;
    degenerate_geometry: "degenerate-geometry", 0.1;
}

#[test]
fn benign() {
    let rows = quick("benign", 0.1);
    assert_eq!(rows.len(), 8);
    // Even here an error of a tenth is seen in every number.
    assert!(rows.iter().all(|r| r.stderr > 0.0 && 4.0 * r.stderr < 0.1 * r.reference.abs()));
}

#[test]
fn unknown_cases_are_refused_and_missing_features_listed() {
    let nothing = StressOptions { case: Some("benihn".into()), ..Default::default() };
    let e = run(&nothing, &mut |_| {}).unwrap_err();
    assert!(e.to_string().contains("did you mean `benign`"), "{e}");
    let rows = quick_any("degenerate-geometry");
    let missing: Vec<&StressRow> = rows.iter().filter(|r| r.verdict == Verdict::NotYet).collect();
    assert!(rows.len() > missing.len() && !missing.is_empty());
    let json = serde_json::to_value(missing[0]).unwrap();
    assert!(json["value"].is_null() && json["verdict"] == "not-yet" && json["case"] == "degenerate-geometry");
    // The gradient by voxels of an empty grid is exact.
    assert!(quick_any("grid-all-zero").iter().all(|r| r.verdict == Verdict::Ok));
}

/// Media that glow, in closed form: a slab without any variance, and a dense ball whose light ends within 1e-7 of its outline, where only paths of their own look.
#[test]
fn what_glows_is_known() {
    let slab = quick_any("emissive-slab");
    assert_eq!(slab.len(), 20);
    assert!(slab.iter().all(|r| r.verdict == Verdict::Ok && r.relvar < 1e-20), "{slab:?}");
    let ball = quick_any("emissive-sphere-1e3");
    assert!(ball.len() == 3 && ball.iter().all(|r| r.verdict == Verdict::Ok), "{ball:?}");
}

fn quick_any(case: &str) -> Vec<StressRow> {
    rows(&StressOptions { case: Some(case.into()), effort: 0.1, threads: 2, ..Default::default() }).0
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
