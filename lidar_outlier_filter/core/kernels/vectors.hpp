// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Vectors in registers, by extensions that g++ and clang++ have. Each element gets what a loop over
// numbers would give it, bit by bit; so results do not depend on the width, which is that of
// the level's registers (wider types are taken apart badly).
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "array_view.hpp"
#include "levels.hpp"

namespace lidar {
namespace LEVEL {

#if defined(__AVX512F__)
inline constexpr int WIDTH = 16;  // singles
#elif defined(__AVX__)
inline constexpr int WIDTH = 8;
#else
inline constexpr int WIDTH = 4;
#endif
inline constexpr int DOUBLES = WIDTH / 2;

typedef float Singles __attribute__((vector_size(WIDTH * 4)));
typedef std::int32_t Counts __attribute__((vector_size(WIDTH * 4)));  // and masks: 0 or -1
typedef double Doubles __attribute__((vector_size(WIDTH * 4)));
typedef std::int64_t Wides __attribute__((vector_size(WIDTH * 4)));  // masks of doubles: 0 or -1

[[gnu::always_inline]] inline Singles load(const float* from) {
    Singles result;
    std::memcpy(&result, from, sizeof result);
    return result;
}
[[gnu::always_inline]] inline Counts load(const std::int32_t* from) {
    Counts result;
    std::memcpy(&result, from, sizeof result);
    return result;
}
[[gnu::always_inline]] inline void store(float* to, Singles values) {
    std::memcpy(to, &values, sizeof values);
}
[[gnu::always_inline]] inline void store(std::int32_t* to, Counts values) {
    std::memcpy(to, &values, sizeof values);
}
[[gnu::always_inline]] inline Singles repeat(float value) {
    return Singles{} + value;
}
[[gnu::always_inline]] inline Singles choose(Counts mask, Singles one, Singles other) {
    return mask ? one : other;
}
[[gnu::always_inline]] inline Singles least(Singles one, Singles other) {  // as min() of Python
    return other < one ? other : one;
}
[[gnu::always_inline]] inline Singles most(Singles one, Singles other) {  // as max() of Python
    return other > one ? other : one;
}
[[gnu::always_inline]] inline Singles size_of(Singles values) {  // without the sign
    return reinterpret_cast<Singles>(reinterpret_cast<Counts>(values) & 0x7FFFFFFF);
}
[[gnu::always_inline]] inline Singles root(Singles values) {
    for (int i = 0; i < WIDTH; ++i) {
        values[i] = std::sqrt(values[i]);
    }
    return values;
}

[[gnu::always_inline]] inline Doubles load(const double* from) {
    Doubles result;
    std::memcpy(&result, from, sizeof result);
    return result;
}
[[gnu::always_inline]] inline void store(double* to, Doubles values) {
    std::memcpy(to, &values, sizeof values);
}
[[gnu::always_inline]] inline void store(float* to, Doubles values) {  // rounded
    typedef float Halves __attribute__((vector_size(DOUBLES * 4)));
    const Halves rounded = __builtin_convertvector(values, Halves);
    std::memcpy(to, &rounded, sizeof rounded);
}
[[gnu::always_inline]] inline Doubles repeat(double value) {
    return Doubles{} + value;
}
[[gnu::always_inline]] inline Doubles choose(Wides mask, Doubles one, Doubles other) {
    return mask ? one : other;
}
[[gnu::always_inline]] inline Doubles least(Doubles one, Doubles other) {
    return other < one ? other : one;
}
[[gnu::always_inline]] inline Doubles most(Doubles one, Doubles other) {
    return other > one ? other : one;
}
[[gnu::always_inline]] inline Doubles size_of(Doubles values) {
    return reinterpret_cast<Doubles>(reinterpret_cast<Wides>(values) & 0x7FFFFFFFFFFFFFFF);
}
[[gnu::always_inline]] inline Doubles root(Doubles values) {
    for (int i = 0; i < DOUBLES; ++i) {
        values[i] = std::sqrt(values[i]);
    }
    return values;
}

[[gnu::always_inline]] inline Singles single(Counts counts) {
    return __builtin_convertvector(counts, Singles);
}

}  // namespace LEVEL
}  // namespace lidar
