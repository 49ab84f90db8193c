// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Work on several points side by side, in lanes, which a processor does at one stroke.
//
// Arrays are [quantity][neighbour][lane], and innermost loops go over the lanes: so nothing depends
// on the order in which the sums of one point are added up, and each lane gets what it would get
// alone.
#pragma once

#include "array_view.hpp"
#include "levels.hpp"
#include "vectors.hpp"

namespace lidar {
namespace LEVEL {

inline constexpr int LANES = 32;  // a multiple of each WIDTH; more would not fit into the cache
inline constexpr int MAX_SORTED = 64;  // rows that a network sorts
inline constexpr int MAX_PAIRS = 543;  // that these take

struct Pair {  // of rows: which takes the smaller value, and which the larger
    int smaller = 0, larger = 0;
};

struct Network {  // pairs to compare and swap, in order
    int size = 0;
    Pair pairs[MAX_PAIRS];
};

// Returns the pairs that sort `count` rows, up to MAX_SORTED.
//
// Batcher's merge exchange (Knuth 5.2.2, algorithm M), without the steps that the ranks from
// `first` to before `last` do not depend on: the other rows are not sorted.
constexpr Network make_network(int count, int first, int last) {
    Network whole, result;
    int top = 1;
    while (2 * top < count) {
        top *= 2;
    }
    for (int step = top; step > 0; step /= 2) {
        int size = top, remainder = 0, distance = step;
        while (distance > 0) {
            for (int i = 0; i < count - distance; ++i) {
                if ((i & step) == remainder) {
                    whole.pairs[whole.size++] = {i, i + distance};
                }
            }
            distance = size - step;  // 0 at last
            size /= 2;
            remainder = step;
        }
    }
    bool needed[MAX_SORTED] = {}, kept[MAX_PAIRS] = {};
    for (int rank = first; rank < last; ++rank) {
        needed[rank] = true;
    }
    for (int k = whole.size - 1; k >= 0; --k) {
        const Pair pair = whole.pairs[k];
        kept[k] = needed[pair.smaller] || needed[pair.larger];
        needed[pair.smaller] = needed[pair.smaller] || kept[k];
        needed[pair.larger] = needed[pair.larger] || kept[k];
    }
    for (int k = 0; k < whole.size; ++k) {
        if (kept[k]) {
            result.pairs[result.size++] = whole.pairs[k];
        }
    }
    return result;
}

// Sorts the elements of vectors, none NaN, by the rows of a network.
inline void sort(Doubles* rows, const Network& network) {
    for (int k = 0; k < network.size; ++k) {
        const Pair pair = network.pairs[k];
        const Doubles one = rows[pair.smaller], other = rows[pair.larger];
        rows[pair.smaller] = least(one, other);
        rows[pair.larger] = most(one, other);
    }
}

}  // namespace LEVEL
}  // namespace lidar
