// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// What is asked of a whole tree.

#include "tree.hpp"

namespace lidar {

// Children come after their parents and share out their points, none of them empty: so each node is
// reached once, and walks end. A tree without any points is one empty leaf.
void check_tree(const Tree& tree, Index points) {
    const Index nodes = tree.child.size();
    check(nodes > 0 && tree.first.size() == nodes && tree.last.size() == nodes &&
              tree.low.shape == std::array<Index, 2>{nodes, 3} &&
              tree.high.shape == std::array<Index, 2>{nodes, 3},
          "a tree must have as many of everything as it has nodes");
    bool is_one = tree.first[0] == 0 && tree.last[0] == points;
    if (tree.levels > 0) {
        check(is_one, "the tree must be one over as many points");
        return;
    }
    for (Index node = 0; node < nodes; ++node) {  // also those that nobody reaches
        is_one &= 0 <= tree.first[node] && tree.first[node] <= tree.last[node];
        is_one &= tree.last[node] <= points;
    }
    for (Index node = 0; node < nodes && is_one; ++node) {
        const Index child = tree.child[node];
        if (child >= 0) {
            is_one = child > node && child < nodes - 1;
            is_one = is_one && tree.first[child] == tree.first[node] &&
                     tree.first[child] < tree.last[child] &&
                     tree.last[child] == tree.first[child + 1] &&
                     tree.first[child + 1] < tree.last[child + 1] &&
                     tree.last[child + 1] == tree.last[node];
        }
    }
    check(is_one, "the nodes must be those of a tree over all points");
}

Index tree_height(const Tree& tree) {
    check_tree(tree, tree.last.size() > 0 ? tree.last[0] : 0);
    if (tree.levels > 0) {
        return tree.levels;
    }
    std::vector<Index> level(static_cast<std::size_t>(tree.child.size()), 1);
    Index most = 1;
    for (Index node = 0; node < tree.child.size(); ++node) {
        const Index own = level[static_cast<std::size_t>(node)], child = tree.child[node];
        most = std::max(most, own);
        if (child >= 0) {
            level[static_cast<std::size_t>(child)] = own + 1;
            level[static_cast<std::size_t>(child + 1)] = own + 1;
        }
    }
    return most;
}

Owned<Index> subtrees(const Tree& tree, Index most) {
    check_tree(tree, tree.last.size() > 0 ? tree.last[0] : 0);
    std::vector<Index> found, stack{0};
    while (!stack.empty()) {
        const Index node = stack.back();
        stack.pop_back();
        if (tree.last[node] - tree.first[node] <= most || tree.child[node] < 0) {
            found.push_back(node);
        } else {
            stack.push_back(tree.child[node] + 1);
            stack.push_back(tree.child[node]);
        }
    }
    return Owned<Index>(std::move(found));
}

}  // namespace lidar
