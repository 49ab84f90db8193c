// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Rays onto surfaces, see caster.hpp. Textbook twin: test/naive/raycast.py.

#include "caster.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lidar {
namespace {

using namespace LEVEL;

constexpr double PI = 3.14159265358979323846, INFINITE = std::numeric_limits<double>::infinity();
// Keeps a ray parallel to a face from dividing by zero; it meets the face nowhere near.
constexpr double TINY = 1e-12;

struct Hit {
    double far, lean;
    Index part;
};

struct Ray {
    double o[3], d[3];
};

double apart(double step) {
    return std::abs(step) >= TINY ? step : TINY;
}

double sign(double value) {
    return value > 0 ? 1.0 : value < 0 ? -1.0 : value;
}

// Returns whether a ray comes within `reach` of a row's box before `farthest`.
bool is_towards(const double* row, const Ray& ray, double reach, double farthest) {
    double entry = 0, leave = farthest;
    for (int axis = 0; axis < 3; ++axis) {
        const double step = apart(ray.d[axis]);
        const double first = (row[LOW + axis] - reach - ray.o[axis]) / step;
        const double second = (row[HIGH + axis] + reach - ray.o[axis]) / step;
        entry = std::max(entry, std::min(first, second));
        leave = std::min(leave, std::max(first, second));
    }
    return entry <= leave;
}

// Meets a road from above: start, end, half width, crown.
Hit meet_ground(const double* p, const Ray& ray) {
    const auto& [o, d] = ray;
    const double start = p[0], end = p[1], half = p[2], crown = p[3], y = o[1];
    const double bend = crown / (half * half), share = y / half;
    const double a = bend * (d[1] * d[1]);
    const double b = d[2] + 2.0 * bend * y * d[1];
    const double c = o[2] - crown * (1.0 - share * share);
    const double disc = b * b - 4.0 * a * c;
    // This form of the quadratic formula is exact for the flat road (a = 0) too.
    const double far = 2.0 * c / std::max(std::sqrt(std::max(disc, 0.0)) - b, TINY);
    const double along = o[0] + far * d[0], across = y + far * d[1];
    const bool inside = start <= along && along <= end && std::abs(across) <= half;
    if (!(inside && b < 0 && c > 0 && disc >= 0)) {
        return {INFINITE, 1.0, 2};
    }
    const double slope = 2.0 * bend * across;
    return {far, std::abs(d[2] + slope * d[1]) / std::sqrt(1.0 + slope * slope), 2};
}

// Meets a box from outside: its low corner and its high corner.
Hit meet_box(const double* p, const Ray& ray) {
    double entry = -INFINITE, leave = INFINITE;
    int face = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double step = apart(ray.d[axis]);
        const double first = (p[axis] - ray.o[axis]) / step;
        const double second = (p[3 + axis] - ray.o[axis]) / step;
        if (std::min(first, second) > entry) {
            entry = std::min(first, second);
            face = axis;
        }
        leave = std::min(leave, std::max(first, second));
    }
    if (!(0 < entry && entry < leave)) {
        return {INFINITE, 1.0, face};
    }
    return {entry, std::abs(ray.d[face]), face};
}

// Meets a box with windows, from outside.
//
// Corners, pitch, storey, width and height of a window, sill, recess, every how many-th is open
// (0: none), and whether the walls across the street (normal to x) have windows too.
Hit meet_building(const double* p, const Ray& ray) {
    const auto& [o, d] = ray;
    const Hit wall = meet_box(p, ray);
    const auto [far, lean, face] = wall;
    if (far == INFINITE || face == 2 || (face == 0 && p[13] == 0)) {  // 2: the roof
        return wall;
    }
    const Index side = 1 - face;
    const double pitch = p[6], storey = p[7], across = p[8], up = p[9], sill = p[10];
    const double recess = p[11], every = p[12];
    double u = o[side] + far * d[side] - p[side];
    double v = o[2] + far * d[2] - p[2];
    const double column = std::floor(u / pitch), level = std::floor(v / storey);
    u -= (column + 0.5) * pitch;
    v = v - level * storey - sill - up / 2.0;
    if (!(std::abs(u) < across / 2.0 && std::abs(v) < up / 2.0)) {
        return wall;
    }
    const double aside = (across / 2.0 - sign(d[side]) * u) / std::max(std::abs(d[side]), TINY);
    const double upward = (up / 2.0 - sign(d[2]) * v) / std::max(std::abs(d[2]), TINY);
    const double deep = recess / std::max(std::abs(d[face]), TINY);
    if (aside <= deep && aside <= upward) {
        return {far + aside, std::abs(d[side]), side};
    }
    if (upward < deep) {
        return {far + upward, std::abs(d[2]), 2};
    }
    if (every > 0 && std::fmod(column + 2.0 * level, every) == 0) {
        return {INFINITE, 1.0, face};  // an open window: what goes in is lost
    }
    return {far + deep, std::abs(d[face]), face + PANE};
}

