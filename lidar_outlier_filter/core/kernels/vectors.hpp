// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Vectors in registers, by extensions that g++ and clang++ have. Each element gets what a loop over
// numbers would give it, bit by bit; so results do not depend on the width, which is that of
// the level's registers (wider types are taken apart badly).
#pragma once

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include <cmath>
#include <cstdint>
#include <cstring>

#include "array_view.hpp"
#include "levels.hpp"

namespace lidar {
namespace LEVEL {

#if defined(__AVX512F__)
inline constexpr Index WIDTH = 16;  // singles
#elif defined(__AVX__)
inline constexpr Index WIDTH = 8;
#else
inline constexpr Index WIDTH = 4;
#endif
inline constexpr Index DOUBLES = WIDTH / 2;

typedef float Singles __attribute__((vector_size(WIDTH * 4)));
typedef std::int32_t Counts __attribute__((vector_size(WIDTH * 4)));  // and masks: 0 or -1
typedef double Doubles __attribute__((vector_size(WIDTH * 4)));
typedef std::int64_t Wides __attribute__((vector_size(WIDTH * 4)));  // masks of doubles: 0 or -1

template <typename Number>
struct Vector {
    typedef Number type __attribute__((vector_size(WIDTH * 4)));
};

template <typename Number>
[[gnu::always_inline]] inline typename Vector<Number>::type load(const Number* from) {
    typename Vector<Number>::type result;
    std::memcpy(&result, from, sizeof result);
    return result;
}
template <typename Number>
[[gnu::always_inline]] inline void store(Number* to, typename Vector<Number>::type values) {
    std::memcpy(to, &values, sizeof values);
}
[[gnu::always_inline]] inline void store(float* to, Doubles values) {  // rounded
    typedef float Halves __attribute__((vector_size(DOUBLES * 4)));
    const Halves rounded = __builtin_convertvector(values, Halves);
    std::memcpy(to, &rounded, sizeof rounded);
}
template <typename Number>
[[gnu::always_inline]] inline typename Vector<Number>::type repeat(Number value) {
    return typename Vector<Number>::type{} + value;
}
template <typename Mask, typename Values>
[[gnu::always_inline]] inline Values choose(Mask mask, Values one, Values other) {
    return mask ? one : other;
}
template <typename Values>
[[gnu::always_inline]] inline Values least(Values one, Values other) {  // as min() of Python
    return other < one ? other : one;
}
template <typename Values>
[[gnu::always_inline]] inline Values most(Values one, Values other) {  // as max() of Python
    return other > one ? other : one;
}
template <typename Values>
[[gnu::always_inline]] inline Values root(Values values) {
    for (std::size_t i = 0; i < sizeof values / sizeof values[0]; ++i) {
        values[i] = std::sqrt(values[i]);
    }
    return values;
}
[[gnu::always_inline]] inline Singles size_of(Singles values) {  // without the sign
    return reinterpret_cast<Singles>(reinterpret_cast<Counts>(values) & 0x7FFFFFFF);
}
[[gnu::always_inline]] inline Doubles size_of(Doubles values) {
    return reinterpret_cast<Doubles>(reinterpret_cast<Wides>(values) & 0x7FFFFFFFFFFFFFFF);
}

[[gnu::always_inline]] inline Singles single(Counts counts) {
    return __builtin_convertvector(counts, Singles);
}

[[gnu::always_inline]] inline bool any(Counts mask) {
#if defined(__AVX512F__)
    return _mm512_test_epi32_mask(reinterpret_cast<__m512i>(mask),
                                  reinterpret_cast<__m512i>(mask)) != 0;
#elif defined(__AVX__)
    return _mm256_movemask_ps(reinterpret_cast<__m256>(mask)) != 0;
#elif defined(__x86_64__)
    return _mm_movemask_ps(reinterpret_cast<__m128>(mask)) != 0;
#else
    std::int32_t some = 0;
    for (int i = 0; i < WIDTH; ++i) {
        some |= mask[i];
    }
    return some != 0;
#endif
}
[[gnu::always_inline]] inline bool all(Counts mask) {
    return !any(~mask);
}
// Returns the numbers from the first on.
[[gnu::always_inline]] inline Counts follow(std::int32_t first) {
    Counts result;
    for (int i = 0; i < WIDTH; ++i) {
        result[i] = i;
    }
    return result + first;
}

// Returns the elements at these indices.
[[gnu::always_inline]] inline Singles take(const float* from, Counts at) {
#if defined(__AVX512F__)
    // Under a mask, because g++ warns of what the other one leaves open.
    return reinterpret_cast<Singles>(_mm512_mask_i32gather_ps(
        _mm512_setzero_ps(), 0xFFFF, reinterpret_cast<__m512i>(at), from, sizeof(float)));
#elif defined(__AVX2__)
    return reinterpret_cast<Singles>(
        _mm256_i32gather_ps(from, reinterpret_cast<__m256i>(at), sizeof(float)));
#else
    Singles result;
    for (int i = 0; i < WIDTH; ++i) {
        result[i] = from[at[i]];
    }
    return result;
#endif
}
[[gnu::always_inline]] inline Counts take(const std::int32_t* from, Counts at) {
#if defined(__AVX512F__)
    return reinterpret_cast<Counts>(_mm512_mask_i32gather_epi32(
        _mm512_setzero_si512(), 0xFFFF, reinterpret_cast<__m512i>(at), from, sizeof(float)));
#elif defined(__AVX2__)
    return reinterpret_cast<Counts>(
        _mm256_i32gather_epi32(from, reinterpret_cast<__m256i>(at), sizeof(float)));
#else
    Counts result;
    for (int i = 0; i < WIDTH; ++i) {
        result[i] = from[at[i]];
    }
    return result;
#endif
}

// As many doubles as there are singles in a vector: a lower and an upper half.
struct DoublePair {
    Doubles low, high;

