// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays down onto a landscape, whose heights are at the corners of squares: see landscape.py.

#include <algorithm>
#include <cmath>

#include "kernels.hpp"

namespace lidar {
namespace {

constexpr double MARCH = 0.4;  // metres that a ray is followed before it is below something
constexpr int HALVINGS = 30;   // of the last step, to find where it was met

// Returns a position within a grid, in squares; 0 of no number.
double inside(double position, double last) {
    return std::min(std::max(0.0, position), last);
}

// Returns the height somewhere: between the four corners, or that of the nearest where owners
// differ.
double height_at(View<const double, 2> field, View<const Index, 2> owner, double cell, double x,
                 double y) {
    const double u = inside(x / cell, static_cast<double>(field.shape[0]) - 1.000001);
    const double v = inside(y / cell, static_cast<double>(field.shape[1]) - 1.000001);
    const auto i = static_cast<Index>(u), j = static_cast<Index>(v);
    const double a = u - static_cast<double>(i), b = v - static_cast<double>(j);
    const Index mine = owner(i, j);
    if (mine == owner(i + 1, j) && mine == owner(i, j + 1) && mine == owner(i + 1, j + 1)) {
        const double near = field(i, j) * (1.0 - b) + field(i, j + 1) * b;
        const double far = field(i + 1, j) * (1.0 - b) + field(i + 1, j + 1) * b;
        return near * (1.0 - a) + far * a;
    }
    return field(i + (a >= 0.5 ? 1 : 0), j + (b >= 0.5 ? 1 : 0));
}

// Returns the owner of the nearest corner.
Index owner_at(View<const Index, 2> owner, double cell, double x, double y) {
    const double i = inside(x / cell + 0.5, static_cast<double>(owner.shape[0]) - 1.0);
    const double j = inside(y / cell + 0.5, static_cast<double>(owner.shape[1]) - 1.0);
    return owner(static_cast<Index>(i), static_cast<Index>(j));
}

struct Ray {
    double o[3], d[3];

    double at(int axis, double far) const {
        return o[axis] + far * d[axis];
    }
};

// Returns how far a ray may go on without meeting anything: down to what is highest, or aside.
double free_way(View<const double, 2> highest, double side, const Ray& ray, double far) {
    const double x = ray.at(0, far), y = ray.at(1, far);
    const double last[] = {static_cast<double>(highest.shape[0]) - 1.0,
                           static_cast<double>(highest.shape[1]) - 1.0};
    const Index number[] = {static_cast<Index>(inside(x / side, last[0])),
                            static_cast<Index>(inside(y / side, last[1]))};
    const double position[] = {x, y};
    double step = (highest(number[0], number[1]) - ray.o[2] - far * ray.d[2]) / ray.d[2];
    for (int axis = 0; axis < 2; ++axis) {
        const double pace = ray.d[axis];
        if (pace != 0) {
            const double border = static_cast<double>(number[axis] + (pace > 0 ? 1 : 0)) * side;
            step = std::min(step, (border - position[axis]) / pace);
        }
    }
    return step;
}

// Finds where in its last step a ray came below the top, or `through` leaves to the ground.
double halve(const Grids& fields, double cell, const Ray& ray, double far, bool through) {
    double low = far - MARCH, high = far;
    for (int i = 0; i < HALVINGS; ++i) {
        const double middle = (low + high) / 2.0;
        const double x = ray.at(0, middle), y = ray.at(1, middle), z = ray.at(2, middle);
        const bool ground = through && owner_at(fields.owner, cell, x, y) < 0;
        const auto& field = ground ? fields.ground : fields.top;
        (z <= height_at(field, fields.owner, cell, x, y) ? high : low) = middle;
    }
    return high;
}

// Follows a ray down in steps, and halves the step in which something is met.
double follow(const Grids& fields, double cell, double side, const Ray& ray, double depth,
              double bottom, Index& found) {
    double far = 0, left = depth;
    const double end = (bottom - ray.o[2]) / ray.d[2];
    found = 0;
    while (far < end) {
        far += std::max(free_way(fields.highest, side, ray, far), MARCH);
        const double x = ray.at(0, far), y = ray.at(1, far), z = ray.at(2, far);
        const Index mine = owner_at(fields.owner, cell, x, y);
        const auto& field = mine < 0 ? fields.ground : fields.top;
        if (z <= height_at(field, fields.owner, cell, x, y)) {
            far = halve(fields, cell, ray, far, true);
            found =
                std::max<Index>(owner_at(fields.owner, cell, ray.at(0, far), ray.at(1, far)), 0);
            break;
        }
        if (mine < 0 && z <= height_at(fields.top, fields.owner, cell, x, y)) {
            if (left <= 0) {
                found = mine;
                return depth == 0 ? halve(fields, cell, ray, far, false) : far;
            }
            left -= MARCH;
        }
    }
    return far;
}

void check_grid(View<const double, 2> field, View<const Index, 2> owner) {
    check(field.shape == owner.shape && field.shape[0] > 1 && field.shape[1] > 1,
          "heights and owners must be of the same corners, two each way at least");
}

}  // namespace

// Returns the height at positions (N,) seen from straight above; writes what they belong to.
Owned<double> view_top(View<const double, 2> top, View<const Index, 2> owner, double cell,
                       View<const double> x, View<const double> y, View<Index> found) {
    check_grid(top, owner);
    check(x.size() == y.size() && x.size() == found.size(), "positions must be as many");
    std::vector<double> height(static_cast<std::size_t>(x.size()));
    for (Index n = 0; n < x.size(); ++n) {
        height[static_cast<std::size_t>(n)] = height_at(top, owner, cell, x[n], y[n]);
        found[n] = owner_at(owner, cell, x[n], y[n]);
    }
    return Owned<double>(std::move(height));
}

// Returns the distance (N,) at which rays (3, N) meet something, metres; writes whose it is.
//
// A ray goes through `depth` (N,) metres of leaves; `bottom` is below everything, `side` the length
// of the squares of `highest`.
Owned<double> descend(Grids fields, double cell, double side, View<const double, 2> origin,
                      View<const double, 2> direction, View<const double> depth, double bottom,
                      View<Index> found) {
    const Index count = depth.size();
    check_grid(fields.ground, fields.owner);
    check_grid(fields.top, fields.owner);
    check(fields.highest.shape[0] > 0 && fields.highest.shape[1] > 0, "there must be a square");
    check(origin.shape[0] == 3 && origin.shape[1] == count && direction.shape == origin.shape &&
              found.size() == count,
          "rays must be (3, N)");
    std::vector<double> distance(static_cast<std::size_t>(count));
    for (Index n = 0; n < count; ++n) {
        const Ray ray{{origin(0, n), origin(1, n), origin(2, n)},
                      {direction(0, n), direction(1, n), direction(2, n)}};
        distance[static_cast<std::size_t>(n)] =
            follow(fields, cell, side, ray, depth[n], bottom, found[n]);
    }
    return Owned<double>(std::move(distance));
}

}  // namespace lidar