// Meets the outside of a tube: its foot, its axis (length one), radius, length.
Hit meet_tube(const double* p, const Ray& ray) {
    const auto& [o, d] = ray;
    double along = 0, lean = 0, a = 0, b = 0, c = 0;
    for (int axis = 0; axis < 3; ++axis) {
        along += (o[axis] - p[axis]) * p[3 + axis];
        lean += d[axis] * p[3 + axis];
    }
    for (int axis = 0; axis < 3; ++axis) {
        const double out = o[axis] - p[axis] - along * p[3 + axis];
        const double turn = d[axis] - lean * p[3 + axis];
        a += turn * turn;
        b += out * turn;
        c += out * out;
    }
    a = std::max(a, TINY);
    const double disc = b * b - a * (c - p[6] * p[6]);
    if (!(disc > 0)) {
        return {INFINITE, 1.0, ROUND};
    }
    const double far = (-b - std::sqrt(disc)) / a, position = along + far * lean;
    if (!(far > 0 && 0 <= position && position <= p[7])) {
        return {INFINITE, 1.0, ROUND};
    }
    return {far, std::sqrt(disc) / p[6], ROUND};
}

// Meets a swinging tube: its pivot, length, radius, angle at t = 0, rate.
Hit meet_arm(const double* p, const Ray& ray, double t) {
    const double raised = std::min(std::max(p[5] + p[6] * t, 0.0), PI / 2.0);
    const double tube[] = {p[0], p[1], p[2], 0.0, -std::cos(raised), std::sin(raised), p[4], p[3]};
    return meet_tube(tube, ray);
}

// Meets a ball from outside: centre, radius.
Hit meet_ball(const double* p, const Ray& ray) {
    double b = 0, c = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double out = ray.o[axis] - p[axis];
        b += out * ray.d[axis];
        c += out * out;
    }
    const double disc = b * b - c + p[3] * p[3];
    if (disc <= 0 || b >= 0 || c <= p[3] * p[3]) {
        return {INFINITE, 1.0, ROUND};
    }
    return {-b - std::sqrt(disc), std::sqrt(disc) / p[3], ROUND};
}

// Meets a round lid from above: centre of its top, radius, height and spacing of its ribs.
//
// The ribs' flanks are left out: a ray is carried on from the top to the grooves between them.
Hit meet_lid(const double* p, const Ray& ray) {
    const auto& [o, d] = ray;
    if (d[2] >= -TINY || o[2] <= p[2]) {
        return {INFINITE, 1.0, 2};
    }
    double far = (p[2] - o[2]) / d[2];
    const double u = o[0] + far * d[0] - p[0], v = o[1] + far * d[1] - p[1];
    if (u * u + v * v > p[3] * p[3]) {
        return {INFINITE, 1.0, 2};
    }
    if (std::sin(2.0 * PI * u / p[5]) * std::sin(2.0 * PI * v / p[5]) < 0) {
        far += p[4] / -d[2];
    }
    return {far, -d[2], 2};
}

// Scrambles 64 bits (the last step of SplitMix64; Steele et al. 2014, figure 17).
std::uint64_t mix(std::uint64_t value) {
    value = (value ^ (value >> 30U)) * 0xBF58476D1CE4E5B9U;
    value = (value ^ (value >> 27U)) * 0x94D049BB133111EBU;
    return value ^ (value >> 31U);
}

// Gives a number in 0 to 1 that belongs to a cell of a grid.
double uniform(const Index* cell, Index seed, Index which) {
    auto state = static_cast<std::uint64_t>(seed);
    for (const Index number : {cell[0], cell[1], cell[2], which}) {
        state = mix(state + static_cast<std::uint64_t>(number) + 0x9E3779B97F4A7C15U);
    }
    return static_cast<double>(state >> 11U) * 0x1p-53;
}

// Meets the leaf of a cell: as meet_crown().
Hit meet_leaf(const double* p, const Ray& ray, const Index* cell) {
    const auto seed = static_cast<Index>(p[9]);
    const double radius = p[7];
    double gap[3];
    for (int axis = 0; axis < 3; ++axis) {
        const auto number = static_cast<double>(cell[axis]);
        const double position = (number + uniform(cell, seed, 1 + axis)) * p[6];
        gap[axis] = p[axis] + position - ray.o[axis];
    }
    const double height = 2.0 * uniform(cell, seed, 4) - 1.0;
    const double around = 2.0 * PI * uniform(cell, seed, 5);
    const double flat = std::sqrt(std::max(1.0 - height * height, 0.0));
    const double normal[] = {flat * std::cos(around), flat * std::sin(around), height};
    double lean = 0, reach = 0, off = 0;
    for (int axis = 0; axis < 3; ++axis) {
        lean += ray.d[axis] * normal[axis];
        reach += gap[axis] * normal[axis];
    }
    if (std::abs(lean) < TINY) {
        return {INFINITE, 1.0, ROUND};
    }
    const double far = reach / lean;
    for (int axis = 0; axis < 3; ++axis) {
        const double aside = far * ray.d[axis] - gap[axis];
        off += aside * aside;
    }
    return off < radius * radius ? Hit{far, std::abs(lean), ROUND} : Hit{INFINITE, 1.0, ROUND};
}