    [[gnu::always_inline]] DoublePair operator-(const DoublePair& other) const {
        return {low - other.low, high - other.high};
    }
};
[[gnu::always_inline]] inline DoublePair load_pair(const double* from) {
    return {load(from), load(from + DOUBLES)};
}
[[gnu::always_inline]] inline DoublePair take(const double* from, Counts at) {
#if !defined(__AVX__)
    return {Doubles{from[at[0]], from[at[1]]}, Doubles{from[at[2]], from[at[3]]}};
#else
    DoublePair result;
#if defined(__AVX512F__)
    const __m512d none = _mm512_setzero_pd();
    const auto low =
        reinterpret_cast<__m256i>(__builtin_shufflevector(at, at, 0, 1, 2, 3, 4, 5, 6, 7));
    const auto high =
        reinterpret_cast<__m256i>(__builtin_shufflevector(at, at, 8, 9, 10, 11, 12, 13, 14, 15));
    result.low =
        reinterpret_cast<Doubles>(_mm512_mask_i32gather_pd(none, 0xFF, low, from, sizeof(double)));
    result.high =
        reinterpret_cast<Doubles>(_mm512_mask_i32gather_pd(none, 0xFF, high, from, sizeof(double)));
#else
    for (int i = 0; i < DOUBLES; ++i) {
        result.low[i] = from[at[i]];
        result.high[i] = from[at[DOUBLES + i]];
    }
#endif
    return result;
#endif
}
[[gnu::always_inline]] inline Singles single(const DoublePair& pair) {  // rounded
    typedef float Halves __attribute__((vector_size(DOUBLES * 4)));
    const Halves low = __builtin_convertvector(pair.low, Halves);
    const Halves high = __builtin_convertvector(pair.high, Halves);
#if defined(__AVX512F__)
    return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#elif defined(__AVX__)
    return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
#else
    return __builtin_shufflevector(low, high, 0, 1, 2, 3);
#endif
}

}  // namespace LEVEL
}  // namespace lidar
