// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What vehicles run today, behind a C interface: built and called by native_peers.py.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#if defined(WITH_PCL) && __has_include(<pcl/filters/statistical_outlier_removal.h>)
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/kdtree/kdtree_flann.h>

static pcl::PointCloud<pcl::PointXYZ>::Ptr cloud_of(const float* xyz, int64_t count) {
    pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>(count, 1));
    for (int64_t i = 0; i < count; ++i)
        (*cloud)[i] = pcl::PointXYZ(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
    return cloud;
}

extern "C" void pcl_sor(const float* xyz, int64_t count, int k, double deviations,
                        uint8_t* rejected) {
    pcl::StatisticalOutlierRemoval<pcl::PointXYZ> filter(true);
    filter.setInputCloud(cloud_of(xyz, count));
    filter.setMeanK(k);
    filter.setStddevMulThresh(deviations);
    pcl::Indices kept;
    filter.filter(kept);
    for (int i : *filter.getRemovedIndices())
        rejected[i] = 1;
}

// Charron et al. 2018: too few others within a radius that grows with the range.
extern "C" void pcl_dror(const float* xyz, int64_t count, int others, double radius, double factor,
                         uint8_t* rejected) {
    const auto cloud = cloud_of(xyz, count);
    pcl::KdTreeFLANN<pcl::PointXYZ> tree(false);
    tree.setInputCloud(cloud);
    pcl::Indices near;
    std::vector<float> squares;
    for (int64_t i = 0; i < count; ++i) {
        const pcl::PointXYZ& p = (*cloud)[i];
        const double range = std::sqrt(double(p.x) * p.x + double(p.y) * p.y + double(p.z) * p.z);
        const double reach = std::max(radius, factor * range);
        rejected[i] = tree.radiusSearch(p, reach, near, squares, others + 1) <= others;
    }
}
#endif

// Autoware's ring filter, with its defaults: a ring is cut where the range jumps by 3 % or the
// azimuth by 1 degree; a piece is kept if it has more than 4 points or is 0.1 m long. Unlike
// Autoware, it judges the last point of a ring. Azimuth and range are fields of Autoware's clouds.
extern "C" void ring_filter(const float* xyz, const float* azimuth, const float* range,
                            const uint16_t* ring, int64_t count, uint8_t* rejected) {
    std::vector<std::vector<int64_t>> rings;
    for (int64_t i = 0; i < count; ++i) {
        if (ring[i] >= rings.size())
            rings.resize(ring[i] + 1);
        rings[ring[i]].push_back(i);
    }
    for (const auto& line : rings) {
        for (size_t first = 0, last = 0; last < line.size(); ++last) {
            if (last + 1 < line.size()) {
                const int64_t i = line[last], j = line[last + 1];
                float turn = azimuth[j] - azimuth[i];
                if (turn < 0)
                    turn += 6.2831855f;
                const float near = std::min(range[i], range[j]), far = std::max(range[i], range[j]);
                if (far < near * 1.03f && turn < 0.017453292f)
                    continue;
            }
            const float *p = xyz + 3 * line[first], *q = xyz + 3 * line[last];
            const float x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
            const bool kept = last - first >= 4 || x * x + y * y + z * z >= 0.01f;
            for (; first <= last; ++first)
                rejected[line[first]] = !kept;
        }
    }
}
