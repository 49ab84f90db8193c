// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Sectors of a turn, which a mask and the view of a sensor count by.
#pragma once

#include <cmath>

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"

namespace lidar {
namespace LEVEL {

// Returns the sector of an azimuth, which is given in sectors, of so many in a turn; 0 of NaN.
inline Index sector_of(double azimuth, Index sectors) {
    if (!(std::abs(azimuth) <= static_cast<double>(sectors))) {
        return 0;
    }
    const Index sector = static_cast<Index>(std::floor(azimuth)) % sectors;
    return sector < 0 ? sector + sectors : sector;
}

}  // namespace LEVEL

}  // namespace lidar
