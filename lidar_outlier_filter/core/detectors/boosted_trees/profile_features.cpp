// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Segments of lines, the free groups that they make up, and heights: see profile_features.py.

#include "profile_features.hpp"

#include <cmath>
#include <vector>

#include "../../kernels/eigen.hpp"

namespace lidar {
namespace {

constexpr int MAX_SEGMENT = 40;       // returns of a segment: more are a surface
constexpr int MIN_GROUP_RETURNS = 6;  // returns of a group
constexpr double TINY = 1e-12;        // m²

// Returns whether place j is within reach of place k, which is of the line.
bool is_close(const Pattern& pattern, Index line, Index k, Index j, double reach) {
    const float apart = pattern.range[k] * pattern.gap[line] + pattern.apart[line];
    const double most = reach * static_cast<double>(apart);
    const float x = pattern.x[k] - pattern.x[j], y = pattern.y[k] - pattern.y[j];
    const float z = pattern.z[k] - pattern.z[j];
    return static_cast<double>(x * x + y * y + z * z) <= most * most;
}

void check_segments(const Pattern& pattern, const Segments& segments) {
    check_pattern(pattern, 0, pattern.first.size());
    check(segments.of.size() == pattern.order.size(), "segments must be (M,)");
    bool fits = true;
    for (Index line = 0; line < pattern.first.size(); ++line) {
        for (Index k = pattern.first[line]; k < pattern.last[line]; ++k) {
            fits &= 0 <= segments.of[k];
        }
    }
    for (Index k = 0; k < segments.of.size(); ++k) {
        fits &= segments.of[k] < segments.size.size();
    }
    check(fits, "numbers of segments must lie within these");
}

// Returns one more than the highest number of a group.
Index check_groups(const Segments& segments, View<const std::int32_t> group) {
    check(group.size() == segments.size.size(), "groups must be (S,)");
    Index highest = -1;
    for (Index s = 0; s < group.size(); ++s) {
        check(-1 <= group[s] && group[s] < group.size(), "numbers of groups must lie within these");
        highest = std::max<Index>(highest, group[s]);
    }
    return highest + 1;
}

// Segments that are joined to groups, by union-find: the root of each leads to a segment of its
// group, and in the end to one that is its own root; a group may be tied to a surface.
class Joined {
public:
    explicit Joined(Index segments)
        : root_(static_cast<std::size_t>(segments)), tied_(static_cast<std::size_t>(segments)) {
        for (Index s = 0; s < segments; ++s) {
            root(s) = s;
        }
    }

