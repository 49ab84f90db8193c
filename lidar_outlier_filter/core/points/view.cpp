// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Counts of points by the sectors and ranges of a view, see pipeline/visibility.py.

#include <cmath>

#include "azimuth.hpp"
#include "points.hpp"

namespace lidar {
namespace {

constexpr double CLEAR = 1e-9;  // radians from an edge, where rounding does not matter
constexpr double TURN = 2 * 3.141592653589793;

void check_tally(const ViewCells& cells, const ViewTally& tally) {
    const Index sectors = cells.edges.size() - 1, bands = cells.bands.size() + 1;
    const Index steps = cells.ends.size();
    check(sectors > 0 && cells.edges.shape[1] == 2, "edges must be (sectors + 1, 2)");
    check(steps > 0, "there must be steps");
    const std::array<Index, 2> shape{sectors, bands};
    check(tally.points.shape == shape && tally.rejected.shape == shape,
          "points and rejected must be (sectors, bands)");
    check(tally.kept.shape[1] == sectors, "kept must be (rings, sectors)");
    check(tally.steps.size() == sectors && tally.steps.shape[1] == steps,
          "steps must be (sectors, steps)");
}

}  // namespace

// Adds points to the counts of their sectors: all and rejected ones by band, kept ones by ring and
// by step of the range.
void count_view(View<const double, 2> xyz, View<const Index> line, View<const bool> rejected,
                const ViewCells& cells, const ViewTally& tally) {
    check(xyz.size() == line.size() && xyz.shape[1] == 3 && rejected.size() == line.size(),
          "xyz must be (N, 3), line and rejected (N,)");
    check_tally(cells, tally);
    const Index sectors = tally.points.size(), steps = cells.ends.size();
    Index sector = 0, step = 0;
    for (Index i = 0; i < line.size(); ++i) {
        const double x = xyz(i, 0), y = xyz(i, 1), z = xyz(i, 2);
        // Mostly it is clearly in the sector of the one before; an arctangent takes longer.
        const double clear = CLEAR * (std::abs(x) + std::abs(y));
        const double left = cells.edges(sector, 0) * y - cells.edges(sector, 1) * x;
        const double right = cells.edges(sector + 1, 1) * x - cells.edges(sector + 1, 0) * y;
        if (!(left > clear && right > clear)) {
            const double width = static_cast<double>(sectors) / TURN;
            sector = LEVEL::sector_of(std::atan2(y, x) * width, sectors);
        }
        const double square = x * x + y * y + z * z;
        Index band = 0;
        while (band < cells.bands.size() && square >= cells.bands[band]) {
            ++band;
        }
        tally.points(sector, band) += 1;
        if (rejected[i]) {
            tally.rejected(sector, band) += 1;
            continue;
        }
        if (0 <= line[i] && line[i] < tally.kept.size()) {
            tally.kept(line[i], sector) += 1;
        }
        while (step > 0 && square < cells.ends[step - 1]) {
            --step;
        }
        while (square >= cells.ends[step] && step < steps - 1) {
            ++step;
        }
        tally.steps(sector, step) += 1;
    }
}

}  // namespace lidar
