// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Pseudo-random numbers of positions, by which typical.py and the trees choose samples.
#pragma once

#include <cstdint>
#include <cstring>

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"

namespace lidar {
namespace LEVEL {

// Returns a number from 0 to 2^32 that depends on the position of a point only (splitmix64).
inline Index number(const double* point) {
    std::uint64_t mixed = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double coordinate = point[axis] + 0.0;  // 0 and -0 are one place
        std::uint64_t bits = 0;
        std::memcpy(&bits, &coordinate, sizeof bits);
        mixed = (mixed ^ bits) + 0x9E3779B97F4A7C15U;
        mixed = (mixed ^ (mixed >> 30U)) * 0xBF58476D1CE4E5B9U;
        mixed = (mixed ^ (mixed >> 27U)) * 0x94D049BB133111EBU;
        mixed = mixed ^ (mixed >> 31U);
    }
    return static_cast<Index>(mixed >> 32U);
}

}  // namespace LEVEL
}  // namespace lidar
