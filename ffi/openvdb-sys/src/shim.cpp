// The C interface of shim.h over OpenVDB's C++.
//
// A file is read through an std::istream of our own whose every short read throws. `io::File` is not used: its stream
// does not throw (a cut uncompressed file reads silently short), and its delayed loading maps the file. Here nothing is
// ever mapped, so nothing is delayed.

#include "shim.h"

#include <openvdb/openvdb.h>
#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <cmath>
#include <cstring>
#include <exception>
#include <fstream>
#include <limits>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace vdb = openvdb;

namespace {

void say(char* err, size_t cap, const char* what) noexcept {
    if (!err || cap == 0) return;
    size_t n = 0;
    for (; what && what[n] != 0 && n + 1 < cap; ++n) {
        const unsigned char c = static_cast<unsigned char>(what[n]);
        err[n] = c < 0x20 || c == 0x7f ? ' ' : what[n];
    }
    err[n] = 0;
}

// Run `f`; turn whatever it throws into a message.
template <class F>
int guard(char* err, size_t cap, F&& f) noexcept {
    try {
        f();
        return 0;
    } catch (const std::ios_base::failure&) {
        say(err, cap, "the data ends early or cannot be read (cut or damaged file)");
    } catch (const std::bad_alloc&) {
        say(err, cap, "out of memory (very large grid, or damaged file)");
    } catch (const std::length_error&) {
        say(err, cap, "impossible size (damaged file)");
    } catch (const std::exception& e) {
        say(err, cap, e.what());
    } catch (...) {
        say(err, cap, "unknown exception");
    }
    return 1;
}

struct Failure : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// Call `f(const Grid&)` with the grid's true type. False if we do not carry that type.
template <class F>
bool visit(const vdb::GridBase& g, F&& f) {
    bool done = false;
    auto attempt = [&](auto* tag) {
        using G = std::remove_pointer_t<decltype(tag)>;
        if (!done && g.isType<G>()) {
            f(static_cast<const G&>(g));
            done = true;
        }
    };
    attempt(static_cast<vdb::FloatGrid*>(nullptr));
    attempt(static_cast<vdb::DoubleGrid*>(nullptr));
    attempt(static_cast<vdb::Int32Grid*>(nullptr));
    attempt(static_cast<vdb::Int64Grid*>(nullptr));
    attempt(static_cast<vdb::BoolGrid*>(nullptr));
    attempt(static_cast<vdb::MaskGrid*>(nullptr));
    attempt(static_cast<vdb::Vec3SGrid*>(nullptr));
    attempt(static_cast<vdb::Vec3DGrid*>(nullptr));
    attempt(static_cast<vdb::Vec3IGrid*>(nullptr));
    return done;
}

template <class T>
constexpr int channels_of() {
    return vdb::VecTraits<T>::IsVec ? 3 : 1;
}

template <class N, class T>
void spread(const T& v, N* out) {
    if constexpr (vdb::VecTraits<T>::IsVec) {
        for (int c = 0; c < 3; ++c) out[c] = static_cast<N>(v[c]);
    } else {
        out[0] = static_cast<N>(v);
    }
}

template <class T>
bool same(const T& a, const T& b) {
    if constexpr (vdb::VecTraits<T>::IsVec) {
        for (int c = 0; c < 3; ++c)
            if (!same(a[c], b[c])) return false;
        return true;
    } else {
        return a == b || (a != a && b != b);
    }
}

// Header and grids of one file, read step by step on a stream that throws.
class Reader : public vdb::io::Archive {
public:
    explicit Reader(const std::string& path) {
        mStream.open(path, std::ios_base::in | std::ios_base::binary);
        if (!mStream.is_open()) throw Failure("cannot be opened");
        mStream.exceptions(std::ios_base::failbit | std::ios_base::badbit);

        this->readHeader(mStream);
        mStreamMetadata.reset(new vdb::io::StreamMetadata);
        mStreamMetadata->setSeekable(true);
        vdb::io::setStreamMetadataPtr(mStream, mStreamMetadata, false);
        this->setFormatVersion(mStream);
        this->setLibraryVersion(mStream);
        this->setDataCompression(mStream);
        vdb::MetaMap file_metadata;
        file_metadata.readMeta(mStream);
        if (!this->inputHasGridOffsets()) throw Failure("written as a stream, without grid offsets: write it again as a file (vdb_clip, Houdini, pyopenvdb)");

        // Keep the descriptors in the file's order; a type unknown here is still a grid.
        const int32_t count = readGridCount(mStream);
        for (int32_t i = 0; i < count; ++i) {
            Entry e;
            try {
                e.empty = e.descriptor.read(mStream);
            } catch (const vdb::LookupError&) {
                // The positions have not been read yet.
                int64_t at[3];
                mStream.read(reinterpret_cast<char*>(at), sizeof at);
                e.descriptor.setGridPos(at[0]);
                e.descriptor.setBlockPos(at[1]);
                e.descriptor.setEndPos(at[2]);
            }
            e.name = e.descriptor.gridName();
            e.type = e.descriptor.gridType();
            mStream.seekg(e.descriptor.getEndPos());
            entries.push_back(std::move(e));
        }
    }

