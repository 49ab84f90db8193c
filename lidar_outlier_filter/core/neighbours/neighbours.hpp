// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What Python calls of this room.
#pragma once

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"

namespace lidar {

Owned<Index> numbers(View<const double, 2> xyz);

}  // namespace lidar
