// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Arrays of NumPy as the kernels see them: without Python, and without an owner.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace lidar {

using Index = std::int64_t;

// Refuses an index beyond an array, where scripts/sanitize builds: an IndexError in Python.
[[gnu::always_inline]] inline void check_index([[maybe_unused]] Index i, [[maybe_unused]] Index n) {
#if defined(LIDAR_CHECK_BOUNDS)
    if (i < 0 || i >= n) {
        throw std::out_of_range("index " + std::to_string(i) + " of " + std::to_string(n));
    }
#endif
}

// Elements in C order. The door (array_caster.hpp) has checked type, dimensions and order; whoever
// takes elements as addresses checks these. A const element is read only.
template <typename T, int Dimensions = 1>
struct View {
    T* data = nullptr;
    std::array<Index, Dimensions> shape{};

    [[gnu::always_inline]] T& operator[](Index i) const {
        static_assert(Dimensions == 1, "rows are taken by row()");
        check_index(i, shape[0]);
        return data[i];
    }
    [[gnu::always_inline]] T& operator()(Index i, Index j) const {
        static_assert(Dimensions == 2, "of two dimensions");
        check_index(i, shape[0]);
        check_index(j, shape[1]);
        return data[i * shape[1] + j];
    }
    [[gnu::always_inline]] T& operator()(Index i, Index j, Index k) const {
        static_assert(Dimensions == 3, "of three dimensions");
        check_index(i, shape[0]);
        check_index(j, shape[1]);
        check_index(k, shape[2]);
        return data[(i * shape[1] + j) * shape[2] + k];
    }
    [[gnu::always_inline]] T* row(Index i) const {
        static_assert(Dimensions == 2, "of two dimensions");
        return data + i * shape[1];
    }
    [[gnu::always_inline]] Index size() const {  // along the first dimension, as len()
        return shape[0];
    }
    [[gnu::always_inline]] operator View<const T, Dimensions>() const {
        return {data, shape};
    }
};

// Rows whose elements lie side by side, the rows themselves maybe further apart: some first columns
// of an array.
template <typename T>
struct Rows {
    T* data = nullptr;
    std::array<Index, 2> shape{};
    Index step = 0;  // elements from one row to the next

    [[gnu::always_inline]] T& operator()(Index i, Index j) const {
        check_index(i, shape[0]);
        check_index(j, shape[1]);
        return data[i * step + j];
    }
    [[gnu::always_inline]] T* row(Index i) const {
        return data + i * step;
    }
    [[gnu::always_inline]] Index size() const {
        return shape[0];
    }
};

// An array that a kernel makes and Python gets.
template <typename T, int Dimensions = 1>
struct Owned {
    std::vector<T> elements;
    std::array<Index, Dimensions> shape{};

    Owned() = default;
    explicit Owned(std::vector<T> values) : elements(std::move(values)) {
        static_assert(Dimensions == 1, "of one dimension");
        shape[0] = static_cast<Index>(elements.size());
    }
    Owned(std::vector<T> values, std::array<Index, Dimensions> dimensions)
        : elements(std::move(values)), shape(dimensions) {}
};

// Refuses arguments that do not fit together: a ValueError in Python.
inline void check(bool fits, const char* sentence) {
    if (!fits) {
        throw std::invalid_argument(sentence);
    }
}

// Refuses a range that is not within `size`.
inline void check_range(Index begin, Index end, Index size) {
    check(0 <= begin && begin <= end && end <= size, "begin and end must lie within the array");
}

// Refuses numbers that are used as indices and are not within `size`.
template <typename T>
inline void check_indices(View<T> indices, Index size) {
    std::uint64_t signs = 0;  // a loop without branches or comparisons, which is fast at any level
    for (Index i = 0; i < indices.size(); ++i) {
        const auto index = static_cast<std::uint64_t>(static_cast<Index>(indices[i]));
        signs |= index | (static_cast<std::uint64_t>(size) - 1 - index);
    }
    check(signs >> 63U == 0, "indices must lie within the array that they are of");
}

// Refuses rows of a range with numbers that are used as indices and are not within `size`.
template <typename T>
inline void check_indices(Rows<T> rows, Index begin, Index end, Index size) {
    check_range(begin, end, rows.size());
    using Unsigned = std::make_unsigned_t<std::remove_const_t<T>>;  // negative ones are huge
    Unsigned most = 0;
    for (Index i = begin; i < end; ++i) {
        const T* const row = rows.row(i);
        for (Index j = 0; j < rows.shape[1]; ++j) {
            most = std::max(most, static_cast<Unsigned>(row[j]));
        }
    }
    check(begin == end || rows.shape[1] == 0 || most < static_cast<std::uint64_t>(size),
          "indices must lie within the array that they are of");
}

}  // namespace lidar
