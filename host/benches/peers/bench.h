// What every C++ peer shares: the cloud, CPU time, and one JSON line per stage.
#pragma once
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

using Points = std::vector<std::array<float, 3>>;

inline Points points(const std::string& path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    Points points(file.tellg() / sizeof(points[0]));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(points.data()), points.size() * sizeof(points[0]));
    return points;
}

inline double cpu_ms() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e3 * t.tv_sec + 1e-6 * t.tv_nsec;
}

// Runs `work` once to warm up and three times for the record, or only once where a run takes long; `check` is a JSON
// object. The stages named in the variable SKIP, separated by semicolons, are left out.
inline void stage(const char* peer, const char* name, std::function<void()> work, std::function<std::string()> check) {
    const char* skip = getenv("SKIP");
    if (skip && (";" + std::string(skip) + ";").find(";" + std::string(name) + ";") != std::string::npos) return;
    std::vector<double> took;
    do {
        const double begin = cpu_ms();
        work();
        took.push_back(cpu_ms() - begin);
    } while (took.size() < 4 && took[0] <= 1000);
    if (took.size() > 1) took.erase(took.begin());
    printf("{\"peer\":\"%s\",\"stage\":\"%s\",\"cpu_ms\":[", peer, name);
    for (size_t i = 0; i < took.size(); i++) printf("%s%.3f", i ? "," : "", took[i]);
    printf("],\"check\":%s}\n", check().c_str());
    fflush(stdout);
}

inline std::string number(const char* name, double value) {
    return std::string("{\"") + name + "\":" + (std::isfinite(value) ? std::to_string(value) : "null") + "}";
}