    struct Entry {
        vdb::io::GridDescriptor descriptor;
        vdb::GridBase::Ptr empty;  // null: type unknown to this OpenVDB
        std::string name, type, value_type, grid_class, creator, transform;
    };
    std::vector<Entry> entries;

    // Metadata, transform and tree; leaf values only `with_values`.
    vdb::GridBase::Ptr grid(size_t i, bool with_values) {
        Entry& e = entries.at(i);
        if (!e.empty) throw Failure("its type " + e.type + " is unknown to OpenVDB " + OPENVDB_LIBRARY_VERSION_STRING);
        vdb::GridBase::Ptr g = this->body(e, with_values);

        // A grid that shares another's tree takes it from there.
        if (e.descriptor.isInstance()) {
            const vdb::Name& parent = e.descriptor.instanceParentName();
            bool found = false;
            for (Entry& p : entries) {
                if (&p == &e || p.descriptor.isInstance() || p.descriptor.uniqueName() != parent) continue;
                if (p.type != e.type || !p.empty) throw Failure("it shares the tree of a grid of another type");
                g->setTree(this->body(p, with_values)->baseTreePtr());
                found = true;
                break;
            }
            if (!found) throw Failure("it shares the tree of a grid that is not in the file");
        }
        return g;
    }

private:
    vdb::GridBase::Ptr body(Entry& e, bool with_values) {
        mStream.clear();
        vdb::GridBase::Ptr g = e.empty->copyGridWithNewTree();
        g->setSaveFloatAsHalf(e.descriptor.saveFloatAsHalf());
        mStream.seekg(e.descriptor.getGridPos());
        bool loadable = false;
        visit(*g, [&](const auto&) { loadable = true; });
        if (with_values) {
            if (!loadable) throw Failure("its type " + e.type + " is not one of float, double, int32, int64, bool, mask, vec3");
            readGrid(g, e.descriptor, mStream);
            return g;
        }

        // Read in the same order as Archive::readGrid, and stop before the leaf values.
        readGridCompression(mStream);
        vdb::io::StreamMetadata::Ptr local(new vdb::io::StreamMetadata(*mStreamMetadata));
        local->setHalfFloat(g->saveFloatAsHalf());
        local->setCompression(vdb::io::getDataCompression(mStream));
        vdb::io::setStreamMetadataPtr(mStream, local, false);
        // The stream keeps the address of the pointer itself, not a copy of it.
        struct Restore {
            std::istream& is;
            vdb::io::StreamMetadata::Ptr& file_level;
            ~Restore() { vdb::io::setStreamMetadataPtr(is, file_level, false); }
        } restore{mStream, mStreamMetadata};
        vdb::io::setGridBackgroundValuePtr(mStream, nullptr);
        g->readMeta(mStream);
        vdb::io::setGridClass(mStream, g->getGridClass());
        g->readTransform(mStream);
        if (loadable && !e.descriptor.isInstance()) g->readTopology(mStream);
        return g;
    }

