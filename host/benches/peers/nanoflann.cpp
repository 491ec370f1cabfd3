// nanoflann: index and radius search. usage: nanoflann DIR RADIUS
#include "bench.h"
#include <cmath>
#include <nanoflann.hpp>

struct Cloud {
    Points p;
    size_t kdtree_get_point_count() const { return p.size(); }
    float kdtree_get_pt(size_t i, size_t axis) const { return p[i][axis]; }
    template <class Box> bool kdtree_get_bbox(Box&) const { return false; }
};
using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Cloud>, Cloud, 3, uint32_t>;

int main(int, char** argv) {
    Cloud cloud{points(std::string(argv[1]) + "/butt.f32")};
    const float radius = std::stof(argv[2]);
    const nanoflann::KDTreeSingleIndexAdaptorParams leaf(10);
    stage("nanoflann", "index", [&] { Tree tree(3, cloud, leaf); tree.buildIndex(); }, [] { return "null"; });
    Tree tree(3, cloud, leaf);
    tree.buildIndex();
    size_t found = 0;
    auto search = [&] {
        found = 0;
        std::vector<std::pair<uint32_t, float>> near;
        nanoflann::SearchParams unsorted;
        unsorted.sorted = false;
        for (const auto& q : cloud.p) found += tree.radiusSearch(q.data(), radius * radius, near, unsorted);
    };
    stage("nanoflann", "radius neighbours", search, [&] { return number("neighbours", double(found) / cloud.p.size()); });
}
