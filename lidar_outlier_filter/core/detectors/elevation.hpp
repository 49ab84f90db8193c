// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Differences of elevations, see elevation.py.
#pragma once

#include "../kernels/array_view.hpp"

namespace lidar {

// Writes M, the mean elevation of the neighbours less the own one, of a range of points.
void elevation_differences(View<const double> elevation, Rows<const std::int32_t> index,
                           Index begin, Index end, View<double> result);
// The same of the points `which`, whose neighbours are near[offsets[i]:offsets[i + 1]].
void elevation_differences_of_lists(View<const double> elevation, View<const Index> which,
                                    View<const Index> offsets, View<const std::int32_t> near,
                                    View<double> result);

}  // namespace lidar
