//! Puts PNG files that tyndall wrote on one sheet: `montage OUT.png "TITLE=A.png,B.png" ...`, one argument a row; without TITLE the row stands right below the one before.
//! `make figures` uses it.

use tyndall::render::montage::{self, Row};

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let row = |text: &String| {
        let (title, files) = text.split_once('=')?;
        Some(Row { title: title.into(), files: files.split(',').map(Into::into).collect() })
    };
    let rows: Option<Vec<Row>> = args.iter().skip(1).map(row).collect();
    let (Some(out), Some(rows)) = (args.first(), rows.filter(|r| !r.is_empty())) else {
        eprintln!("usage: montage OUT.png \"TITLE=A.png,B.png\" ...");
        std::process::exit(2);
    };
    if let Err(e) = montage::write(out.as_ref(), &rows) {
        eprintln!("error: {e}");
        std::process::exit(e.exit_code() as i32);
    }
}
