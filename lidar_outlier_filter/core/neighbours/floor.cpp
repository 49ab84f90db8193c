// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The floor of a whole cloud, see floor.py.

#include "floor.hpp"

namespace lidar {

void check_floor(const Floor& around, Index points) {
    check(around.origin.size() == 2 && around.floor.shape[1] == 2 &&
              around.floor.size() == around.wide.size() && (around.wide.size() > 0 || points == 0),
          "a floor must have an origin (2,), and a row of floor for each of its columns");
}

}  // namespace lidar
