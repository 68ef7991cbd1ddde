//! Declarations of `shim.h`, in its order: the narrow C interface over OpenVDB that `shim.cpp` compiles.
//!
//! Every function that takes `err` returns 0, or 1 with a zero-terminated message there. No C++ exception leaves the shim.

#![allow(non_camel_case_types)]

use std::ffi::{c_char, c_int};

macro_rules! opaque {
    ($($name:ident),*) => {$(
        #[repr(C)]
        pub struct $name {
            _data: [u8; 0],
            _not_send: std::marker::PhantomData<(*mut u8, std::marker::PhantomPinned)>,
        }
    )*};
}
opaque!(tvdb_file, tvdb_grid, tvdb_mesh, tvdb_writer);

/// Description of one grid; its strings live as long as the file handle.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct tvdb_info {
    pub name: *const c_char,
    pub type_: *const c_char,
    pub value_type: *const c_char,
    pub grid_class: *const c_char,
    pub creator: *const c_char,
    pub transform: *const c_char,
    pub world_from_index: [f64; 16],
    pub background: [f64; 3],
    pub active_voxels: u64,
    pub leaves: u64,
    pub memory: u64,
    pub lo: [i32; 3],
    pub hi: [i32; 3],
    pub channels: i32,
    pub stored_half: i32,
    pub affine: i32,
}

unsafe extern "C" {
    pub fn tvdb_version() -> *const c_char;
    pub fn tvdb_file_version() -> u32;

    pub fn tvdb_open(path: *const c_char, out: *mut *mut tvdb_file, err: *mut c_char, cap: usize) -> c_int;
    pub fn tvdb_close(file: *mut tvdb_file);
    pub fn tvdb_count(file: *const tvdb_file) -> usize;
    pub fn tvdb_name(file: *const tvdb_file, i: usize) -> *const c_char;
    pub fn tvdb_stats(file: *mut tvdb_file, i: usize, out: *mut tvdb_info, err: *mut c_char, cap: usize) -> c_int;

    pub fn tvdb_load(
        file: *mut tvdb_file,
        i: usize,
        out: *mut *mut tvdb_grid,
        info: *mut tvdb_info,
        err: *mut c_char,
        cap: usize,
    ) -> c_int;
    pub fn tvdb_release(grid: *mut tvdb_grid);
    pub fn tvdb_node_counts(grid: *const tvdb_grid, leaves: *mut usize, tiles: *mut usize);
    pub fn tvdb_leaf(
        grid: *const tvdb_grid,
        i: usize,
        origin3: *mut i32,
        active8: *mut u64,
        values: *mut f32,
        err: *mut c_char,
        cap: usize,
    ) -> c_int;
    pub fn tvdb_tile(
        grid: *const tvdb_grid,
        i: usize,
        origin3: *mut i32,
        size: *mut i32,
        value3: *mut f32,
        active: *mut i32,
        err: *mut c_char,
        cap: usize,
    ) -> c_int;
    pub fn tvdb_sample(
        grid: *const tvdb_grid,
        xyz: *const f64,
        n: usize,
        out: *mut f64,
        err: *mut c_char,
        cap: usize,
    ) -> c_int;

    pub fn tvdb_mesh_new(
        grid: *const tvdb_grid,
        isovalue: f64,
        out: *mut *mut tvdb_mesh,
        points: *mut usize,
        quads: *mut usize,
        err: *mut c_char,
        cap: usize,
    ) -> c_int;
    pub fn tvdb_mesh_read(mesh: *const tvdb_mesh, xyz: *mut f32, quads4: *mut u32);
    pub fn tvdb_mesh_free(mesh: *mut tvdb_mesh);

    pub fn tvdb_writer_new(out: *mut *mut tvdb_writer, err: *mut c_char, cap: usize) -> c_int;
    pub fn tvdb_writer_free(writer: *mut tvdb_writer);
    pub fn tvdb_writer_grid(
        writer: *mut tvdb_writer,
        name: *const c_char,
        grid_class: *const c_char,
        world_from_index16: *const f64,
        channels: i32,
        background: f32,
        half: i32,
        err: *mut c_char,
        cap: usize,
    ) -> c_int;
    pub fn tvdb_writer_leaf(
        writer: *mut tvdb_writer,
        origin3: *const i32,
        active8: *const u64,
        values512c: *const f32,
        err: *mut c_char,
        cap: usize,
    ) -> c_int;
    pub fn tvdb_writer_tile(
        writer: *mut tvdb_writer,
        origin3: *const i32,
        size: i32,
        value3: *const f32,
        active: i32,
        err: *mut c_char,
        cap: usize,
    ) -> c_int;
    pub fn tvdb_writer_finish(
        writer: *mut tvdb_writer,
        path: *const c_char,
        compression: i32,
        err: *mut c_char,
        cap: usize,
    ) -> c_int;
}
