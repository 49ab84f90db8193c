// SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
// SPDX-License-Identifier: Apache-2.0
//
// The compiled module, lidar_outlier_filter.core._kernels: what Python can call, by rooms.
//
// One file for all rooms, because each that includes pybind11 takes seven seconds to compile. Its
// stub, which names the arguments, is ../_kernels.pyi. Functions let go of the GIL, and check what
// they use as addresses.

#if defined(__x86_64__)
#include <cpuid.h>
#endif

#include <stdexcept>
#include <string>

#include "../detectors/alpha_beta_gamma/alpha_beta_gamma.hpp"
#include "../detectors/boosted_trees/neighbour_trees.hpp"
#include "../detectors/boosted_trees/pattern_trees.hpp"
#include "../detectors/detectors.hpp"
#include "../detectors/quadric/quadric.hpp"
#include "../neighbours/floor.hpp"
#include "../neighbours/neighbours.hpp"
#include "../neighbours/tree.hpp"
#include "../neighbours/tree_build.hpp"
#include "../neighbours/tree_caster.hpp"
#include "../points/points.hpp"
#include "../scan_pattern/pattern.hpp"
#include "../scan_pattern/scan_pattern.hpp"
#include "array_caster.hpp"
#include "lanes.hpp"
#include "levels.hpp"

// Named tuples of Python.
namespace pybind11::detail {

NAMED_TUPLE(NearLists)
NAMED_TUPLE(Buffers)
NAMED_TUPLE(Floor)
NAMED_TUPLE(Rules)
NAMED_TUPLE(Trees)
NAMED_TUPLE(Near)
NAMED_TUPLE(Far)
NAMED_TUPLE(Turn)
NAMED_TUPLE(Windows)
NAMED_TUPLE(Pattern)
NAMED_TUPLE(Prepared)
NAMED_TUPLE(FirstPass)
NAMED_TUPLE(Segments)
NAMED_TUPLE(OrderedLines)
NAMED_TUPLE(Cells)

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

}  // namespace

