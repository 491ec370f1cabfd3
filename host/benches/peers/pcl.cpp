// PCL: files, voxel grid, radius search, normals. usage: pcl DIR RADIUS
#include "bench.h"
#include <cmath>
#include <pcl/features/normal_3d.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>
#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/search/kdtree.h>

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

// Mean angle between the normals of points on the plates, clear of groove and edges, and z.
static double plate_error_deg(const Cloud& cloud, const pcl::PointCloud<pcl::Normal>& normals) {
    double sum = 0, count = 0;
    for (size_t i = 0; i < cloud.size(); i++) {
        const double y = std::abs(cloud[i].y);
        if (y < 20 || y >= 95) continue;
        const auto& n = normals[i];
        sum += std::atan2(std::hypot(n.normal_x, n.normal_y), std::abs(n.normal_z)) * 180 / M_PI;
        count++;
    }
    return sum / count;
}

int main(int, char** argv) {
    const std::string dir = argv[1];
    const double radius = std::stod(argv[2]);
    Cloud::Ptr cloud(new Cloud);
    auto size = [&] { return number("points", cloud->size()); };
    stage("PCL", "load ply", [&] { pcl::io::loadPLYFile(dir + "/butt.ply", *cloud); }, size);
    stage("PCL", "load pcd", [&] { pcl::io::loadPCDFile(dir + "/butt.pcd", *cloud); }, size);
    Cloud thin;
    Cloud::Ptr cornered(new Cloud);
    for (const auto& p : points(dir + "/cornered.f32")) cornered->emplace_back(p[0], p[1], p[2]);
    auto voxels = [&] {
        pcl::VoxelGrid<pcl::PointXYZ> grid;
        grid.setInputCloud(cornered);
        grid.setLeafSize(1, 1, 1);
        grid.filter(thin);
    };
    stage("PCL", "voxel grid", voxels, [&] {
        double z = 0;
        for (const auto& p : thin) z += p.z;
        return "{\"voxels\":" + std::to_string(thin.size()) + ",\"mean_z_mm\":" + std::to_string(z / thin.size()) + "}";
    });
    stage("PCL", "index", [&] { pcl::KdTreeFLANN<pcl::PointXYZ> tree; tree.setInputCloud(cloud); }, [] { return "null"; });
    pcl::KdTreeFLANN<pcl::PointXYZ> tree(false);
    tree.setInputCloud(cloud);
    size_t found = 0;
    auto search = [&] {
        found = 0;
        pcl::Indices near;
        std::vector<float> squared;
        for (const auto& q : *cloud) found += tree.radiusSearch(q, radius, near, squared);
    };
    stage("PCL", "radius neighbours", search, [&] { return number("neighbours", double(found) / cloud->size()); });
    pcl::PointCloud<pcl::Normal> normals;
    auto fit = [&] {
        pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
        estimation.setInputCloud(cloud);
        estimation.setSearchMethod(pcl::search::KdTree<pcl::PointXYZ>::Ptr(new pcl::search::KdTree<pcl::PointXYZ>(false)));
        estimation.setRadiusSearch(radius);
        estimation.compute(normals);
    };
    stage("PCL", "normals", fit, [&] { return number("plate_error_deg", plate_error_deg(*cloud, normals)); });
}
