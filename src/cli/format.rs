//! Numbers with units, and tables.

use std::time::Duration;

/// `850 ms`, `12.3 s`, `4 min 05 s`, `2 h 03 min`.
pub fn time(seconds: f64) -> String {
    let whole = seconds.round();
    if !seconds.is_finite() {
        "unknown".into()
    } else if seconds < 1.0 {
        format!("{:.0} ms", seconds * 1e3)
    } else if whole < 60.0 {
        format!("{seconds:.1} s")
    } else if whole < 3600.0 {
        format!("{} min {:02} s", (whole / 60.0).floor(), whole % 60.0)
    } else {
        format!("{} h {:02} min", (whole / 3600.0).floor(), ((whole % 3600.0) / 60.0).floor())
    }
}

pub fn duration(d: Duration) -> String {
    time(d.as_secs_f64())
}

/// With the prefixes k, M, G: `1.25 M`.
pub fn count(x: f64) -> String {
    let (scale, prefix) = match x.abs() {
        a if a >= 1e9 => (1e9, " G"),
        a if a >= 1e6 => (1e6, " M"),
        a if a >= 1e4 => (1e3, " k"),
        _ => return format!("{x:.0} "),
    };
    format!("{:.2}{prefix}", x / scale)
}

/// A share in per cent, three digits; `unknown` where it is not a number.
pub fn percent(x: f64) -> String {
    if x.is_finite() { format!("{} %", number(x * 100.0)) } else { "unknown".into() }
}

/// Three significant digits, without an exponent where that is readable.
pub fn number(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    let digits = x.abs().log10().floor();
    if !(-4.0..6.0).contains(&digits) {
        format!("{x:.2e}")
    } else {
        format!("{x:.*}", (2.0 - digits).max(0.0) as usize)
    }
}

pub fn bytes(n: u64) -> String {
    match n {
        0..1024 => format!("{n} B"),
        1024..1_048_576 => format!("{:.1} KiB", n as f64 / 1024.0),
        1_048_576..1_073_741_824 => format!("{:.1} MiB", n as f64 / 1_048_576.0),
        _ => format!("{:.2} GiB", n as f64 / 1_073_741_824.0),
    }
}

/// `1 warning`, `2 warnings`.
pub fn plural(n: usize, noun: &str) -> String {
    if n == 1 { format!("1 {noun}") } else { format!("{n} {noun}s") }
}

/// Rows in aligned columns; the last column is not padded.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells: Vec<String> = row.iter().zip(&widths).map(|(s, &w)| format!("{s:w$}")).collect();
        cells.join("  ").trim_end().to_string()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_units() {
        assert_eq!(time(0.0123), "12 ms");
        assert_eq!(time(59.96), "1 min 00 s");
        assert_eq!(time(3725.0), "1 h 02 min");
        assert_eq!(time(f64::NAN), "unknown");
        assert_eq!(count(1.25e6), "1.25 M");
        assert_eq!(count(12.0), "12 ");
        assert_eq!(percent(0.01234), "1.23 %");
        assert_eq!(number(123456.0), "123456");
        assert_eq!(number(1e-7), "1.00e-7");
        assert_eq!(bytes(1536), "1.5 KiB");
        assert_eq!(table(&[vec!["a".into(), "b".into()], vec!["ccc".into(), "d".into()]]), "a    b\nccc  d");
    }
}