    vdb::io::StreamMetadata::Ptr mStreamMetadata;
    std::ifstream mStream;
};

void describe(Reader::Entry& e, const vdb::GridBase* g, tvdb_info& out) {
    out = tvdb_info{};
    const double nan = std::numeric_limits<double>::quiet_NaN();
    for (double& m : out.world_from_index) m = nan;
    for (int c = 0; c < 3; ++c) {
        out.lo[c] = 1;
        out.hi[c] = 0;
    }
    e.value_type = e.type;
    if (g) {
        e.value_type = g->valueType();
        e.grid_class = vdb::GridBase::gridClassToString(g->getGridClass());
        e.creator = g->getCreator();
        e.transform = g->transform().mapType();
        out.affine = g->transform().isLinear() ? 1 : 0;
        if (out.affine) {
            // OpenVDB multiplies row vectors: its rows are our columns.
            const vdb::Mat4R m = g->transform().baseMap()->getAffineMap()->getMat4();
            for (int i = 0; i < 16; ++i) out.world_from_index[i] = m[i / 4][i % 4];
        }
        out.stored_half = g->saveFloatAsHalf() ? 1 : 0;
        visit(*g, [&](const auto& t) {
            using G = std::decay_t<decltype(t)>;
            using V = typename G::ValueType;
            out.channels = channels_of<V>();
            spread(t.background(), out.background);
            const auto& tree = t.tree();
            out.leaves = tree.leafCount();
            out.active_voxels = tree.activeVoxelCount();
            out.memory = tree.memUsage();
            // Leaf buffers that were not read count as if they were.
            out.memory += uint64_t(tree.unallocatedLeafCount()) * G::TreeType::LeafNodeType::SIZE * sizeof(V);
            if (out.active_voxels > 0) {
                const vdb::CoordBBox box = t.evalActiveVoxelBoundingBox();
                for (int c = 0; c < 3; ++c) {
                    out.lo[c] = box.min()[c];
                    out.hi[c] = box.max()[c];
                }
            }
        });
    }
    out.name = e.name.c_str();
    out.type = e.type.c_str();
    out.value_type = e.value_type.c_str();
    out.grid_class = e.grid_class.c_str();
    out.creator = e.creator.c_str();
    out.transform = e.transform.c_str();
}

}  // namespace

struct tvdb_file {
    std::unique_ptr<Reader> reader;
};

struct tvdb_grid {
    struct Tile {
        int32_t origin[3];
        int32_t size;
        float value[3];
        int32_t active;
    };
    vdb::GridBase::Ptr grid;
    std::vector<const void*> leaves;
    std::vector<Tile> tiles;
    int channels = 0;
};

struct tvdb_mesh {
    std::vector<vdb::Vec3s> points;
    std::vector<vdb::Vec4I> quads;
};

struct tvdb_writer {
    vdb::GridPtrVec grids;
    // One of them, the last grid.
    vdb::FloatGrid::Ptr scalar;
    vdb::Vec3SGrid::Ptr vector;
};

namespace {

template <class G, class F>
void add_leaf(G& g, const int32_t* o, const uint64_t* active8, F value) {
    using Leaf = typename G::TreeType::LeafNodeType;
    auto leaf = std::make_unique<Leaf>(vdb::Coord(o[0], o[1], o[2]), g.background());
    for (vdb::Index v = 0; v < Leaf::SIZE; ++v) {
        leaf->setValueOnly(v, value(v));
        leaf->setActiveState(v, (active8[v >> 6] >> (v & 63)) & 1);
    }
    g.tree().addLeaf(leaf.release());
}

// List leaves and tiles in the tree's own order (root map, then x-major).
template <class G>
void index_nodes(const G& g, tvdb_grid& out) {
    using V = typename G::ValueType;
    out.channels = channels_of<V>();
    const auto& tree = g.tree();
    out.leaves.reserve(tree.leafCount());
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf) out.leaves.push_back(&*leaf);

    const V background = g.background();
    auto tile = tree.cbeginValueAll();
    tile.setMaxDepth(decltype(tile)::LEAF_DEPTH - 1);
    for (; tile; ++tile) {
        const bool active = tile.isValueOn();
        const V value = *tile;
        if (!active && same(value, background)) continue;
        tvdb_grid::Tile t{};
        const vdb::Coord at = tile.getCoord();
        for (int c = 0; c < 3; ++c) t.origin[c] = at[c];
        switch (tile.getLevel()) {
            case 1: t.size = 8; break;
            case 2: t.size = 128; break;
            default: t.size = 4096;
        }
        spread(value, t.value);
        t.active = active ? 1 : 0;
        out.tiles.push_back(t);
    }
}

}  // namespace