PYBIND11_MODULE(_kernels, m) {
    m.doc() = "Loops over points, compiled: see the .cpp files beside the Python of each room.";

    // core/kernels
    m.def("levels", &levels);
    m.def("set_level", &set_level);
    m.attr("LANES") = base::LANES;

    // core/neighbours
    m.def("numbers", &numbers, WithoutGil());
    m.attr("LEAF") = base::LEAF;
    m.attr("FLOOR_WIDER") = base::WIDER;
    m.attr("FLOOR_FARTHEST") = base::FARTHEST;
    m.def("halve_node", &halve_node, WithoutGil());
    m.def("grow_tree", &grow_tree, WithoutGil());
    m.def("prune_tree", &prune_tree, WithoutGil());
    m.def("keep_tree", &keep_tree);
    m.def("search_nearest", AT_LEVEL(search_nearest), WithoutGil());
    m.def("squared_distances", &squared_distances, WithoutGil());
    m.def("carry_over", &carry_over, WithoutGil());
    m.def("list_within", &list_within, WithoutGil());
    m.def("find_copies", &find_copies, WithoutGil());
    m.def("column_runs", &column_runs, WithoutGil());
    m.def("write_floor", &write_floor, WithoutGil());
    m.def("count_low", &count_low, WithoutGil());
    m.def("subtrees", &subtrees, WithoutGil());

    // core/points, core/verdict
    m.def("mark_returns", &mark_returns, WithoutGil());
    m.def("sort_by_line", &sort_by_line, WithoutGil());
    m.def("link_lines", &link_lines, WithoutGil());
    m.def("count_turns", &count_turns, WithoutGil());
    m.def("find_masked", &find_masked, WithoutGil());
    m.def("find_columns", &find_columns, WithoutGil());
    m.def("move_points", &move_points, WithoutGil());
    m.def("add_scores", &add_scores, WithoutGil());

    // core/scan_pattern
    m.attr("SAME_SHOT") = base::SAME_SHOT;
    m.attr("UNKNOWN_BRIGHTNESS") = base::UNKNOWN;
    m.attr("TURNING_LAG") = base::LAG;
    m.attr("MIN_RANGE_M") = base::MIN_RANGE_M;
    m.def("sort_nearly", &sort_nearly, WithoutGil());
    m.def("join_shots", &join_shots, WithoutGil());
    m.def("find_line_copies", &find_line_copies, WithoutGil());
    m.def("place_lines", &place_lines, WithoutGil());
    m.def("write_ranges", &write_ranges, WithoutGil());
    m.def("usual_brightness", &usual_brightness, WithoutGil());
    m.def("compare_brightness", &compare_brightness, WithoutGil());
    m.def("write_directions", AT_LEVEL(write_directions), WithoutGil());
    m.def("turning_rate", AT_LEVEL(turning_rate), WithoutGil());
    m.def("unwrap_turns", AT_LEVEL(unwrap_turns), WithoutGil());
    m.def("typical_of_lines", AT_LEVEL(typical_of_lines), WithoutGil());
    m.def("spread", AT_LEVEL(spread), WithoutGil());
    m.def("elevations", AT_LEVEL(elevations), WithoutGil());
    m.def("times_of_turn", AT_LEVEL(times_of_turn), WithoutGil());
    m.def("find_peaks", &find_peaks, WithoutGil());
    m.def("fit_lines", AT_LEVEL(fit_lines), WithoutGil());
    m.def("off_plane", AT_LEVEL(off_plane), WithoutGil());

    // core/detectors: SOR, LOF, elevation, Gabriel graph
    m.def("average_distances", &average_distances, WithoutGil());
    m.def("write_densities", &write_densities, WithoutGil());
    m.def("write_density_ratios", &write_density_ratios, WithoutGil());
    m.def("sort_rows_as_given", &sort_rows_as_given, WithoutGil());
    m.def("elevation_differences", &elevation_differences, WithoutGil());
    m.def("gabriel_edges", &gabriel_edges, WithoutGil());

    // core/detectors/alpha_beta_gamma
    m.def("predict_in_tiles", AT_LEVEL(predict_in_tiles), WithoutGil());
    m.def("predict_one_by_one", AT_LEVEL(predict_one_by_one), WithoutGil());
    m.def("estimate_precision", &estimate_precision, WithoutGil());
    m.def("score_windows", &score_windows, WithoutGil());
    m.def("find_worst", &find_worst, WithoutGil());
    m.def("unlink_points", &unlink_points, WithoutGil());

    // core/detectors/quadric
    m.attr("SURFACE_POINTS") = MIN_POINTS;
    m.def("sort_leaves", &sort_leaves, WithoutGil());
    m.def("judge_sections", AT_LEVEL(judge_sections), WithoutGil());
    m.def("judge_patches", AT_LEVEL(judge_patches), WithoutGil());

    // core/detectors/boosted_trees: neighbours
    m.def("write_large_components", AT_LEVEL(write_large_components), WithoutGil());
    m.def("judge_near", AT_LEVEL(judge_near), WithoutGil());
    m.def("judge_far", AT_LEVEL(judge_far), WithoutGil());

    // core/detectors/boosted_trees: scan patterns
    m.def("add_trees", AT_LEVEL(add_trees), WithoutGil());
    m.def("add_contributions", AT_LEVEL(add_contributions), WithoutGil());
    m.def("write_roughness", AT_LEVEL(write_roughness), WithoutGil());
    m.def("find_beside", AT_LEVEL(find_beside), WithoutGil());
    m.def("find_segments", &find_segments, WithoutGil());
    m.def("join_segments", &join_segments, WithoutGil());
    m.def("describe_groups", &describe_groups, WithoutGil());
    m.def("write_groups", &write_groups, WithoutGil());
    m.def("write_heights", &write_heights, WithoutGil());
    m.def("judge_pattern", AT_LEVEL(judge_pattern), WithoutGil());
    m.def("find_panes", AT_LEVEL(find_panes), WithoutGil());
    m.def("count_scores", &count_scores, WithoutGil());
    m.def("scale_odds", &scale_odds, WithoutGil());
}

}  // namespace lidar
