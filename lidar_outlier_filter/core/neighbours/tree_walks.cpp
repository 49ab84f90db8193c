// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// See neighbours.hpp. Distances are squared everywhere, m².

#include "neighbours.hpp"

namespace lidar {

namespace {

void check_lists(View<const double, 2> xyz, Lists index, Index k, Index begin, Index end) {
    check(xyz.shape[1] == 3 && index.size() == xyz.size() && 0 < k && k <= index.shape[1],
          "there must be a list of at least k neighbours for each point (N, 3)");
    check_range(begin, end, xyz.size());
}

// Lists the points within the limit of point q, in their order, behind those that were found.
void walk(View<const double, 2> xyz, const Tree& tree, std::vector<Index>& stack, Index q,
          double limit, std::vector<std::int32_t>& found) {
    const Box box = LEVEL::box_of(xyz.row(q));
    stack.assign(1, 0);
    while (!stack.empty()) {
        const Index node = stack.back(), child = tree.child[node];
        stack.pop_back();
        if (!(LEVEL::gap(tree, node, box) <= limit)) {
            continue;
        }
        if (child >= 0) {
            stack.push_back(child + 1);
            stack.push_back(child);
            continue;
        }
        for (Index p = tree.first[node]; p < tree.last[node]; ++p) {
            if (p != q && LEVEL::squared(xyz.row(p), xyz.row(q)) <= limit) {
                found.push_back(static_cast<std::int32_t>(p));
            }
        }
    }
}

}  // namespace

// Writes the squared distance of each of a range of points to its k-th neighbour.
void squared_distances(View<const double, 2> xyz, Lists index, Index k, Index begin, Index end,
                       View<double> result) {
    check_lists(xyz, index, k, begin, end);
    check(result.size() == xyz.size(), "there must be a place for each point");
    for (Index q = begin; q < end; ++q) {
        const Index other = index(q, k - 1);
        check(0 <= other && other < xyz.size(), "neighbours must be points");
        result[q] = LEVEL::squared(xyz.row(q), xyz.row(other));
    }
}

// Copies the lists of a range of points that are kept; their new indices are not negative.
//
// `row` of the others is -1. Those that held a rejected point are searched again, and those that
// were tied, because it may have been with a rejected one.
void carry_over(Lists index, View<const bool> tied, View<const std::int32_t> new_index, Index begin,
                Index end, View<std::int32_t, 2> index_out, View<bool> tied_out,
                View<std::int32_t> row) {
    const Index count = new_index.size(), k = index.shape[1], kept = index_out.size();
    check(index.size() == count && tied.size() == count && index_out.shape[1] == k &&
              tied_out.size() == kept && row.size() == kept,
          "there must be a list, and whether it is tied, for each point, before and afterwards");
    check_indices(index, begin, end, count);
    for (Index q = begin; q < end; ++q) {
        const Index now = new_index[q];
        check(now < kept, "new indices must lie within the new lists");
        if (now < 0) {
            continue;
        }
        bool lost = tied[q];
        for (Index i = 0; i < k; ++i) {
            const std::int32_t other = new_index[index(q, i)];
            index_out(now, i) = other;
            lost |= other < 0;
        }
        row[now] = lost ? static_cast<std::int32_t>(now) : -1;
        tied_out[now] = false;
    }
}

// Counts for each of the points `which` the others up to its limit, inclusive, and lists them, one
// list behind the other.
std::tuple<Owned<Index>, Owned<std::int32_t>> list_within(View<const double, 2> xyz, Tree tree,
                                                          View<const Index> which,
                                                          View<const double> limits) {
    check(xyz.shape[1] == 3, "xyz must be (N, 3)");
    check_tree(tree, xyz.size());
    check_indices(which, xyz.size());
    check(limits.size() == which.size(), "there must be a limit for each point");
    std::vector<Index> stack, counts;
    std::vector<std::int32_t> found;
    for (Index i = 0; i < which.size(); ++i) {
        const std::size_t before = found.size();
        walk(xyz, tree, stack, which[i], limits[i], found);
        counts.push_back(static_cast<Index>(found.size() - before));
    }
    return {Owned<Index>(std::move(counts)), Owned<std::int32_t>(std::move(found))};
}

// Lists, (C, 2) as given, points of successive leaves at the place of an earlier one, and that.
Owned<Index, 2> find_copies(View<const Index> order, View<const double, 2> xyz, Tree tree,
                            View<const Index> these) {
    check(xyz.shape[1] == 3 && order.size() == xyz.size(), "xyz must be (N, 3), and order (N,)");
    check_tree(tree, xyz.size());
    check_indices(these, tree.child.size());
    std::vector<Index> found;
    for (Index i = 0; i < these.size(); ++i) {
        const Index first = tree.first[these[i]];
        for (Index p = first + 1; p < tree.last[these[i]]; ++p) {
            Index q = first;
            while (q < p && LEVEL::squared(xyz.row(p), xyz.row(q)) > 0) {
                ++q;
            }
            if (q < p) {
                found.push_back(order[p]);
                found.push_back(order[q]);
            }
        }
    }
    const Index count = static_cast<Index>(found.size()) / 2;
    return {std::move(found), {count, 2}};
}

}  // namespace lidar
