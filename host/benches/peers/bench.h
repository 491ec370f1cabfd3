// What every C++ peer shares: the cloud, CPU time, and one JSON line per stage.
#pragma once
#include <array>
#include <cstdio>
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

// Runs `work` once to warm up and three times for the record (once where a run takes long); `check` is a JSON object.
inline void stage(const char* peer, const char* name, std::function<void()> work, std::function<std::string()> check) {
    double begin = cpu_ms();
    work();
    int runs = cpu_ms() - begin > 3000 ? 1 : 3;
    printf("{\"peer\":\"%s\",\"stage\":\"%s\",\"cpu_ms\":[", peer, name);
    for (int i = 0; i < runs; i++) {
        begin = cpu_ms();
        work();
        printf("%s%.3f", i ? "," : "", cpu_ms() - begin);
    }
    printf("],\"check\":%s}\n", check().c_str());
    fflush(stdout);
}

inline std::string number(const char* name, double value) {
    return std::string("{\"") + name + "\":" + std::to_string(value) + "}";
}