    Index& root(Index s) {
        return root_[static_cast<std::size_t>(s)];
    }
    char& tied(Index s) {
        return tied_[static_cast<std::size_t>(s)];
    }
    Index find(Index s) {
        while (root(s) != s) {
            root(s) = root(root(s));
            s = root(s);
        }
        return s;
    }
    void join(Index a, Index b) {
        a = find(a);
        b = find(b);
        root(std::max(a, b)) = std::min(a, b);
    }

private:
    std::vector<Index> root_;
    std::vector<char> tied_;
};

// Joins the segment at place k of a line to those around on other lines.
void tie_beside(const Pattern& pattern, View<const std::int32_t, 2> near, double reach,
                const Segments& segments, Index line, Index k, Joined& joined) {
    const Index mine = segments.of[k];
    for (int ring = 0; ring < 2 * RINGS; ++ring) {
        for (int m = -OTHER; m <= OTHER; ++m) {
            const Index j = near(ring, k) + m, other = segments.of[j];
            // Most are joined already, which is seen faster than measured.
            if (other < 0 || joined.root(other) == joined.root(mine)) {
                continue;
            }
            const bool large = segments.size[other] > MAX_SEGMENT;
            if ((large && joined.tied(mine)) || !is_close(pattern, line, k, j, reach)) {
                continue;
            }
            if (large) {
                joined.tied(mine) = 1;
            } else {
                joined.join(mine, other);
            }
        }
    }
}

// Sums over the returns of groups: [0] of all, [1] of the line at hand; and products of all, and
// of the lines' means as often as they saw the group.
struct GroupSums {
    double count[2] = {}, total[2][3] = {}, product[2][9] = {};
};

void add_line(const Pattern& pattern, Index line, const Segments& segments,
              View<const std::int32_t> group, std::vector<GroupSums>& sums) {
    for (Index k = pattern.first[line]; k < pattern.last[line]; ++k) {
        const std::int32_t g = group[segments.of[k]];
        if (g < 0) {
            continue;
        }
        GroupSums& of = sums[static_cast<std::size_t>(g)];
        const float at[] = {pattern.x[k], pattern.y[k], pattern.z[k]};
        for (int n = 0; n < 2; ++n) {
            of.count[n] += 1;
            for (int i = 0; i < 3; ++i) {
                of.total[n][i] += static_cast<double>(at[i]);
            }
        }
        for (int i = 0; i < 9; ++i) {
            of.product[0][i] += static_cast<double>(at[i / 3] * at[i % 3]);
        }
    }
    for (Index k = pattern.first[line]; k < pattern.last[line]; ++k) {
        const std::int32_t g = group[segments.of[k]];
        if (g < 0 || !(sums[static_cast<std::size_t>(g)].count[1] > 0)) {
            continue;
        }
        GroupSums& of = sums[static_cast<std::size_t>(g)];
        for (int i = 0; i < 9; ++i) {
            of.product[1][i] += of.total[1][i / 3] * of.total[1][i % 3] / of.count[1];
        }
        of.count[1] = of.total[1][0] = of.total[1][1] = of.total[1][2] = 0;
    }
}

// Writes the features of a group but the first, by second moments of all returns, and of lines.
void describe_moments(double (*of_all)[3], const double (*of_lines)[3], float* found) {
    double axes[3][3];
    LEVEL::eigen(of_all, axes, 3);
    const double a = of_all[0][0], b = of_all[1][1], c = of_all[2][2];
    const double most = std::max(std::max(std::max(a, b), c), TINY);
    const double middle = std::max(std::min(std::max(a, b), std::max(std::min(a, b), c)), TINY);
    const int longest = a >= b && a >= c ? 0 : b >= c ? 1 : 2;
    const double along[] = {axes[0][longest], axes[1][longest], axes[2][longest]};
    // One product after the other: a group's sum depends on no other group.
    double advance = 0;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            advance += along[i] * of_lines[i][j] * along[j];
        }
    }
    const double uniform = std::sqrt(12.0);  // length of an even row ÷ its standard deviation
    found[0] = static_cast<float>(std::abs(along[2]));
    found[1] = static_cast<float>(std::sqrt(middle / most));
    found[2] = static_cast<float>(std::sqrt(std::max(advance, 0.0) / most));
    found[3] = static_cast<float>(uniform * std::sqrt(most));
}

}  // namespace

std::tuple<Owned<std::int32_t>, Owned<std::int32_t>> find_segments(Pattern pattern, double reach) {
    check_pattern(pattern, 0, pattern.first.size());
    std::vector<std::int32_t> of(static_cast<std::size_t>(pattern.order.size()), -1), size;
    for (Index line = 0; line < pattern.first.size(); ++line) {
        const Index low = pattern.first[line];
        for (Index k = low; k < pattern.last[line]; ++k) {
            if (k == low || !is_close(pattern, line, k, k - 1, reach)) {
                size.push_back(0);
            }
            of[static_cast<std::size_t>(k)] = static_cast<std::int32_t>(size.size()) - 1;
            ++size.back();
        }
    }
    return {Owned<std::int32_t>(std::move(of)), Owned<std::int32_t>(std::move(size))};
}

