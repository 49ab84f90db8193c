// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The compiled module of the laboratory, lidar_outlier_lab._kernels: its stub is _kernels.pyi.
//
// As that of the product, lidar_outlier_filter/core/kernels/module.cpp.

#include "../lidar_outlier_filter/core/kernels/array_caster.hpp"
#include "simulation/world/caster.hpp"
#include "simulation/world/kernels.hpp"

namespace pybind11::detail {

NAMED_TUPLE(Grids)

}  // namespace pybind11::detail

namespace lidar {

PYBIND11_MODULE(_kernels, m) {
    using WithoutGil = py::call_guard<py::gil_scoped_release>;
    m.doc() =
        "Loops over rays, compiled: see the .cpp files beside the Python of simulation/world.";
    m.attr("GROUND") = static_cast<int>(base::GROUND);
    m.attr("BOX") = static_cast<int>(base::BOX);
    m.attr("BUILDING") = static_cast<int>(base::BUILDING);
    m.attr("TUBE") = static_cast<int>(base::TUBE);
    m.attr("ARM") = static_cast<int>(base::ARM);
    m.attr("BALL") = static_cast<int>(base::BALL);
    m.attr("LID") = static_cast<int>(base::LID);
    m.attr("CROWN") = static_cast<int>(base::CROWN);
    m.attr("LOW") = base::LOW;
    m.attr("HIGH") = base::HIGH;
    m.attr("VELOCITY") = base::VELOCITY;
    m.attr("REST") = base::REST;
    m.attr("WIDTH") = base::WIDTH;
    m.attr("ROUND") = base::ROUND;
    m.attr("PANE") = base::PANE;
    m.def("cast_rays", &cast_rays, WithoutGil());
    m.def("view_top", &view_top, WithoutGil());
    m.def("descend", &descend, WithoutGil());
    m.def("strongest", &strongest, WithoutGil());
}

}  // namespace lidar
