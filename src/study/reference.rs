//! The tables of `stability/`, from deterministic solvers: case list, slabs, closed forms.

use std::collections::HashMap;
use std::sync::OnceLock;

/// A row of `stress_cases.csv`.
#[derive(Clone, Debug)]
pub struct CaseInfo {
    pub name: String,
    pub core: bool,
    /// Case of `slab_values.csv`, empty where there is none.
    pub reference: String,
    /// Names of the quantities expected, as `R_1` or `R_1:d_tau`.
    pub expect: Vec<String>,
    /// Largest time per path over the benign case.
    pub time_bound: Option<f64>,
}

/// A number with its error.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    pub value: f64,
    pub error: f64,
}

impl Known {
    pub fn exact(value: f64) -> Self {
        Known { value, error: 0.0 }
    }
}

/// A row of `closed_forms.csv`.
#[derive(Clone, Debug)]
pub struct ClosedForm {
    pub id: String,
    params: HashMap<String, f64>,
    pub value: f64,
    pub rel_err: f64,
    derivatives: HashMap<String, f64>,
}

impl ClosedForm {
    /// A parameter of the case; NaN where there is none of this name.
    pub fn param(&self, name: &str) -> f64 {
        self.params.get(name).copied().unwrap_or(f64::NAN)
    }

    pub fn known(&self) -> Known {
        Known { value: self.value, error: self.rel_err * self.value.abs() }
    }

    pub fn derivative(&self, name: &str) -> Known {
        let value = self.derivatives.get(name).copied().unwrap_or(f64::NAN);
        Known { value, error: 1e-10 * value.abs() }
    }
}

/// Fields of a CSV line; quotes are doubled inside quoted fields.
fn fields(line: &str) -> Vec<String> {
    let (mut out, mut field, mut quoted) = (Vec::new(), String::new(), false);
    let mut chars = line.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '"' if quoted && chars.peek() == Some(&'"') => {
                chars.next();
                field.push('"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => out.push(std::mem::take(&mut field)),
            _ => field.push(c),
        }
    }
    out.push(field);
    out
}

fn number(s: &str) -> f64 {
    s.trim().parse().unwrap_or(f64::NAN)
}

pub fn cases() -> &'static [CaseInfo] {
    static CASES: OnceLock<Vec<CaseInfo>> = OnceLock::new();
    CASES.get_or_init(|| {
        let text = include_str!("../../stability/stress_cases.csv");
        let listed = text.lines().skip(1).filter(|l| !l.is_empty()).map(|l| case(&fields(l)));
        // More than the list has: every airlight row of the closed forms, and the derivatives of thick slabs that lose nothing.
        let more = |name: &str, core, reference: &str, expect: &[&str]| CaseInfo {
            name: name.into(),
            core,
            reference: reference.into(),
            expect: expect.iter().map(|q| q.to_string()).collect(),
            time_bound: None,
        };
        let thick = ["R_1:d_tau", "R_1:d_albedo", "R_1:d_g", "T_1:d_tau", "T_1:d_albedo", "T_1:d_g"];
        let more = [
            more("airlight-table", false, "", &[]),
            more("thick-forward-10", true, "slab_t10_a1_g0.9_n1", &thick),
            more("thick-forward-100", true, "slab_t100_a1_g0.9_n1", &["R_1:d_albedo", "T_1:d_albedo"]),
        ];
        listed.chain(more).collect()
    })
}

fn case(f: &[String]) -> CaseInfo {
    let bound = |s: &str| s.trim_start_matches("<=").split('x').next().map(number).filter(|x| x.is_finite());
    let expect = f[5].split(';').filter_map(|e| Some(e.split_once('=')?.0.trim().to_string())).collect();
    CaseInfo { name: f[0].clone(), core: f[1] == "core", reference: f[3].clone(), expect, time_bound: bound(&f[9]) }
}

/// `quantity` as `R_1`, or `R_1:d_tau` with `d_tau`, `d_albedo`, `d_g`, `d_n`.
pub fn slab(case: &str, quantity: &str) -> Option<Known> {
    static ROWS: OnceLock<HashMap<(String, String), Vec<f64>>> = OnceLock::new();
    let rows = ROWS.get_or_init(|| {
        let text = include_str!("../../stability/slab_values.csv");
        let row = |l: &str| {
            let f = fields(l);
            ((f[0].clone(), f[5].clone()), f[6..16].iter().map(|x| number(x)).collect())
        };
        text.lines().skip(1).filter(|l| !l.is_empty()).map(row).collect()
    });
    let (name, derivative) = quantity.split_once(':').unwrap_or((quantity, ""));
    let row = rows.get(&(case.to_string(), name.to_string()))?;
    let at = match derivative {
        "" => 0,
        "d_tau" => 2,
        "d_albedo" => 4,
        "d_g" => 6,
        "d_n" => 8,
        _ => return None,
    };
    Some(Known { value: row[at], error: row[at + 1] })
}

pub fn closed_forms() -> &'static [ClosedForm] {
    static ROWS: OnceLock<Vec<ClosedForm>> = OnceLock::new();
    ROWS.get_or_init(|| {
        let text = include_str!("../../stability/closed_forms.csv");
        text.lines().skip(1).filter(|l| !l.is_empty()).map(|l| closed_form(&fields(l))).collect()
    })
}

fn closed_form(f: &[String]) -> ClosedForm {
    // Values are numbers in strings: {"a": "1e-6"}.
    let map = |s: &str| -> HashMap<String, f64> {
        let texts: HashMap<String, String> = serde_json::from_str(s).unwrap_or_default();
        texts.into_iter().map(|(k, v)| (k, number(&v))).collect()
    };
    ClosedForm {
        id: f[0].clone(),
        params: map(&f[2]),
        value: number(&f[3]),
        rel_err: number(&f[4]),
        derivatives: map(&f[5]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_read() {
        assert_eq!(cases().len(), 64 + 3);
        let benign = &cases()[0];
        assert_eq!((benign.name.as_str(), benign.core, benign.time_bound), ("benign", true, Some(1.5)));
        assert_eq!(benign.expect.len(), 8);
        let d = slab("slab_t1_a0.9_g0_n1", "R_1:d_tau").unwrap();
        assert!((d.value - 0.15019072).abs() < 1e-8 && d.error < 1e-13);
        assert!(slab("slab_t1_a0.9_g0_n1", "R_7").is_none());
        let t = closed_forms().iter().find(|c| c.id == "T_linear_density_04").unwrap();
        assert_eq!((t.param("b"), t.derivative("L").value), (-1000.0, 0.0));
        // Every table number that a slab case expects exists.
        for c in cases().iter().filter(|c| c.reference.starts_with("slab_")) {
            for q in &c.expect {
                assert!(slab(&c.reference, q).is_some_and(|k| k.value.is_finite()), "{} {q}", c.name);
            }
        }
    }
}