Owned<std::int32_t> join_segments(Pattern pattern, View<const std::int32_t, 2> near, double reach,
                                  Segments segments) {
    check_segments(pattern, segments);
    check_beside(pattern, near, 0, pattern.first.size());
    const Index count = segments.size.size();
    Joined joined(count);
    for (Index line = 0; line < pattern.first.size(); ++line) {
        for (Index k = pattern.first[line]; k < pattern.last[line]; ++k) {
            if (segments.size[segments.of[k]] <= MAX_SEGMENT) {
                tie_beside(pattern, near, reach, segments, line, k, joined);
            }
        }
    }
    std::vector<Index> size(static_cast<std::size_t>(count));
    std::vector<std::int32_t> number(static_cast<std::size_t>(count), -1);
    for (Index s = 0; s < count; ++s) {
        const Index root = joined.root(s) = joined.find(s);
        size[static_cast<std::size_t>(root)] += segments.size[s];
        if (joined.tied(s) != 0 || segments.size[s] > MAX_SEGMENT) {
            joined.tied(root) = 1;
        }
    }
    std::int32_t groups = 0;
    for (Index s = 0; s < count; ++s) {
        // The first segment of a group is its root.
        const Index root = joined.root(s);
        if (root == s && joined.tied(s) == 0 &&
            size[static_cast<std::size_t>(s)] >= MIN_GROUP_RETURNS) {
            number[static_cast<std::size_t>(s)] = groups++;
        }
        number[static_cast<std::size_t>(s)] = number[static_cast<std::size_t>(root)];
    }
    return Owned<std::int32_t>(std::move(number));
}

Owned<float, 2> describe_groups(Pattern pattern, Segments segments,
                                View<const std::int32_t> group) {
    check_segments(pattern, segments);
    const Index groups = check_groups(segments, group);
    std::vector<GroupSums> sums(static_cast<std::size_t>(groups));
    for (Index line = 0; line < pattern.first.size(); ++line) {
        add_line(pattern, line, segments, group, sums);
    }
    std::vector<float> found(static_cast<std::size_t>(GROUP_FEATURES * groups));
    for (Index g = 0; g < groups; ++g) {
        const GroupSums& of = sums[static_cast<std::size_t>(g)];
        double moments[2][3][3], mean[3];
        for (int i = 0; i < 3; ++i) {
            mean[i] = of.total[0][i] / of.count[0];
        }
        for (int n = 0; n < 2; ++n) {
            for (int i = 0; i < 9; ++i) {
                moments[n][i / 3][i % 3] =
                    of.product[n][i] / of.count[0] - mean[i / 3] * mean[i % 3];
            }
        }
        float features[GROUP_FEATURES] = {static_cast<float>(of.count[0])};
        describe_moments(moments[0], moments[1], features + 1);
        for (int row = 0; row < GROUP_FEATURES; ++row) {
            found[static_cast<std::size_t>(row * groups + g)] = features[row];
        }
    }
    return {std::move(found), {GROUP_FEATURES, groups}};
}

void write_groups(Pattern pattern, Segments segments, View<const std::int32_t> group,
                  View<const float, 2> described, View<float, 2> out) {
    check_segments(pattern, segments);
    check(check_groups(segments, group) <= described.shape[1] && described.size() == out.size() &&
              out.shape[1] == pattern.order.size(),
          "features must be of all groups, and to all positions");
    for (Index line = 0; line < pattern.first.size(); ++line) {
        for (Index k = pattern.first[line]; k < pattern.last[line]; ++k) {
            const std::int32_t g = group[segments.of[k]];
            for (Index row = 0; row < out.size() && g >= 0; ++row) {
                out(row, k) = described(row, g);
            }
        }
    }
}

void write_heights(Pattern pattern, Floor around, Index begin, Index end, View<float> out) {
    check_pattern(pattern, begin, end);
    check_floor(around, pattern.order.size());
    check(out.size() == pattern.order.size(), "heights must be (M,)");
    for (Index line = begin; line < end; ++line) {
        for (Index k = pattern.first[line]; k < pattern.last[line]; ++k) {
            const auto x = static_cast<double>(pattern.x[k]), y = static_cast<double>(pattern.y[k]);
            const double low = LEVEL::floor_at(around, x, y).low;
            out[k] = static_cast<float>(static_cast<double>(pattern.z[k]) - low);
        }
    }
}

}  // namespace lidar
