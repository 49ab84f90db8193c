// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The compiled module, lidar_outlier_filter.core._kernels: what Python can call, by rooms.
//
// One file for all rooms, because each that includes pybind11 takes seven seconds to compile. Its
// stub is ../_kernels.pyi. Functions let go of the GIL, and check what they use as addresses.

#if defined(__x86_64__)
#include <cpuid.h>
#endif

#include <stdexcept>
#include <string>

#include "../detectors/alpha_beta_gamma/alpha_beta_gamma.hpp"
#include "../detectors/boosted_trees/neighbour_trees.hpp"
#include "../detectors/boosted_trees/pattern_trees.hpp"
#include "../detectors/distances.hpp"
#include "../detectors/elevation.hpp"
#include "../detectors/gabriel.hpp"
#include "../detectors/quadric/quadric.hpp"
#include "../neighbours/floor.hpp"
#include "../neighbours/neighbours.hpp"
#include "../neighbours/search.hpp"
#include "../neighbours/tree.hpp"
#include "../neighbours/tree_build.hpp"
#include "../neighbours/tree_caster.hpp"
#include "../neighbours/tree_walks.hpp"
#include "../points/points.hpp"
#include "../scan_pattern/pattern.hpp"
#include "../scan_pattern/scan_pattern.hpp"
#include "array_caster.hpp"
#include "lanes.hpp"
#include "levels.hpp"
#include "select.hpp"

using py::arg;

// Named tuples of Python, member by member.
namespace pybind11::detail {

template <>
struct type_caster<lidar::NearLists>
    : lidar::struct_caster<lidar::NearLists, lidar::Rows<const std::int32_t>,
                           lidar::View<const std::int32_t>, lidar::View<const lidar::Index>,
                           lidar::View<const std::int32_t>> {};

template <>
struct type_caster<lidar::Buffers>
    : lidar::struct_caster<lidar::Buffers, lidar::View<double, 2>, lidar::View<double, 2>,
                           lidar::View<std::int32_t>, lidar::View<std::int32_t>> {};

template <>
struct type_caster<lidar::Floor>
    : lidar::struct_caster<lidar::Floor, double, lidar::View<const double>, double,
                           lidar::View<const lidar::Index>, lidar::View<const double, 2>> {};

template <>
struct type_caster<lidar::Rules>
    : lidar::struct_caster<lidar::Rules, lidar::View<const double>, lidar::View<const double>,
                           double, lidar::Index, bool> {};

template <>
struct type_caster<lidar::Trees>
    : lidar::struct_caster<lidar::Trees, lidar::View<const std::int32_t, 2>,
                           lidar::View<const float, 2>, lidar::View<const float, 2>, float> {};

template <>
struct type_caster<lidar::Near>
    : lidar::struct_caster<lidar::Near, lidar::View<const double, 2>,
                           lidar::View<const std::int32_t, 2>, lidar::View<const double>,
                           lidar::Floor, lidar::View<const bool>> {};

template <>
struct type_caster<lidar::Far>
    : lidar::struct_caster<lidar::Far, lidar::Near, lidar::View<const float>,
                           lidar::View<const std::int32_t, 2>> {};

template <>
struct type_caster<lidar::Turn> : lidar::struct_caster<lidar::Turn, double, double, double> {};

template <>
struct type_caster<lidar::Windows>
    : lidar::struct_caster<lidar::Windows, lidar::Index, lidar::Index, lidar::Index, lidar::Index,
                           bool> {};

template <>
struct type_caster<lidar::Pattern>
    : lidar::struct_caster<
          lidar::Pattern, lidar::View<const lidar::Index>, lidar::View<const lidar::Index, 2>,
          lidar::View<const lidar::Index>, lidar::View<const lidar::Index>,
          lidar::View<const float>, lidar::View<const float>, lidar::View<const float>,
          lidar::View<const float>, lidar::View<const double>, lidar::View<const float, 2>,
          lidar::View<const float>, lidar::View<const float>, lidar::View<const float>,
          lidar::View<const float, 2>, lidar::View<const float>, lidar::View<const float>,
          lidar::View<const float>, lidar::View<const float>> {};

template <>
struct type_caster<lidar::Prepared>
    : lidar::struct_caster<lidar::Prepared, lidar::Pattern, lidar::View<const float>,
                           lidar::View<const std::int32_t, 2>, lidar::View<const float, 2>> {};

template <>
struct type_caster<lidar::FirstPass>
    : lidar::struct_caster<lidar::FirstPass, lidar::View<const float>,
                           lidar::View<const std::int32_t>, lidar::View<const float>, double> {};

template <>
struct type_caster<lidar::Segments>
    : lidar::struct_caster<lidar::Segments, lidar::View<const std::int32_t>,
                           lidar::View<const std::int32_t>> {};

template <>
struct type_caster<lidar::OrderedLines>
    : lidar::struct_caster<lidar::OrderedLines, lidar::View<const double, 2>,
                           lidar::View<const double>, lidar::View<lidar::Index>,
                           lidar::View<const lidar::Index>> {};

template <>
struct type_caster<lidar::Cells>
    : lidar::struct_caster<lidar::Cells, lidar::View<const lidar::Index>,
                           lidar::View<const lidar::Index>, lidar::View<lidar::Index>,
                           lidar::View<float>, lidar::View<float>, lidar::View<float>,
                           lidar::View<float>, lidar::View<double>> {};

}  // namespace pybind11::detail

