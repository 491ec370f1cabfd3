// CGAL: bilateral smoothing over the 30 nearest, normals given. By radius alone (k = 0), 5.5.1 makes every point not a number,
// since it guesses its width from k. usage: cgal DIR
#include "bench.h"
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/bilateral_smooth_point_set.h>
#include <CGAL/property_map.h>
#include <cmath>

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Oriented = std::pair<Kernel::Point_3, Kernel::Vector_3>;

int main(int, char** argv) {
    std::vector<Oriented> raw, smooth;
    for (const auto& p : points(std::string(argv[1]) + "/butt.f32"))
        raw.push_back({Kernel::Point_3(p[0], p[1], p[2]), Kernel::Vector_3(0, 0, 1)});
    auto filter = [&] {
        smooth = raw;
        CGAL::bilateral_smooth_point_set<CGAL::Sequential_tag>(
            smooth, 30,
            CGAL::parameters::point_map(CGAL::First_of_pair_property_map<Oriented>())
                .normal_map(CGAL::Second_of_pair_property_map<Oriented>())
                .sharpness_angle(25));
    };
    auto roughness = [&] {
        double sum = 0, count = 0;
        for (size_t i = 0; i < raw.size(); i++) {
            const double y = std::abs(raw[i].first.y());
            if (y < 20 || y >= 95) continue;
            sum += smooth[i].first.z() * smooth[i].first.z();
            count++;
        }
        return number("plate_rms_mm", std::sqrt(sum / count));
    };
    stage("CGAL", "bilateral", filter, roughness);
}
