// C interface over OpenVDB: what `src/lib.rs` declares, in the same order.
//
// Every entry returns 0, or 1 with a message in `err` (at most `cap` bytes, zero included). No exception leaves.
// Handles are not thread-safe. Strings in `tvdb_info` live as long as the handle they came from.
#pragma once
#include <cstddef>
#include <cstdint>

extern "C" {

typedef struct tvdb_file tvdb_file;
typedef struct tvdb_grid tvdb_grid;
typedef struct tvdb_mesh tvdb_mesh;
typedef struct tvdb_writer tvdb_writer;

typedef struct {
    const char* name;
    const char* type;        // the file's name of the tree type
    const char* value_type;  // "float", "vec3s", ... ; the tree type where OpenVDB does not know it
    const char* grid_class;
    const char* creator;
    const char* transform;   // type of the map
    double world_from_index[16];  // columns; NaN if the map is not affine
    double background[3];
    uint64_t active_voxels;
    uint64_t leaves;
    uint64_t memory;
    int32_t lo[3], hi[3];    // box of active voxels, both ends within; lo > hi if there are none
    int32_t channels;        // 1 or 3; 0 if the type cannot be loaded
    int32_t stored_half;
    int32_t affine;
} tvdb_info;

const char* tvdb_version(void);
uint32_t tvdb_file_version(void);

int tvdb_open(const char* path, tvdb_file** out, char* err, size_t cap);
void tvdb_close(tvdb_file*);
size_t tvdb_count(const tvdb_file*);
// Name alone, without reading the grid.
const char* tvdb_name(const tvdb_file*, size_t i);
// Metadata, transform and topology, no leaf values.
int tvdb_stats(tvdb_file*, size_t i, tvdb_info* out, char* err, size_t cap);

// The grid with its values. It no longer needs the file.
int tvdb_load(tvdb_file*, size_t i, tvdb_grid** out, tvdb_info* info, char* err, size_t cap);
void tvdb_release(tvdb_grid*);
void tvdb_node_counts(const tvdb_grid*, size_t* leaves, size_t* tiles);
int tvdb_leaf(const tvdb_grid*, size_t i, int32_t* origin3, uint64_t* active8, float* values, char* err, size_t cap);
int tvdb_tile(const tvdb_grid*, size_t i, int32_t* origin3, int32_t* size, float* value3, int32_t* active, char* err, size_t cap);
// OpenVDB's own trilinear sampler at n world points; `out` has n * channels numbers.
int tvdb_sample(const tvdb_grid*, const double* xyz, size_t n, double* out, char* err, size_t cap);

// The surface on which a grid of floats or doubles has a value: points in index space, quadrilaterals.
int tvdb_mesh_new(const tvdb_grid*, double isovalue, tvdb_mesh** out, size_t* points, size_t* quads, char* err, size_t cap);
void tvdb_mesh_read(const tvdb_mesh*, float* xyz, uint32_t* quads4);
void tvdb_mesh_free(tvdb_mesh*);

int tvdb_writer_new(tvdb_writer** out, char* err, size_t cap);
void tvdb_writer_free(tvdb_writer*);
int tvdb_writer_grid(tvdb_writer*, const char* name, const char* grid_class, const double* world_from_index16, int32_t channels, float background, int32_t half, char* err, size_t cap);
int tvdb_writer_leaf(tvdb_writer*, const int32_t* origin3, const uint64_t* active8, const float* values512c, char* err, size_t cap);
int tvdb_writer_tile(tvdb_writer*, const int32_t* origin3, int32_t size, const float* value3, int32_t active, char* err, size_t cap);
// compression: 0 OpenVDB's default, 1 none, 2 zip
int tvdb_writer_finish(tvdb_writer*, const char* path, int32_t compression, char* err, size_t cap);
}
