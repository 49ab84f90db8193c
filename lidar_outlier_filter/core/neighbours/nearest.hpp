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
#include <new>
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

// Numbers at the begin of a line of the cache: a vector of them lies in one.
template <typename T>
struct Allocator {
    using value_type = T;
    static constexpr std::align_val_t LINE{64};

    Allocator() = default;
    template <typename Other>
    Allocator(const Allocator<Other>&) {}
    T* allocate(std::size_t count) {
        return static_cast<T*>(operator new(count * sizeof(T), LINE));
    }
    void deallocate(T* held, std::size_t) {
        operator delete(held, LINE);
    }
    bool operator==(const Allocator&) const {
        return true;
    }
    bool operator!=(const Allocator&) const {
        return false;
    }
};

template <typename T>
using Buffer = std::vector<T, Allocator<T>>;

// Distances from one point, and the points that they are of, numbered in tree order.
struct Candidates {
    Buffer<double> distance;
    Buffer<std::int32_t> index;

    explicit Candidates(Index size)
        : distance(static_cast<std::size_t>(size)), index(static_cast<std::size_t>(size)) {}
};

inline Index padded(Index count) {
    return (count + STROKE - 1) / STROKE * STROKE;
}

// How many distances are not greater than a bound.
struct Count {
#if defined(__AVX512F__)
    Index found = 0;
    [[gnu::always_inline]] void add(Doubles distance, Doubles bound) {
        found += __builtin_popcount(_mm512_cmp_pd_mask(distance, bound, _CMP_LE_OQ));
    }
    Index total() const {
        return found;
    }
#else
    Wides found{};
    [[gnu::always_inline]] void add(Doubles distance, Doubles bound) {
        found -= distance <= bound;
    }
    Index total() const {
        Index sum = 0;
        for (int i = 0; i < DOUBLES; ++i) {
            sum += found[i];
        }
        return sum;
    }
#endif
};

// Counts those of the first `size` distances, whole strokes, that are not greater than the limit.
inline Index count_up_to(const double* distance, Index size, double limit) {
    const Doubles bound = repeat(limit);
    Count one, other;
    static_assert(STROKE % (2 * DOUBLES) == 0, "two vectors at a time");
    for (Index i = 0; i < size; i += 2 * DOUBLES) {
        one.add(load(distance + i), bound);
        other.add(load(distance + i + DOUBLES), bound);
    }
    return one.total() + other.total();
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
            const double share = (static_cast<double>(k - lower.count) + 0.5 * SURPLUS) /
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

// Writes for each of some vectors of keys, from `i` on, how many of all are smaller.
template <int VECTORS>
[[gnu::always_inline]] inline void count_smaller(const float* keys, Index count, Index i,
                                                 std::int32_t* ranks) {
    Singles own[VECTORS];
    Counts smaller[VECTORS];
    for (int v = 0; v < VECTORS; ++v) {
        own[v] = load(keys + i + v * WIDTH);
        smaller[v] = Counts{};
    }
    for (Index j = 0; j < count; ++j) {
        const Singles other = repeat(keys[j]);
        for (int v = 0; v < VECTORS; ++v) {
            smaller[v] -= other < own[v];
        }
    }
    for (int v = 0; v < VECTORS; ++v) {
        store(ranks + i + v * WIDTH, smaller[v]);
    }
}

// Sorts by counting for each of the few how many are nearer; false, and unsorted, with ties.
//
// Rounded to singles, of which a vector holds twice as many: that keeps the order of those that
// remain different, and nearly always all do.
inline bool rank(const double* few, const std::int32_t* few_index, Index count, double* best,
                 std::int32_t* best_index) {
    alignas(64) float keys[RANKED + 2 * WIDTH];
    alignas(64) std::int32_t ranks[RANKED + 2 * WIDTH];
    for (Index i = 0; i < count; ++i) {
        keys[i] = static_cast<float>(few[i]);
    }
    std::fill(keys + count, keys + count + 2 * WIDTH, std::numeric_limits<float>::infinity());
    for (Index i = 0; i < count; i += 2 * WIDTH) {
        count_smaller<2>(keys, count, i, ranks);
    }
    Index total = 0;
    for (Index i = 0; i < count; ++i) {
        best[ranks[i]] = few[i];
        best_index[ranks[i]] = few_index[i];
        total += ranks[i];
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
