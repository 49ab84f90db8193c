// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The k smallest of some hundred distances, without branches that nobody could predict.
//
// First a limit is found that has at least k of them, and not many more, below it: counting is what
// a processor does fastest, several at a stroke. Then the few below are sorted, by counting again.
//
// Rows of distances are padded with inf to whole strokes; STROKE is a multiple of every width.
#pragma once

#include <limits>
#include <vector>

#include "../kernels/array_view.hpp"
#include "../kernels/levels.hpp"
#include "../kernels/vectors.hpp"
#if defined(__AVX512F__)
#include <immintrin.h>
#endif

namespace lidar {
namespace LEVEL {

inline constexpr double INF = std::numeric_limits<double>::infinity();
inline constexpr Index STROKE = 16;
inline constexpr Index SURPLUS =
    12;                             // distances that may be sorted though not among the k smallest
inline constexpr Index STEPS = 16;  // towards the limit; ties may make it impossible
inline constexpr Index RANKED = 128;  // up to here counting smaller ones is faster than to sort

// Distances from one point, and the points that they are of, numbered in tree order.
struct Candidates {
    std::vector<double> distance;
    std::vector<std::int32_t> index;

    explicit Candidates(Index size)
        : distance(static_cast<std::size_t>(size)), index(static_cast<std::size_t>(size)) {}
};

inline Index padded(Index count) {
    return (count + STROKE - 1) / STROKE * STROKE;
}

[[gnu::always_inline]] inline Index sum(Wides values) {
    Index total = 0;
    for (int i = 0; i < DOUBLES; ++i) {
        total += values[i];
    }
    return total;
}

// Counts those of the first `size` distances, whole strokes, that are not greater than the limit.
inline Index count_up_to(const double* distance, Index size, double limit) {
    const Doubles bound = repeat(limit);
    Wides one{}, other{};
    static_assert(STROKE % (2 * DOUBLES) == 0, "two vectors at a time");
    for (Index i = 0; i < size; i += 2 * DOUBLES) {
        one -= load(distance + i) <= bound;
        other -= load(distance + i + DOUBLES) <= bound;
    }
    return sum(one + other);
}

struct Limit {
    double value;
    Index count;  // of distances up to it
};

// Returns a limit with at least k distances up to it, and not many more, if there is one.
//
// `upper` is a limit with at least k, `lower` one with fewer. Around a point of a surface the
// number of distances grows like the squared distance, so the next limit is interpolated.
inline Limit tighten(const double* distance, Index size, Index k, Limit lower, Limit upper,
                     double guess) {
    double limit = guess;
    for (Index step = 0; step < STEPS && upper.count > k + SURPLUS; ++step) {
        if (!(lower.value < limit && limit < upper.value)) {
            const double share = (static_cast<double>(k - lower.count) + SURPLUS / 2) /
                                 static_cast<double>(upper.count - lower.count);
            limit = lower.value + share * (upper.value - lower.value);
            if (!(lower.value < limit && limit < upper.value)) {
                break;
            }
        }
        const Index count = count_up_to(distance, size, limit);
        (count >= k ? upper : lower) = {limit, count};
    }
    return upper;
}

// Copies the distances up to the limit, and their indices; returns how many there are. The copies
// need room for one vector more.
inline Index choose(const double* distance, const std::int32_t* index, Index size, double limit,
                    double* few, std::int32_t* few_index) {
    Index chosen = 0;
#if defined(__AVX512F__)
    const __m512d bound = _mm512_set1_pd(limit);
    for (Index i = 0; i < size; i += 8) {
        const __m512d all = _mm512_loadu_pd(distance + i);
        const __mmask8 near = _mm512_cmp_pd_mask(all, bound, _CMP_LE_OQ);
        const __m256i numbers = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(index + i));
        _mm512_storeu_pd(few + chosen, _mm512_maskz_compress_pd(near, all));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(few_index + chosen),
                            _mm256_maskz_compress_epi32(near, numbers));
        chosen += __builtin_popcount(near);
    }
#else
    for (Index i = 0; i < size; ++i) {
        few[chosen] = distance[i];
        few_index[chosen] = index[i];
        chosen += distance[i] <= limit ? 1 : 0;
    }
#endif
    return chosen;
}

// Sorts by distance, then `order`: Shell's sort with Knuth's steps.
inline void sort_ties(const Index* order, const double* few, const std::int32_t* few_index,
                      Index count, double* best, std::int32_t* index) {
    std::copy(few, few + count, best);
    std::copy(few_index, few_index + count, index);
    Index step = 1;
    while (step < count / 3) {
        step = 3 * step + 1;
    }
    for (; step > 0; step /= 3) {
        for (Index i = step; i < count; ++i) {
            const double d = best[i];
            const std::int32_t p = index[i];
            Index j = i;
            while (j >= step && (best[j - step] > d ||
                                 (best[j - step] == d && order[index[j - step]] > order[p]))) {
                best[j] = best[j - step];
                index[j] = index[j - step];
                j -= step;
            }
            best[j] = d;
            index[j] = p;
        }
    }
}

// Writes for each of one to four vectors of distances, from `i` on, how many of all are nearer.
template <int VECTORS>
[[gnu::always_inline]] inline void count_nearer(const double* few, Index size, Index i,
                                                std::int64_t* ranks) {
    Doubles own[VECTORS];
    Wides nearer[VECTORS];
    for (int v = 0; v < VECTORS; ++v) {
        own[v] = load(few + i + v * DOUBLES);
        nearer[v] = Wides{};
    }
    for (Index j = 0; j < size; ++j) {
        const Doubles other = repeat(few[j]);
        for (int v = 0; v < VECTORS; ++v) {
            nearer[v] -= other < own[v];
        }
    }
    for (int v = 0; v < VECTORS; ++v) {
        std::memcpy(ranks + i + v * DOUBLES, &nearer[v], sizeof nearer[v]);
    }
}

// Sorts by counting for each of the few how many are nearer; false, and unsorted, with ties.
inline bool rank(double* few, const std::int32_t* few_index, Index count, double* best,
                 std::int32_t* best_index) {
    const Index size = (count + DOUBLES - 1) / DOUBLES * DOUBLES;
    std::fill(few + count, few + size, INF);
    std::int64_t ranks[RANKED];
    Index i = 0;
    for (; i + 4 * DOUBLES <= size; i += 4 * DOUBLES) {
        count_nearer<4>(few, count, i, ranks);
    }
    for (; i + 2 * DOUBLES <= size; i += 2 * DOUBLES) {
        count_nearer<2>(few, count, i, ranks);
    }
    for (; i < size; i += DOUBLES) {
        count_nearer<1>(few, count, i, ranks);
    }
    Index total = 0;
    for (Index j = 0; j < count; ++j) {
        best[ranks[j]] = few[j];
        best_index[ranks[j]] = few_index[j];
        total += ranks[j];
    }
    // The ranks are 0, 1, 2 … if no two are equal.
    return total == count * (count - 1) / 2;
}

// Sorts distances, and equal ones by the `order` of their indices. There must be room for a vector
// more.
inline void sort_few(const Index* order, Candidates& few, Index count, Candidates& best) {
    double* const distance = few.distance.data();
    std::int32_t* const index = few.index.data();
    if (count > RANKED || !rank(distance, index, count, best.distance.data(), best.index.data())) {
        sort_ties(order, distance, index, count, best.distance.data(), best.index.data());
    }
}

}  // namespace LEVEL
}  // namespace lidar
