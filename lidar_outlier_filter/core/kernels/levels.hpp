// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Levels of instructions. A file called *.dispatch.cpp is compiled once for each level, into a
// namespace of that name; which one runs is chosen when the module is loaded. All give the same
// bits, because products are never fused with sums (-ffp-contract=off).
//
// The linker keeps one of several equal inline functions. Therefore those of our own headers lie in
// the namespace LEVEL, and the build links files of lower levels first: so no function of a
// higher level can get into code of a lower one.
#pragma once

#ifndef LEVEL
#define LEVEL base
#endif

#if defined(__x86_64__)
#define LIDAR_LEVELS 3
// Declares a function once for each level.
#define FOR_EACH_LEVEL(...) \
    namespace base {        \
    __VA_ARGS__             \
    }                       \
    namespace avx2 {        \
    __VA_ARGS__             \
    }                       \
    namespace avx512 {      \
    __VA_ARGS__             \
    }
// The function of the level that is in force, as an argument of m.def().
#define AT_LEVEL(name) (&lidar::dispatch<&base::name, &avx2::name, &avx512::name>::call)
#else
#define LIDAR_LEVELS 1
#define FOR_EACH_LEVEL(...) \
    namespace base {        \
    __VA_ARGS__             \
    }
#define AT_LEVEL(name) (&lidar::dispatch<&base::name>::call)
#endif

namespace lidar {

// Names of the levels that this processor has, from the lowest.
inline constexpr const char* LEVEL_NAMES[] = {"base", "avx2", "avx512"};
int count_levels();

extern int level;  // the number of the one in force; module.cpp sets it

template <auto... AtLevel>
struct dispatch;

template <typename Result, typename... Arguments, Result (*... AtLevel)(Arguments...)>
struct dispatch<AtLevel...> {
    static Result call(Arguments... arguments) {
        static constexpr Result (*functions[])(Arguments...) = {AtLevel...};
        return functions[level](arguments...);
    }
};

}  // namespace lidar