extern "C" {

const char* tvdb_version(void) { return OPENVDB_LIBRARY_VERSION_STRING; }

uint32_t tvdb_file_version(void) { return vdb::OPENVDB_FILE_VERSION; }

int tvdb_open(const char* path, tvdb_file** out, char* err, size_t cap) {
    return guard(err, cap, [&] {
        vdb::initialize();
        auto f = std::make_unique<tvdb_file>();
        f->reader = std::make_unique<Reader>(path);
        *out = f.release();
    });
}

void tvdb_close(tvdb_file* f) {
    guard(nullptr, 0, [&] { delete f; });
}

size_t tvdb_count(const tvdb_file* f) { return f->reader->entries.size(); }

const char* tvdb_name(const tvdb_file* f, size_t i) {
    return i < f->reader->entries.size() ? f->reader->entries[i].name.c_str() : "";
}

int tvdb_stats(tvdb_file* f, size_t i, tvdb_info* out, char* err, size_t cap) {
    return guard(err, cap, [&] {
        auto& e = f->reader->entries.at(i);
        const vdb::GridBase::Ptr g = e.empty ? f->reader->grid(i, false) : nullptr;
        describe(e, g.get(), *out);
    });
}

int tvdb_load(tvdb_file* f, size_t i, tvdb_grid** out, tvdb_info* info, char* err, size_t cap) {
    return guard(err, cap, [&] {
        auto g = std::make_unique<tvdb_grid>();
        g->grid = f->reader->grid(i, true);
        describe(f->reader->entries[i], g->grid.get(), *info);
        visit(*g->grid, [&](const auto& t) { index_nodes(t, *g); });
        *out = g.release();
    });
}

void tvdb_release(tvdb_grid* g) {
    guard(nullptr, 0, [&] { delete g; });
#ifdef __GLIBC__
    // Thousands of small blocks are free now: give their pages back, the bricks are about to be made.
    malloc_trim(0);
#endif
}

void tvdb_node_counts(const tvdb_grid* g, size_t* leaves, size_t* tiles) {
    *leaves = g->leaves.size();
    *tiles = g->tiles.size();
}

int tvdb_leaf(const tvdb_grid* g, size_t i, int32_t* origin3, uint64_t* active8, float* values, char* err, size_t cap) {
    return guard(err, cap, [&] {
        const void* at = g->leaves.at(i);
        visit(*g->grid, [&](const auto& t) {
            using G = std::decay_t<decltype(t)>;
            using Leaf = typename G::TreeType::LeafNodeType;
            using V = typename G::ValueType;
            static_assert(Leaf::SIZE == 512, "leaves of 8^3 voxels");
            const Leaf& leaf = *static_cast<const Leaf*>(at);
            for (int c = 0; c < 3; ++c) origin3[c] = leaf.origin()[c];
            for (int w = 0; w < 8; ++w) active8[w] = leaf.valueMask().template getWord<vdb::Index64>(w);
            for (vdb::Index v = 0; v < 512; ++v) spread(V(leaf.getValue(v)), values + size_t(v) * channels_of<V>());
        });
    });
}

int tvdb_tile(const tvdb_grid* g, size_t i, int32_t* origin3, int32_t* size, float* value3, int32_t* active, char* err, size_t cap) {
    return guard(err, cap, [&] {
        const tvdb_grid::Tile& t = g->tiles.at(i);
        std::memcpy(origin3, t.origin, sizeof t.origin);
        std::memcpy(value3, t.value, sizeof t.value);
        *size = t.size;
        *active = t.active;
    });
}

int tvdb_sample(const tvdb_grid* g, const double* xyz, size_t n, double* out, char* err, size_t cap) {
    return guard(err, cap, [&] {
        visit(*g->grid, [&](const auto& t) {
            using G = std::decay_t<decltype(t)>;
            using V = typename G::ValueType;
            if constexpr (std::is_same_v<V, bool>) {
                throw Failure("a grid of booleans has no trilinear sampler");
            } else {
                vdb::tools::GridSampler<G, vdb::tools::BoxSampler> sampler(t);
                for (size_t i = 0; i < n; ++i) {
                    const vdb::Vec3d p(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
                    spread(sampler.wsSample(p), out + i * channels_of<V>());
                }
            }
        });
    });
}

int tvdb_mesh_new(const tvdb_grid* g, double isovalue, tvdb_mesh** out, size_t* points, size_t* quads, char* err, size_t cap) {
    return guard(err, cap, [&] {
        auto mesh = std::make_unique<tvdb_mesh>();
        bool known = false;
        visit(*g->grid, [&](const auto& t) {
            using G = std::decay_t<decltype(t)>;
            if constexpr (std::is_floating_point_v<typename G::ValueType>) {
                // The tree is shared; in index space places are rounded to floats: a thousandth of a voxel at index 10^4.
                typename G::Ptr at_home = vdb::gridPtrCast<G>(g->grid)->copy();
                at_home->setTransform(vdb::math::Transform::createLinearTransform(1.0));
                vdb::tools::volumeToMesh(*at_home, mesh->points, mesh->quads, isovalue);
                known = true;
            }
        });
        if (!known) throw Failure("only grids of floats and doubles have surfaces");
        *points = mesh->points.size();
        *quads = mesh->quads.size();
        *out = mesh.release();
    });
}

void tvdb_mesh_read(const tvdb_mesh* m, float* xyz, uint32_t* quads4) {
    for (const vdb::Vec3s& p : m->points)
        for (int c = 0; c < 3; ++c) *xyz++ = p[c];
    for (const vdb::Vec4I& q : m->quads)
        for (int c = 0; c < 4; ++c) *quads4++ = q[c];
}

void tvdb_mesh_free(tvdb_mesh* m) {
    guard(nullptr, 0, [&] { delete m; });
}

int tvdb_writer_new(tvdb_writer** out, char* err, size_t cap) {
    return guard(err, cap, [&] {
        vdb::initialize();
        *out = new tvdb_writer;
    });
}

void tvdb_writer_free(tvdb_writer* w) {
    guard(nullptr, 0, [&] { delete w; });
}

int tvdb_writer_grid(tvdb_writer* w, const char* name, const char* grid_class, const double* m, int32_t channels, float background, int32_t half, char* err, size_t cap) {
    return guard(err, cap, [&] {
        w->scalar.reset();
        w->vector.reset();
        vdb::GridBase::Ptr g;
        if (channels == 1) {
            g = w->scalar = vdb::FloatGrid::create(background);
        } else {
            g = w->vector = vdb::Vec3SGrid::create(vdb::Vec3s(background));
        }
        g->setName(name);
        g->setCreator("tyndall");
        g->setGridClass(vdb::GridBase::stringToGridClass(grid_class));
        g->setSaveFloatAsHalf(half != 0);
        vdb::Mat4R rows;
        for (int i = 0; i < 16; ++i) rows[i / 4][i % 4] = m[i];
        g->setTransform(vdb::math::Transform::createLinearTransform(rows));
        w->grids.push_back(g);
    });
}

int tvdb_writer_leaf(tvdb_writer* w, const int32_t* o, const uint64_t* active8, const float* values, char* err, size_t cap) {
    return guard(err, cap, [&] {
        if (w->scalar) {
            add_leaf(*w->scalar, o, active8, [=](vdb::Index v) { return values[v]; });
        } else if (w->vector) {
            add_leaf(*w->vector, o, active8, [=](vdb::Index v) { return vdb::Vec3s(values + 3 * v); });
        } else {
            throw Failure("leaf without a grid");
        }
    });
}

int tvdb_writer_tile(tvdb_writer* w, const int32_t* o, int32_t size, const float* value3, int32_t active, char* err, size_t cap) {
    return guard(err, cap, [&] {
        const vdb::Index level = size == 8 ? 1 : size == 128 ? 2 : 3;
        const vdb::Coord at(o[0], o[1], o[2]);
        if (w->scalar) {
            w->scalar->tree().addTile(level, at, value3[0], active != 0);
        } else if (w->vector) {
            w->vector->tree().addTile(level, at, vdb::Vec3s(value3), active != 0);
        } else {
            throw Failure("tile without a grid");
        }
    });
}

int tvdb_writer_finish(tvdb_writer* w, const char* path, int32_t compression, char* err, size_t cap) {
    return guard(err, cap, [&] {
        // A stream of our own again: `io::File` does not tell when the disk is full.
        std::ofstream out(path, std::ios_base::out | std::ios_base::binary | std::ios_base::trunc);
        if (!out.is_open()) throw Failure("cannot be created");
        out.exceptions(std::ios_base::failbit | std::ios_base::badbit);
        struct Out : vdb::io::Archive {
            using vdb::io::Archive::write;
        } archive;
        if (compression == 1) archive.setCompression(vdb::io::COMPRESS_NONE);
        if (compression == 2) archive.setCompression(vdb::io::COMPRESS_ZIP | vdb::io::COMPRESS_ACTIVE_MASK);
        try {
            archive.write(out, w->grids, true);
            out.close();
        } catch (const std::ios_base::failure&) {
            throw Failure("cannot be written (disk full?)");
        }
    });
}
}