// Meets the leaves of an ellipsoid: centre, half axes, cell, leaf radius, share, seed.
//
// Space is cut into cells; in a share of them is a leaf, a disc that lies and leans anyhow. The
// cells on the ray are visited in order, and in each only its own leaf counts.
Hit meet_crown(const double* p, const Ray& ray) {
    const auto& [o, d] = ray;
    double a = 0, b = 0, c = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double turn = d[axis] / p[3 + axis], out = (o[axis] - p[axis]) / p[3 + axis];
        a += turn * turn;
        b += out * turn;
        c += out * out;
    }
    const double disc = b * b - a * (c - 1.0);
    if (disc <= 0) {
        return {INFINITE, 1.0, ROUND};
    }
    double now = std::max((-b - std::sqrt(disc)) / a, 0.0);
    const double end = (-b + std::sqrt(disc)) / a;
    const double size = p[6], share = p[8];
    const auto seed = static_cast<Index>(p[9]);
    Index cell[3];
    double onward[3], border[3];
    for (int axis = 0; axis < 3; ++axis) {
        const double step = apart(d[axis]);
        cell[axis] = static_cast<Index>(std::floor((o[axis] + now * d[axis] - p[axis]) / size));
        const auto next = static_cast<double>(cell[axis] + (step > 0 ? 1 : 0));
        border[axis] = (p[axis] - o[axis] + next * size) / step;
        onward[axis] = size / std::abs(step);
    }
    while (now < end) {
        if (uniform(cell, seed, 0) < share) {
            const Hit leaf = meet_leaf(p, ray, cell);
            if (0 < leaf.far && leaf.far < end) {
                return leaf;
            }
        }
        const auto axis = std::min_element(border, border + 3) - border;
        now = border[axis];
        border[axis] += onward[axis];
        cell[axis] += d[axis] > 0 ? 1 : -1;
    }
    return {INFINITE, 1.0, ROUND};
}

Hit meet(const double* row, const Ray& ray, double t) {
    const double* const p = row + REST;
    switch (static_cast<int>(row[0])) {
        case GROUND:
            return meet_ground(p, ray);
        case BOX:
            return meet_box(p, ray);
        case BUILDING:
            return meet_building(p, ray);
        case TUBE:
            return meet_tube(p, ray);
        case ARM:
            return meet_arm(p, ray, t);
        case BALL:
            return meet_ball(p, ray);
        case LID:
            return meet_lid(p, ray);
        default:
            return meet_crown(p, ray);
    }
}

}  // namespace

std::tuple<Owned<double, 2>, Owned<double, 2>, Owned<Index, 2>, Owned<Index, 2>> cast_rays(
    View<const double, 2> table, View<const double, 3> origin, View<const double, 3> direction,
    View<const double> t, double reach) {
    const Index count = direction.shape[1], rays = direction.shape[2];
    check(table.shape[1] == WIDTH, "surfaces must be (S, WIDTH)");
    check(direction.shape[0] == 3 && origin.shape == direction.shape && t.size() == count,
          "origins and directions must be (3, N, K), and times (N,)");
    const auto size = static_cast<std::size_t>(count * rays);
    std::vector<double> distance(size, INFINITE), cosine(size, 1.0);
    std::vector<Index> surface(size, -1), part(size, ROUND);
    const auto ray_of = [&](const double* row, Index n, Index k) {
        Ray ray;
        for (int axis = 0; axis < 3; ++axis) {
            ray.o[axis] = origin(axis, n, k) - row[VELOCITY + axis] * t[n];
            ray.d[axis] = direction(axis, n, k);
        }
        return ray;
    };
    for (Index n = 0; n < count && rays > 0; ++n) {
        double farthest = INFINITE;  // of what the rays of the bundle have met so far
        for (Index s = 0; s < table.size(); ++s) {
            const double* const row = table.row(s);
            if (!is_towards(row, ray_of(row, n, 0), reach, farthest)) {
                continue;
            }
            farthest = 0;
            for (Index k = 0; k < rays; ++k) {
                const Hit hit = meet(row, ray_of(row, n, k), t[n]);
                const auto at = static_cast<std::size_t>(n * rays + k);
                if (hit.far < distance[at]) {
                    distance[at] = hit.far;
                    cosine[at] = hit.lean;
                    surface[at] = s;
                    part[at] = hit.part;
                }
                farthest = std::max(farthest, distance[at]);
            }
        }
    }
    const std::array<Index, 2> shape{count, rays};
    return {Owned<double, 2>(std::move(distance), shape),
            Owned<double, 2>(std::move(cosine), shape), Owned<Index, 2>(std::move(surface), shape),
            Owned<Index, 2>(std::move(part), shape)};
}

}  // namespace lidar
