// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// Trees at the door. Searches take a tree a thousand times, so checking it each time would cost
// more than they do: keep_tree() checks it once, and gives it arrays that nobody can write. Others,
// made by Python, are checked by whoever walks through them.
#pragma once

#include <utility>
#include <vector>

#include "../kernels/array_caster.hpp"
#include "tree.hpp"

namespace lidar {

struct KeptTree {
    std::vector<double> low, high;
    std::vector<Index> first, last, child;
    Index levels;
};

inline constexpr const char* KEPT_TREE = "lidar_outlier_filter.KeptTree";

template <typename T>
py::array read_only(const std::vector<T>& values, std::vector<py::ssize_t> shape,
                    const py::capsule& owner) {
    py::array_t<T> array(std::move(shape), values.data(), owner);
    py::detail::array_proxy(array.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
    return std::move(array);
}

// Returns the arrays of a tree over so many points, as a tuple, checked and read only.
inline py::tuple keep_tree(const Tree& tree) {
    const Index levels = tree_height(tree);
    const Index nodes = tree.child.size();
    auto* const kept = new KeptTree{
        {tree.low.data, tree.low.data + 3 * nodes}, {tree.high.data, tree.high.data + 3 * nodes},
        {tree.first.data, tree.first.data + nodes}, {tree.last.data, tree.last.data + nodes},
        {tree.child.data, tree.child.data + nodes}, levels};
    const py::capsule owner(kept, KEPT_TREE, [](PyObject* capsule) {
        delete static_cast<KeptTree*>(PyCapsule_GetPointer(capsule, KEPT_TREE));
    });
    return py::make_tuple(
        read_only(kept->low, {nodes, 3}, owner), read_only(kept->high, {nodes, 3}, owner),
        read_only(kept->first, {nodes}, owner), read_only(kept->last, {nodes}, owner),
        read_only(kept->child, {nodes}, owner));
}

}  // namespace lidar

namespace pybind11::detail {

template <>
struct type_caster<lidar::Tree> {
    PYBIND11_TYPE_CASTER(lidar::Tree, const_name("tuple"));

    bool load(handle source, bool convert) {
        lidar::struct_caster<lidar::Tree, 5> members;  // without the levels
        if (!members.load(source, convert)) {
            return false;
        }
        value = static_cast<lidar::Tree&>(members);
        const object base = reinterpret_borrow<array>(object(source[int_(0)])).attr("base");
        if (PyCapsule_IsValid(base.ptr(), lidar::KEPT_TREE) != 0) {
            const auto* kept = static_cast<const lidar::KeptTree*>(
                PyCapsule_GetPointer(base.ptr(), lidar::KEPT_TREE));
            // These very arrays: then nothing in them has changed since they were checked.
            const auto nodes = static_cast<lidar::Index>(kept->child.size());
            const bool is_it =
                value.low.data == kept->low.data() && value.high.data == kept->high.data() &&
                value.first.data == kept->first.data() && value.last.data == kept->last.data() &&
                value.child.data == kept->child.data() && value.low.size() == nodes &&
                value.high.size() == nodes && value.first.size() == nodes &&
                value.last.size() == nodes && value.child.size() == nodes;
            value.levels = is_it ? kept->levels : 0;
        }
        return true;
    }
};

}  // namespace pybind11::detail
