//! The work of a thread: a measure that is the same on every machine and in every run, so that choices may rest on it. It is in rays with what usually goes with
//! one: rays, nearest points, Newton solves by way of interfaces, and events that a sweep goes back over are counted, marches through grids and null interfaces are not.

use std::cell::Cell;

thread_local! {
    static ASKED: Cell<u64> = const { Cell::new(0) };
}

/// A nearest point among listed faces, in rays.
pub const NEAREST_LISTED: u64 = 2;
/// The same in a hierarchy.
pub const NEAREST: u64 = 6;

/// Adds to this thread's work.
pub fn note(rays: u64) {
    ASKED.with(|a| a.set(a.get().wrapping_add(rays)));
}

/// The work that `f` takes on this thread.
pub fn of<T>(f: impl FnOnce() -> T) -> (T, u64) {
    let asked = || ASKED.with(Cell::get);
    let before = asked();
    let x = f();
    (x, asked().wrapping_sub(before))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_what_was_noted_meanwhile() {
        note(2);
        let (x, work) = of(|| {
            note(1);
            of(|| note(NEAREST)).1
        });
        assert_eq!((x, work), (NEAREST, NEAREST + 1));
        assert_eq!(of(|| ()).1, 0);
    }
}
