// Writes types.vdb: small grids of every type that is read, two of one name, a level set. Values are functions of the index.
//   g++ -std=c++17 types.cpp -o types -lopenvdb -ltbb -lImath-3_1 && ./types types.vdb
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetSphere.h>

using namespace openvdb;

// (i + 2 j + 4 k) over [0, 10)^3, background 0; `f` makes the value of it.
template <class G, class F>
typename G::Ptr ramp(const char* name, F f) {
    auto g = G::create();
    auto a = g->getAccessor();
    for (int i = 0; i < 10; ++i)
        for (int j = 0; j < 10; ++j)
            for (int k = 0; k < 10; ++k) a.setValue(Coord(i, j, k), f(i + 2 * j + 4 * k));
    g->setName(name);
    return g;
}

int main(int, char** argv) {
    initialize();
    GridPtrVec grids;
    grids.push_back(ramp<FloatGrid>("density", [](int n) { return n / 64.0f; }));
    grids.push_back(ramp<FloatGrid>("density", [](int n) { return n / 32.0f; }));
    auto half = ramp<FloatGrid>("half", [](int n) { return n / 64.0f; });
    half->setSaveFloatAsHalf(true);
    grids.push_back(half);
    grids.push_back(ramp<DoubleGrid>("double", [](int n) { return n / 64.0; }));
    grids.push_back(ramp<Int32Grid>("int32", [](int n) { return n; }));
    grids.push_back(ramp<Int64Grid>("int64", [](int n) { return int64_t(n); }));
    grids.push_back(ramp<BoolGrid>("bool", [](int n) { return n % 3 == 0; }));
    grids.push_back(ramp<MaskGrid>("mask", [](int) { return true; }));
    auto color = [](int n) { return Vec3f(n, 64 - n / 2, 1) / 64.0f; };
    grids.push_back(ramp<Vec3SGrid>("color", color));
    grids.push_back(ramp<Vec3DGrid>("color_double", [&](int n) { return Vec3d(color(n)); }));
    // A tile, and a background that is not 0.
    auto tiles = FloatGrid::create(0.25f);
    tiles->setName("tiles");
    tiles->fill(CoordBBox(Coord(8, 0, 0), Coord(15, 15, 7)), 0.75f, true);
    tiles->tree().prune();
    grids.push_back(tiles);
    // Radius 8 voxels of 0.1, half band 2 voxels.
    auto set = tools::createLevelSetSphere<FloatGrid>(0.8f, Vec3f(0.5f, 0, 0), 0.1f, 2.0f);
    set->setName("surface");
    grids.push_back(set);
    io::File(argv[1]).write(grids);
}