namespace lidar {

int level = count_levels() - 1;

// What the processor and the system support, by CPUID: not all compilers' libraries can tell.
int count_levels() {
#if defined(__x86_64__)
    unsigned a = 0, b = 0, c = 0, d = 0;
    const unsigned OS_SAVES = bit_OSXSAVE | bit_AVX;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & OS_SAVES) != OS_SAVES) {
        return 1;
    }
    unsigned saved = 0, high = 0;  // the registers that the system saves (XCR0)
    __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || (saved & 0x6U) != 0x6U || !(b & bit_AVX2)) {
        return 1;
    }
    const unsigned WIDE = bit_AVX512F | bit_AVX512VL | bit_AVX512DQ | bit_AVX512BW;
    return (saved & 0xE6U) == 0xE6U && (b & WIDE) == WIDE ? 3 : 2;
#else
    return 1;
#endif
}

namespace {

using WithoutGil = py::call_guard<py::gil_scoped_release>;

py::tuple levels() {
    py::tuple names(count_levels());
    for (int i = 0; i < count_levels(); ++i) {
        names[i] = LEVEL_NAMES[i];
    }
    return names;
}

void set_level(const std::string& name) {
    for (int i = 0; i < count_levels(); ++i) {
        if (name == LEVEL_NAMES[i]) {
            level = i;
            return;
        }
    }
    throw std::invalid_argument("this processor has no level " + name);
}

// core/kernels ---------------------------------------------------------------------------------

void bind_kernels(py::module_& m) {
    m.def("levels", &levels);
    m.def("set_level", &set_level, arg("name"));
    m.def(
        "select",
        [](View<double> values, Index count, Index rank) {
            check(0 <= rank && rank < count && count <= values.size(), "a rank within the values");
            return base::select(values.data, count, rank);
        },
        arg("values"), arg("count"), arg("rank"), WithoutGil());
    m.def(
        "median",
        [](View<double> values, Index count) {
            check(0 < count && count <= values.size(), "at least one value");
            return base::median(values.data, count);
        },
        arg("values"), arg("count"), WithoutGil());
    m.attr("LANES") = base::LANES;
    m.def(
        "sort_lanes",
        [](View<double, 2> values, Index first, Index last) {
            const Index count = values.size();
            check(count <= base::MAX_SORTED && values.shape[1] == base::LANES, "(N, LANES) values");
            check_range(first, last, count);
            const auto network = base::make_network(
                static_cast<int>(count), static_cast<int>(first), static_cast<int>(last));
            base::sort(reinterpret_cast<double(*)[base::LANES]>(values.data), network);
        },
        arg("values"), arg("first"), arg("last"), WithoutGil());
}

// core/neighbours -----------------------------------------------------------------------------

void bind_neighbours(py::module_& m) {
    m.def("numbers", &numbers, arg("xyz"), WithoutGil());
    m.attr("LEAF") = base::LEAF;
    m.attr("FLOOR_WIDER") = base::WIDER;
    m.attr("FLOOR_FARTHEST") = base::FARTHEST;
    m.def("halve_node", &halve_node, arg("buffers"), arg("first"), arg("last"), arg("in_spare"),
          arg("patience"), WithoutGil());
    m.def("grow_tree", &grow_tree, arg("buffers"), arg("first"), arg("last"), arg("in_spare"),
          arg("patience"), WithoutGil());
    m.def("prune_tree", &prune_tree, arg("tree"), arg("first"), arg("last"), arg("xyz"),
          WithoutGil());
    m.def("keep_tree", &keep_tree, arg("tree"));
    m.def("search_nearest", AT_LEVEL(search_nearest), arg("xyz"), arg("tree"), arg("these"),
          arg("order"), arg("row"), arg("index"), arg("tied"), WithoutGil());
    m.def("tied_at", &tied_at, arg("xyz"), arg("index"), arg("k"), arg("begin"), arg("end"),
          arg("tied"), WithoutGil());
    m.def("squared_distances", &squared_distances, arg("xyz"), arg("index"), arg("k"), arg("begin"),
          arg("end"), arg("result"), WithoutGil());
    m.def("carry_over", &carry_over, arg("index"), arg("tied"), arg("new_index"), arg("begin"),
          arg("end"), arg("index_out"), arg("tied_out"), arg("row"), WithoutGil());
    m.def("list_within", &list_within, arg("xyz"), arg("tree"), arg("which"), arg("limits"),
          WithoutGil());
    m.def("find_copies", &find_copies, arg("order"), arg("xyz"), arg("tree"), arg("these"),
          WithoutGil());
    m.def("column_runs", &column_runs, arg("xyz"), arg("origin"), arg("side"), WithoutGil());
    m.def("write_floor", &write_floor, arg("wide"), arg("column"), arg("lowest"), arg("begin"),
          arg("end"), arg("floor"), WithoutGil());
    m.def("count_low", &count_low, arg("around"), arg("xyz"), WithoutGil());
    m.def("tree_height", &tree_height, arg("tree"), WithoutGil());
    m.def("tree_leaves", &tree_leaves, arg("tree"), WithoutGil());
}

// core/points, core/verdict -------------------------------------------------------------------

void bind_points(py::module_& m) {
    m.def("mark_returns", &mark_returns, arg("xyz"), arg("farthest"), arg("result"), WithoutGil());
    m.def("sort_by_line", &sort_by_line, arg("line"), arg("t"), arg("low"), arg("order"),
          arg("first"), WithoutGil());
    m.def("is_unchanged", &is_unchanged, arg("order"), WithoutGil());
    m.def("link_lines", &link_lines, arg("t"), arg("first"), arg("gap_factor"), arg("interval"),
          arg("before"), arg("after"), WithoutGil());
    m.def("count_turns", &count_turns, arg("angle"), arg("valid"), arg("noise"), arg("line"),
          arg("turn"), arg("result"), WithoutGil());
    m.def("find_masked", &find_masked, arg("xyz"), arg("line"), arg("valid"), arg("near"),
          arg("far"), arg("tolerance"), arg("result"), WithoutGil());
    m.def("find_columns", &find_columns, arg("xyz"), arg("columns"), arg("column"), arg("distance"),
          WithoutGil());
    m.def("move_points", &move_points, arg("xyz"), arg("t"), arg("covered"), arg("times"),
          arg("poses"), arg("mounted_at"), arg("mounted"), arg("result"), WithoutGil());
    m.def("add_scores", &add_scores, arg("bit"), arg("where"), arg("score"), arg("largest"),
          arg("detectors"), arg("undecided"), WithoutGil());
}

// core/scan_pattern ---------------------------------------------------------------------------

void bind_scan_pattern(py::module_& m) {
    m.attr("SAME_SHOT") = base::SAME_SHOT;
    m.attr("UNKNOWN_BRIGHTNESS") = base::UNKNOWN;
    m.attr("TURNING_LAG") = base::LAG;
    m.attr("MIN_RANGE_M") = base::MIN_RANGE_M;
    m.def("sort_nearly", &sort_nearly, arg("lines"), arg("begin"), arg("end"), arg("phase"),
          arg("up"), WithoutGil());
    m.def("join_shots", &join_shots, arg("lines"), arg("begin"), arg("end"), arg("phase"),
          arg("up"), WithoutGil());
    m.def("find_line_copies", &find_line_copies, arg("lines"), arg("phase"), arg("intensity"),
          arg("original"), WithoutGil());
    m.def("place_lines", &place_lines, arg("lines"), arg("phase"), arg("rank"), arg("begin"),
          arg("end"), arg("cells"), WithoutGil());
    m.def("write_ranges", &write_ranges, arg("xyz"), arg("order"), arg("first"), arg("position"),
          arg("moved"), arg("distance"), WithoutGil());
    m.def("usual_brightness", &usual_brightness, arg("order"), arg("reach"), arg("intensity"),
          arg("least"), WithoutGil());
    m.def("compare_brightness", &compare_brightness, arg("order"), arg("reach"), arg("intensity"),
          arg("usual"), arg("limits"), arg("begin"), arg("end"), arg("bright"), WithoutGil());
    m.def("write_directions", AT_LEVEL(write_directions), arg("lines"), arg("begin"), arg("end"),
          arg("azimuth"), arg("up"), WithoutGil());
    m.def("turning_rate", AT_LEVEL(turning_rate), arg("azimuth"), arg("t"), arg("first"),
          WithoutGil());
    m.def("unwrap_turns", AT_LEVEL(unwrap_turns), arg("azimuth"), arg("t"), arg("first"),
          arg("rate"), arg("begin"), arg("end"), arg("phase"), arg("steady"), WithoutGil());
    m.def("typical_of_lines", AT_LEVEL(typical_of_lines), arg("up"), arg("phase"), arg("first"),
          arg("elevation"), arg("step"), WithoutGil());
    m.def("spread", AT_LEVEL(spread), arg("flat"), arg("z"), arg("up"), arg("out"), WithoutGil());
    m.def("elevations", AT_LEVEL(elevations), arg("flat"), arg("z"), arg("up"), arg("out"),
          WithoutGil());
    m.def("times_of_turn", AT_LEVEL(times_of_turn), arg("xyz"), WithoutGil());
    m.def("find_peaks", &find_peaks, arg("count"), arg("least"), WithoutGil());
    m.def("fit_lines", AT_LEVEL(fit_lines), arg("xyz"), arg("turned"), WithoutGil());
    m.def("off_plane", AT_LEVEL(off_plane), arg("xyz"), arg("turned"), WithoutGil());
}

// core/detectors: SOR, LOF, elevation, Gabriel graph ------------------------------------------

void bind_detectors(py::module_& m) {
    m.def("average_distances", &average_distances, arg("xyz"), arg("lists"), arg("begin"),
          arg("end"), arg("result"), WithoutGil());
    m.def("write_densities", &write_densities, arg("near"), arg("xyz"), arg("square"), arg("begin"),
          arg("end"), arg("density"), WithoutGil());
    m.def("write_density_ratios", &write_density_ratios, arg("near"), arg("density"), arg("begin"),
          arg("end"), arg("factor"), WithoutGil());
    m.def("sort_rows_as_given", &sort_rows_as_given, arg("first"), arg("order"), arg("position"),
          arg("begin"), arg("end"), arg("more"), WithoutGil());
    m.def("elevation_differences", &elevation_differences, arg("elevation"), arg("index"),
          arg("begin"), arg("end"), arg("result"), WithoutGil());
    m.def("elevation_differences_of_lists", &elevation_differences_of_lists, arg("elevation"),
          arg("which"), arg("offsets"), arg("near"), arg("result"), WithoutGil());
    m.def("gabriel_edges", &gabriel_edges, arg("xyz"), arg("tree"), arg("begin"), arg("end"),
          WithoutGil());
    m.def("edge_lengths", &edge_lengths, arg("xyz"), arg("ends"), WithoutGil());
}

// core/detectors/alpha_beta_gamma -------------------------------------------------------------

void bind_alpha_beta_gamma(py::module_& m) {
    m.def("predict_in_tiles", AT_LEVEL(predict_in_tiles), arg("columns"), arg("pad"),
          arg("windows"), arg("result"), WithoutGil());
    m.def("predict_one_by_one", AT_LEVEL(predict_one_by_one), arg("columns"), arg("pad"),
          arg("before"), arg("after"), arg("which"), arg("slots"), arg("windows"), arg("result"),
          WithoutGil());
    m.def("find_near_ends", &find_near_ends, arg("before"), arg("after"), arg("reach_before"),
          arg("reach_after"), WithoutGil());
    m.def("estimate_precision", &estimate_precision, arg("standard"), arg("first"), arg("floor"),
          arg("result"), WithoutGil());
    m.def("score_windows", &score_windows, arg("standard"), arg("precision"), arg("which"),
          arg("critical"), arg("either"), arg("score"), arg("rank"), WithoutGil());
    m.def("find_worst", &find_worst, arg("failing"), arg("rank"), arg("before"), arg("after"),
          arg("reach"), arg("result"), WithoutGil());
    m.def("unlink_points", &unlink_points, arg("worst"), arg("before"), arg("after"), arg("reach"),
          arg("rejected"), WithoutGil());
}

// core/detectors/quadric ----------------------------------------------------------------------

void bind_quadric(py::module_& m) {
    m.attr("SURFACE_POINTS") = MIN_POINTS;
    m.def("sort_leaves", &sort_leaves, arg("xyz"), arg("tree"), arg("these"), arg("place"),
          WithoutGil());
    m.def("share_scores", &share_scores, arg("xyz"), arg("score"), WithoutGil());
    m.def("find_cores", &find_cores, arg("tree"), arg("most"), WithoutGil());
    m.def("find_window", &find_window, arg("xyz"), arg("tree"), arg("core"), arg("section"),
          WithoutGil());
    m.def("judge_window", AT_LEVEL(judge_window), arg("xyz"), arg("variance"), arg("rules"),
          WithoutGil());
    m.def("judge_sections", AT_LEVEL(judge_sections), arg("xyz"), arg("variance"), arg("tree"),
          arg("cores"), arg("section"), arg("rules"), arg("score"), WithoutGil());
    m.def("judge_patches", AT_LEVEL(judge_patches), arg("xyz"), arg("variance"), arg("nearest"),
          arg("place"), arg("rank"), arg("begin"), arg("end"), arg("rules"), arg("score"),
          WithoutGil());
}

// core/detectors/boosted_trees: neighbours ----------------------------------------------------

void bind_neighbour_trees(py::module_& m) {
    m.def("write_large_components", AT_LEVEL(write_large_components), arg("near"), arg("begin"),
          arg("end"), arg("is_large"), WithoutGil());
    m.def("judge_near", AT_LEVEL(judge_near), arg("near"), arg("trees"), arg("which"), arg("begin"),
          arg("end"), arg("odds"), arg("values"), WithoutGil());
    m.def("judge_far", AT_LEVEL(judge_far), arg("far"), arg("trees"), arg("which"), arg("begin"),
          arg("end"), arg("odds"), arg("values"), WithoutGil());
}

// core/detectors/boosted_trees: scan patterns -------------------------------------------------

void bind_pattern_trees(py::module_& m) {
    m.def("add_trees", AT_LEVEL(add_trees), arg("trees"), arg("features"), arg("total"),
          WithoutGil());
    m.def("add_contributions", AT_LEVEL(add_contributions), arg("trees"), arg("means"),
          arg("values"), arg("added"), WithoutGil());
    m.def("write_roughness", AT_LEVEL(write_roughness), arg("pattern"), arg("begin"), arg("end"),
          arg("rough"), WithoutGil());
    m.def("find_beside", AT_LEVEL(find_beside), arg("pattern"), arg("begin"), arg("end"),
          arg("near"), WithoutGil());
    m.def("find_segments", &find_segments, arg("pattern"), arg("reach"), WithoutGil());
    m.def("join_segments", &join_segments, arg("pattern"), arg("near"), arg("reach"),
          arg("segments"), WithoutGil());
    m.def("describe_groups", &describe_groups, arg("pattern"), arg("segments"), arg("group"),
          WithoutGil());
    m.def("write_groups", &write_groups, arg("pattern"), arg("segments"), arg("group"),
          arg("described"), arg("out"), WithoutGil());
    m.def("judge_pattern", AT_LEVEL(judge_pattern), arg("prepared"), arg("first"), arg("second"),
          arg("asked"), arg("trees"), arg("column"), arg("begin"), arg("end"), arg("odds"),
          arg("values"), WithoutGil());
    m.def("count_scores", &count_scores, arg("pattern"), arg("score"), WithoutGil());
    m.def("scale_odds", &scale_odds, arg("pattern"), arg("odds"), arg("least"), arg("limit"),
          arg("begin"), arg("end"), arg("score"), arg("rejected"), WithoutGil());
}

}  // namespace

PYBIND11_MODULE(_kernels, m) {
    m.doc() = "Loops over points, compiled: see the .cpp files beside the Python of each room.";
    bind_kernels(m);
    bind_neighbours(m);
    bind_points(m);
    bind_scan_pattern(m);
    bind_detectors(m);
    bind_alpha_beta_gamma(m);
    bind_quadric(m);
    bind_neighbour_trees(m);
    bind_pattern_trees(m);
}

}  // namespace lidar
