// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Points that are moved by poses, see poses.py. Twin: scipy's Slerp, in
// test/core/points/test_poses.py.

#include <algorithm>
#include <cmath>

#include "points.hpp"

namespace lidar {
namespace {

constexpr double TINY = 1e-9;  // radians between two poses that are as good as one

double square(double value) {
    return value * value;
}

// Interpolates between unit quaternions along the shorter arc (Shoemake 1985).
void slerp(const double* q0, const double* q1, double share, double* result) {
    double dot = 0.0;
    for (int j = 0; j < 4; ++j) {
        dot += q0[j] * q1[j];
    }
    const double sign = dot >= 0 ? 1.0 : -1.0;  // q and -q are one rotation
    double difference = 0.0, total = 0.0;
    for (int j = 0; j < 4; ++j) {
        difference += square(sign * q1[j] - q0[j]);
        total += square(sign * q1[j] + q0[j]);
    }
    const double angle = 2 * std::atan2(std::sqrt(difference), std::sqrt(total));
    double weight0 = 1 - share, weight1 = share;
    if (share > 0 && angle > TINY) {
        weight0 = std::sin(weight0 * angle);
        weight1 = std::sin(weight1 * angle);
    }
    double norm = 0.0;
    for (int j = 0; j < 4; ++j) {
        result[j] = weight0 * q0[j] + sign * weight1 * q1[j];
        norm += square(result[j]);
    }
    if (share > 0) {
        for (int j = 0; j < 4; ++j) {
            result[j] /= std::sqrt(norm);
        }
    }
}

// Turns v by a unit quaternion: v + 2 w (u × v) + 2 u × (u × v), u its vector and w its scalar.
void turn(const double* q, const double* v, double* result) {
    const double x = 2 * (q[1] * v[2] - q[2] * v[1]);
    const double y = 2 * (q[2] * v[0] - q[0] * v[2]);
    const double z = 2 * (q[0] * v[1] - q[1] * v[0]);
    result[0] = v[0] + q[3] * x + q[1] * z - q[2] * y;
    result[1] = v[1] + q[3] * y + q[2] * x - q[0] * z;
    result[2] = v[2] + q[3] * z + q[0] * y - q[1] * x;
}

}  // namespace

// Moves every covered point by the pose at its own time; others stay where they are.
//
// Poses are rows of x, y, z in metres and a unit quaternion x, y, z, w, at increasing times; none
// of the covered points is before the first. `mounted_at` and `mounted` are the position of the
// sensor and the matrix from its axes to the body's.
void move_points(View<const double, 2> xyz, View<const Index> t, View<const bool> covered,
                 View<const Index> times, View<const double, 2> poses,
                 View<const double> mounted_at, View<const double, 2> mounted,
                 View<double, 2> result) {
    const Index points = t.size(), count = times.size();
    check(xyz.size() == points && xyz.shape[1] == 3 && covered.size() == points,
          "xyz must be (N, 3), t and covered (N,)");
    check(result.shape == xyz.shape, "result must be (N, 3)");
    check(poses.size() == count && poses.shape[1] == 7, "poses must be (M, 7), times (M,)");
    check(mounted_at.size() == 3 && mounted.size() == 3 && mounted.shape[1] == 3,
          "mounted_at must be (3,), mounted (3, 3)");
    Index before = -1;
    for (Index i = 0; i < points; ++i) {
        const double* const p = xyz.row(i);
        double* const moved = result.row(i);
        if (!covered[i]) {
            std::copy(p, p + 3, moved);
            continue;
        }
        // Mostly it is between the same poses as the one before.
        if (before < 0 || t[i] < times[before] ||
            (before + 1 < count && t[i] >= times[before + 1])) {
            before = std::upper_bound(times.data, times.data + count, t[i]) - times.data - 1;
            check(before >= 0, "covered points must not be before the first pose");
        }
        // At a pose itself the share is 0: whether there is another behind it makes no difference.
        const Index after = std::min(before + 1, count - 1);
        const double share = after > before ? static_cast<double>(t[i] - times[before]) /
                                                  static_cast<double>(times[after] - times[before])
                                            : 0.0;
        const double* const one = poses.row(before);
        const double* const other = poses.row(after);
        double q[4], v[3];
        slerp(one + 3, other + 3, share, q);
        for (Index j = 0; j < 3; ++j) {
            v[j] = mounted_at[j] + mounted(j, 0) * p[0];
            v[j] += mounted(j, 1) * p[1];
            v[j] += mounted(j, 2) * p[2];
        }
        turn(q, v, moved);
        for (Index j = 0; j < 3; ++j) {
            moved[j] += one[j] + share * (other[j] - one[j]);
        }
    }
}

}  // namespace lidar
