// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The normal equations of (14) in Leslar (2010), summed and solved: see normal_equations.py.
//
// Formulas: with u the time from the tested point, in shots, and w the weight of another point of
// its window, s_i = Σ w uⁱ (i to 4), N_ij = s_(i+j), and, for each coordinate, b_i = Σ w uⁱ d
// (i to 2), d the coordinate of the other less that of the tested one. With c the first row of
// adj N and w_k the weight of the tested point, the statistic (17), but for a σ that is common to
// the line, is -(c · b) ÷ (det N √(1/w_k + c_0 ÷ det N)).
// Naive twin: predict() in test/naive/alpha_beta_gamma.py.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "alpha_beta_gamma.hpp"

namespace lidar {
namespace LEVEL {
namespace {

constexpr int TILE = 128;           // points at once: their sums stay in the first-level cache
constexpr int SUMS = 14;            // of a window: 5 powers of time, 3 of them times x, y and z
constexpr double SINGULAR = 1e-10;  // det N below this part of its diagonal's product: NaN
constexpr double NONE = std::numeric_limits<double>::quiet_NaN();

enum Column { T, X, Y, Z, WEIGHT, RATE, COLUMNS };
enum Window { CENTRED, BEFORE, AFTER, WINDOWS };

struct Cofactors {
    double c0, c1, c2;             // the first row of adj N
    double determinant, diagonal;  // det N, and the product of N's diagonal
};

template <int ORDER>
[[gnu::always_inline]] inline Cofactors cofactors(double s0, double s1, double s2, double s3,
                                                  double s4) {
    if constexpr (ORDER == 2) {
        const double c0 = s2 * s4 - s3 * s3, c1 = s2 * s3 - s1 * s4, c2 = s1 * s3 - s2 * s2;
        return {c0, c1, c2, s0 * c0 + s1 * c1 + s2 * c2, s0 * s2 * s4};
    }
    return {s2, -s1, 0.0, s0 * s2 - s1 * s1, s0 * s2};
}

// Sums of a tile of points: s0 to s4, x0 to x2, y0 to y2, z0 to z2.
struct alignas(64) Tile {
    double sums[SUMS][TILE];
};

struct alignas(64) Powers {  // weight times powers of time, of two fellows of each point
    double u[3][TILE], v[3][TILE];
};

// Columns from a point on.
struct Place {
    const double* column[COLUMNS];
};

Place place_at(const View<const double, 2>& columns, Index at) {
    Place place{};
    for (int i = 0; i < COLUMNS; ++i) {
        place.column[i] = columns.row(i) + at;
    }
    return place;
}

template <int ORDER>
void add_powers(const Place& here, const Place& a, const Place& b, Powers& __restrict powers,
                Tile& __restrict tile) {
    const double *t = here.column[T], *rate = here.column[RATE];
    const double *t_a = a.column[T], *t_b = b.column[T];
    const double *weight_a = a.column[WEIGHT], *weight_b = b.column[WEIGHT];
    for (int p = 0; p < TILE; ++p) {
        const double u = (t_a[p] - t[p]) * rate[p], v = (t_b[p] - t[p]) * rate[p];
        const double u0 = weight_a[p], v0 = weight_b[p];
        const double u1 = u0 * u, v1 = v0 * v;
        const double u2 = u1 * u, v2 = v1 * v;
        tile.sums[0][p] += u0 + v0;
        tile.sums[1][p] += u1 + v1;
        tile.sums[2][p] += u2 + v2;
        powers.u[0][p] = u0, powers.v[0][p] = v0;
        powers.u[1][p] = u1, powers.v[1][p] = v1;
        powers.u[2][p] = u2, powers.v[2][p] = v2;
        if constexpr (ORDER == 2) {
            const double u3 = u2 * u, v3 = v2 * v;
            tile.sums[3][p] += u3 + v3;
            tile.sums[4][p] += u3 * u + v3 * v;
        }
    }
}

// Adds one coordinate, taken relative to the tested point so that large ones lose no digits.
template <int ORDER>
void add_axis(const double* here, const double* a, const double* b, const Powers& __restrict powers,
              double (*__restrict sums)[TILE]) {
    for (int p = 0; p < TILE; ++p) {
        const double d = a[p] - here[p], e = b[p] - here[p];
        sums[0][p] += powers.u[0][p] * d + powers.v[0][p] * e;
        sums[1][p] += powers.u[1][p] * d + powers.v[1][p] * e;
        if constexpr (ORDER == 2) {
            sums[2][p] += powers.u[2][p] * d + powers.v[2][p] * e;
        }
    }
}

// Adds to each point of the tile that begins `here` its fellows of those at a and b.
//
// Two at once, because loading and storing the sums costs more than the arithmetic.
template <int ORDER>
void add_pair(const View<const double, 2>& columns, Index here, Index a, Index b, Tile& tile) {
    const Place tested = place_at(columns, here), one = place_at(columns, a),
                other = place_at(columns, b);
    Powers powers;
    add_powers<ORDER>(tested, one, other, powers, tile);
    for (Index axis = 0; axis < 3; ++axis) {
        add_axis<ORDER>(tested.column[X + axis], one.column[X + axis], other.column[X + axis],
                        powers, tile.sums + 5 + 3 * axis);
    }
}

// Solves as solve() does, without branches, and writes the first `size` points from `base` on.
template <int ORDER>
void solve_tile(const Tile& tile, const double* __restrict weight, const View<double, 3>& result,
                Index window, Index base) {
    alignas(64) double solved[3][TILE];
    const auto& s = tile.sums;
    for (int p = 0; p < TILE; ++p) {
        const Cofactors c = cofactors<ORDER>(s[0][p], s[1][p], s[2][p], s[3][p], s[4][p]);
        double scale = 1 / (c.determinant * std::sqrt(1 / weight[p] + c.c0 / c.determinant));
        scale = c.determinant > SINGULAR * c.diagonal ? scale : NONE;
        solved[0][p] = -(c.c0 * s[5][p] + c.c1 * s[6][p] + c.c2 * s[7][p]) * scale;
        solved[1][p] = -(c.c0 * s[8][p] + c.c1 * s[9][p] + c.c2 * s[10][p]) * scale;
        solved[2][p] = -(c.c0 * s[11][p] + c.c1 * s[12][p] + c.c2 * s[13][p]) * scale;
    }
    const Index size = std::min<Index>(TILE, result.shape[2] - base);
    for (Index axis = 0; axis < 3; ++axis) {
        std::copy(solved[axis], solved[axis] + size, &result(window, axis, base));
    }
}

void add_tile(const Tile& __restrict more, Tile& __restrict tile) {
    for (int row = 0; row < SUMS; ++row) {
        for (int p = 0; p < TILE; ++p) {
            tile.sums[row][p] += more.sums[row][p];
        }
    }
}

template <int ORDER>
void predict_tiles(const View<const double, 2>& columns, Index pad, const Windows& windows,
                   const View<double, 3>& result) {
    const Index nowhere = columns.shape[1] - TILE;
    Tile sums, both;
    for (Index base = 0; base < result.shape[2]; base += TILE) {
        const Index here = pad + base;
        const double* const weight = columns.row(WEIGHT) + here;
        sums = {};
        for (Index j = 1; j <= windows.before; j += 2) {
            const Index second = j < windows.before ? here - j - 1 : nowhere;
            add_pair<ORDER>(columns, here, here - j, second, sums);
        }
        if (windows.either) {
            both = sums;
            if (windows.before >= windows.fewest) {
                solve_tile<ORDER>(sums, weight, result, BEFORE, base);
            }
            sums = {};
        }
        for (Index j = 1; j <= windows.after; j += 2) {
            const Index second = j < windows.after ? here + j + 1 : nowhere;
            add_pair<ORDER>(columns, here, here + j, second, sums);
        }
        if (windows.either) {
            add_tile(sums, both);
            if (windows.after >= windows.fewest) {
                solve_tile<ORDER>(sums, weight, result, AFTER, base);
            }
        }
        if (windows.before + windows.after >= windows.fewest) {
            // Where nobody asks for one side alone, all offsets are in one sum.
            solve_tile<ORDER>(windows.either ? both : sums, weight, result, CENTRED, base);
        }
    }
}

struct Walked {
    std::array<double, SUMS> sums{};
    Index next = -1, count = 0;  // the next point, and how many were summed
};

void add_to(Walked& total, const Walked& more) {
    for (std::size_t i = 0; i < SUMS; ++i) {
        total.sums[i] += more.sums[i];
    }
    total.count += more.count;
}

// Sums up to `reach` points from `start` on along the links.
Walked walk(const Place& at, Index k, Index start, const View<const Index>& link, Index reach) {
    Walked walked;
    auto& s = walked.sums;
    const double here = at.column[T][k], rate = at.column[RATE][k];
    const double x = at.column[X][k], y = at.column[Y][k], z = at.column[Z][k];
    Index i = start;
    while (walked.count < reach && leads(i, link.size())) {
        const double u = (at.column[T][i] - here) * rate;
        const double w0 = at.column[WEIGHT][i];
        const double w1 = w0 * u;
        const double w2 = w1 * u;
        const double dx = at.column[X][i] - x, dy = at.column[Y][i] - y, dz = at.column[Z][i] - z;
        s[0] += w0;
        s[1] += w1;
        s[2] += w2;
        s[3] += w2 * u;
        s[4] += w2 * u * u;
        s[5] += w0 * dx;
        s[6] += w1 * dx;
        s[7] += w2 * dx;
        s[8] += w0 * dy;
        s[9] += w1 * dy;
        s[10] += w2 * dy;
        s[11] += w0 * dz;
        s[12] += w1 * dz;
        s[13] += w2 * dz;
        i = link[i];
        ++walked.count;
    }
    walked.next = i;
    return walked;
}

// Solves for the predicted position and writes (17); NaN for a window that cannot predict.
void solve(const Walked& walked, const Windows& windows, double weight,
           const View<double, 3>& result, Index window, Index slot) {
    const auto& s = walked.sums;
    const Cofactors c = windows.order == 2 ? cofactors<2>(s[0], s[1], s[2], s[3], s[4])
                                           : cofactors<1>(s[0], s[1], s[2], s[3], s[4]);
    const bool predicts = walked.count >= windows.fewest && c.determinant > SINGULAR * c.diagonal;
    const double scale = 1 / (c.determinant * std::sqrt(1 / weight + c.c0 / c.determinant));
    for (Index axis = 0; axis < 3; ++axis) {
        const double* const b = s.data() + 5 + 3 * axis;
        const double moved = -(c.c0 * b[0] + c.c1 * b[1] + c.c2 * b[2]) * scale;
        result(window, axis, slot) = predicts ? moved : NONE;
    }
}

void check_windows(const Windows& windows) {
    check(windows.before >= 0 && windows.after >= 0, "windows must not reach less than nowhere");
    check(windows.order == 1 || windows.order == 2, "the order must be 1 or 2");
}

}  // namespace

// Predicts every point as if segments had no ends; the caller does those near an end again.
//
// `columns` are a Series': (6, pad + whole tiles + pad + a tile of zeros); `result` is
// (3 windows, 3, N). Windows with too few points are left as they are.
void predict_in_tiles(View<const double, 2> columns, Index pad, const Windows& windows,
                      View<double, 3> result) {
    const Index points = result.shape[2], width = columns.shape[1];
    check(columns.size() == COLUMNS, "columns must be (6, M)");
    check(result.shape[0] == WINDOWS && result.shape[1] == 3, "result must be (3, 3, N)");
    check_windows(windows);
    check(windows.before <= pad && windows.after <= pad && pad <= width,
          "windows must not reach beyond the padding");
    const Index tiles = (points + TILE - 1) / TILE;
    check(tiles * TILE + TILE <= width - pad - std::min(pad, width - pad),
          "columns must hold whole tiles, padded, and one of zeros");
    const auto predict = windows.order == 2 ? predict_tiles<2> : predict_tiles<1>;
    predict(columns, pad, windows, result);
}

// Predicts the points `which` by following the links, and writes them at `slots` of (3, 3, M).
void predict_one_by_one(View<const double, 2> columns, Index pad, View<const Index> before,
                        View<const Index> after, View<const Index> which, View<const Index> slots,
                        const Windows& windows, View<double, 3> result) {
    check(columns.size() == COLUMNS, "columns must be (6, M)");
    check(0 <= pad && pad <= columns.shape[1] && before.size() <= columns.shape[1] - pad,
          "columns must hold all points");
    check(result.shape[0] == WINDOWS && result.shape[1] == 3, "result must be (3, 3, M)");
    check(which.size() == slots.size(), "there must be as many slots as points");
    check_windows(windows);
    check(before.size() == after.size(), "links must be as many as points");
    check_indices(which, before.size());
    check_indices(slots, result.shape[2]);
    const Place at = place_at(columns, pad);
    for (Index m = 0; m < which.size(); ++m) {
        const Index k = which[m], slot = slots[m];
        const double weight = at.column[WEIGHT][k];
        const Walked front = walk(at, k, before[k], before, windows.before);
        const Walked behind = walk(at, k, after[k], after, windows.after);
        Walked total = front;
        add_to(total, behind);
        // A window that overhangs an end of the segment is shifted inwards.
        if (front.count < windows.before) {
            add_to(total, walk(at, k, behind.next, after, windows.before - front.count));
        }
        if (behind.count < windows.after) {
            add_to(total, walk(at, k, front.next, before, windows.after - behind.count));
        }
        solve(total, windows, weight, result, CENTRED, slot);
        if (windows.either) {
            solve(front, windows, weight, result, BEFORE, slot);
            solve(behind, windows, weight, result, AFTER, slot);
        }
    }
}

}  // namespace LEVEL
}  // namespace lidar
