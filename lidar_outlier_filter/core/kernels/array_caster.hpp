// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The door: arrays of NumPy become views, and nothing else does. Nothing is converted or copied.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "array_view.hpp"

namespace py = pybind11;

namespace lidar {

// Whether an object is an array of T, whatever its order.
template <typename T>
bool is_array(py::handle object, int dimensions) {
    return py::isinstance<py::array_t<T>>(object) &&
           py::reinterpret_borrow<py::array>(object).ndim() == dimensions;
}

// What is wrong with an object that is no such array. Its words cost more than most kernels.
template <typename T>
std::string refusal(py::handle object, int dimensions, bool writes) {
    const auto wanted = std::to_string(dimensions) + "-dimensional array of " +
                        std::string(py::str(py::dtype::of<T>())) + ", in C order" +
                        (writes ? " and writable" : "") + " expected, got ";
    if (!py::isinstance<py::array>(object)) {
        return wanted + std::string(py::str(py::type::handle_of(object)));
    }
    return wanted + std::string(py::str(object.attr("dtype"))) + " of shape " +
           std::string(py::str(object.attr("shape")));
}

// An element of a tuple, which becomes what a member of a struct is.
struct Element {
    py::object object;

    template <typename T>
    operator T() const {
        return object.cast<T>();
    }
};

template <typename Struct, typename Places, typename = void>
struct is_made_of : std::false_type {};
template <typename Struct, std::size_t... Place>
struct is_made_of<Struct, std::index_sequence<Place...>,
                  std::void_t<decltype(Struct{(void(Place), std::declval<Element>())...})>>
    : std::true_type {};

// Counts the members of a struct.
template <typename Struct, std::size_t Count = 0>
constexpr std::size_t count_members() {
    if constexpr (is_made_of<Struct, std::make_index_sequence<Count + 1>>::value) {
        return count_members<Struct, Count + 1>();
    }
    return Count;
}

// Reads a NamedTuple, or any tuple, of arrays and numbers as a struct with so many first members.
template <typename Struct, std::size_t Count = count_members<Struct>()>
struct struct_caster {
    PYBIND11_TYPE_CASTER(Struct, py::detail::const_name("tuple"));

    bool load(py::handle source, bool /*convert*/) {
        if (!py::isinstance<py::sequence>(source) || py::len(source) != Count) {
            return false;
        }
        try {
            fill(py::reinterpret_borrow<py::sequence>(source), std::make_index_sequence<Count>());
        } catch (const py::cast_error&) {
            return false;
        }
        return true;
    }

private:
    template <std::size_t... Place>
    void fill(const py::sequence& elements, std::index_sequence<Place...> /*places*/) {
        value = Struct{Element{elements[Place]}...};
    }
};

}  // namespace lidar

// Reads a struct of this name, in the namespace pybind11::detail, member by member.
#define NAMED_TUPLE(name) \
    template <>           \
    struct type_caster<lidar::name> : lidar::struct_caster<lidar::name> {};

namespace pybind11::detail {

template <typename T, int Dimensions>
struct type_caster<lidar::View<T, Dimensions>> {
    using Element = std::remove_const_t<T>;
    using ViewType = lidar::View<T, Dimensions>;
    PYBIND11_TYPE_CASTER(ViewType, const_name("numpy.ndarray"));

    bool load(handle source, bool /*convert*/) {
        const bool fits = lidar::is_array<Element>(source, Dimensions);
        const auto array = reinterpret_borrow<pybind11::array>(source);
        if (!fits || (array.flags() & pybind11::array::c_style) == 0 ||
            !(array.writeable() || std::is_const_v<T>)) {
            throw type_error(lidar::refusal<Element>(source, Dimensions, !std::is_const_v<T>));
        }
        value.data = static_cast<T*>(const_cast<void*>(array.data()));
        for (int i = 0; i < Dimensions; ++i) {
            value.shape[i] = array.shape(i);
        }
        return true;
    }
};

template <typename T>
struct type_caster<lidar::Rows<T>> {
    using Element = std::remove_const_t<T>;
    PYBIND11_TYPE_CASTER(lidar::Rows<T>, const_name("numpy.ndarray"));

    bool load(handle source, bool /*convert*/) {
        if (!lidar::is_array<Element>(source, 2)) {
            throw type_error(lidar::refusal<Element>(source, 2, !std::is_const_v<T>));
        }
        const auto array = reinterpret_borrow<pybind11::array>(source);
        const ssize_t size = sizeof(Element);
        if ((array.shape(1) > 1 && array.strides(1) != size) || array.strides(0) < 0 ||
            array.strides(0) % size != 0 || !(array.writeable() || std::is_const_v<T>)) {
            throw type_error("rows expected whose elements lie side by side, in their order");
        }
        value.data = static_cast<T*>(const_cast<void*>(array.data()));
        value.shape = {array.shape(0), array.shape(1)};
        value.step = array.strides(0) / size;
        return true;
    }
};

template <typename T, int Dimensions>
struct type_caster<lidar::Owned<T, Dimensions>> {
    using OwnedType = lidar::Owned<T, Dimensions>;
    PYBIND11_TYPE_CASTER(OwnedType, const_name("numpy.ndarray"));

    static handle cast(OwnedType source, return_value_policy /*policy*/, handle /*parent*/) {
        auto kept = std::make_unique<std::vector<T>>(std::move(source.elements));
        T* const data = kept->data();
        const capsule owner(kept.release(),
                            [](void* held) { delete static_cast<std::vector<T>*>(held); });
        const std::vector<ssize_t> shape(source.shape.begin(), source.shape.end());
        return pybind11::array_t<T>(shape, data, owner).release();
    }
};

}  // namespace pybind11::detail
