# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
#
# The compiled loops over points, by rooms: kernels/module.cpp has the same order.
#
# Arrays have the type and the number of dimensions that are said, in C order; nothing is converted.
# TypeError: an array of another kind. ValueError: arrays that do not fit together.

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Floats, Index, Ints, Singles, Triple
from lidar_outlier_filter.core.detectors.boosted_trees.neighbour_features import Far, Near
from lidar_outlier_filter.core.detectors.boosted_trees.pattern_trees import FirstPass
from lidar_outlier_filter.core.detectors.boosted_trees.profile_features import Segments
from lidar_outlier_filter.core.detectors.boosted_trees.trees import Trees
from lidar_outlier_filter.core.detectors.boosted_trees.window import Prepared
from lidar_outlier_filter.core.detectors.quadric.detector import Rules
from lidar_outlier_filter.core.neighbours.floor import Floor
from lidar_outlier_filter.core.neighbours.tree_build import Tree
from lidar_outlier_filter.core.scan_pattern.placed_pattern import OrderedLines, Pattern

# core/kernels -------------------------------------------------------------------------------------

def levels() -> tuple[str, ...]: ...
def set_level(name: str) -> None: ...

LANES: int  # points side by side

# core/neighbours ----------------------------------------------------------------------------------

def numbers(xyz: Floats) -> Ints: ...

LEAF: int
FLOOR_WIDER: int
FLOOR_FARTHEST: float

_Buffers: TypeAlias = tuple[Floats, Floats, Index, Index]
_Tree: TypeAlias = tuple[Floats, Floats, Ints, Ints, Ints]

def halve_node(
    buffers: _Buffers, first: int, last: int, in_spare: bool, patience: int
) -> tuple[int, int]: ...
def grow_tree(buffers: _Buffers, first: int, last: int, in_spare: bool, patience: int) -> _Tree: ...
def prune_tree(tree: Tree, first: Ints, last: Ints, xyz: Floats) -> _Tree: ...
def keep_tree(tree: Tree) -> _Tree: ...
def search_nearest(
    xyz: Floats, tree: Tree, these: Ints, order: Ints, row: Index, index: Index, tied: Bools
) -> None: ...
def squared_distances(
    xyz: Floats, index: Index, k: int, begin: int, end: int, result: Floats
) -> None: ...
def carry_over(
    index: Index,
    tied: Bools,
    new_index: Index,
    begin: int,
    end: int,
    index_out: Index,
    tied_out: Bools,
    row: Index,
) -> None: ...
def list_within(xyz: Floats, tree: Tree, which: Ints, limits: Floats) -> tuple[Ints, Index]: ...
def find_copies(order: Ints, xyz: Floats, tree: Tree, these: Ints) -> Ints: ...
def column_runs(xyz: Floats, origin: Floats, side: float) -> tuple[Ints, Floats]: ...
def write_floor(
    wide: Ints, column: Ints, lowest: Floats, begin: int, end: int, floor: Floats
) -> None: ...
def count_low(around: Floor, xyz: Floats) -> int: ...
def subtrees(tree: Tree, most: int) -> Ints: ...

# core/points, core/verdict ------------------------------------------------------------------------

def mark_returns(xyz: Floats, farthest: float, result: Bools) -> int: ...
def sort_by_line(line: Ints, t: Ints, low: int, order: Ints, first: Ints) -> Ints: ...
def link_lines(
    t: Ints, first: Ints, gap_factor: float, interval: Floats, before: Ints, after: Ints
) -> None: ...
def count_turns(
    angle: Floats, valid: Bools, noise: float, line: int, turn: Triple, result: Ints
) -> tuple[int, float, float, float]: ...
def find_masked(
    xyz: Floats,
    line: Ints,
    valid: Bools,
    near: Floats,
    far: Floats,
    tolerance: float,
    result: Bools,
) -> None: ...
def find_columns(xyz: Floats, columns: int, column: Ints, distance: Floats) -> None: ...
def move_points(
    xyz: Floats,
    t: Ints,
    covered: Bools,
    times: Ints,
    poses: Floats,
    mounted_at: Floats,
    mounted: Floats,
    result: Floats,
) -> None: ...
def add_scores(
    bit: int,
    where: Ints,
    score: Floats,
    largest: Singles,
    detectors: NDArray[np.uint16],
    undecided: NDArray[np.uint16],
) -> None: ...

# core/scan_pattern --------------------------------------------------------------------------------

SAME_SHOT: float
UNKNOWN_BRIGHTNESS: float
TURNING_LAG: int
MIN_RANGE_M: float  # of a profile scanner

def sort_nearly(lines: OrderedLines, begin: int, end: int, phase: Floats, up: Floats) -> Ints: ...
def join_shots(lines: OrderedLines, begin: int, end: int, phase: Floats, up: Floats) -> None: ...
def find_line_copies(
    lines: OrderedLines, phase: Floats, intensity: Singles, original: Ints
) -> int: ...
def place_lines(
    lines: OrderedLines,
    phase: Floats,
    rank: Ints,
    begin: int,
    end: int,
    cells: tuple[Ints, Ints, Ints, Singles, Singles, Singles, Singles, Floats],
) -> None: ...
def write_ranges(
    xyz: Floats, order: Ints, first: Ints, position: Floats, moved: Floats, distance: Floats
) -> None: ...
def usual_brightness(order: Ints, reach: Singles, intensity: Singles, least: int) -> Singles: ...
def compare_brightness(
    order: Ints,
    reach: Singles,
    intensity: Singles,
    usual: Singles,
    limits: Floats,
    begin: int,
    end: int,
    bright: Singles,
) -> None: ...
def write_directions(
    lines: OrderedLines, begin: int, end: int, azimuth: Floats, up: Floats
) -> None: ...
def turning_rate(azimuth: Floats, t: Ints, first: Ints) -> float: ...
def unwrap_turns(
    azimuth: Floats,
    t: Ints,
    first: Ints,
    rate: float,
    begin: int,
    end: int,
    phase: Floats,
    steady: Ints,
) -> None: ...
def typical_of_lines(
    up: Floats, phase: Floats, first: Ints, elevation: Floats, step: Floats
) -> None: ...
def spread(flat: Floats, z: Floats, up: float, out: float) -> float: ...
def elevations(flat: Floats, z: Floats, up: float, out: float) -> Floats: ...
def times_of_turn(xyz: Floats) -> Ints: ...
def find_peaks(count: Ints, least: int) -> Ints: ...
def fit_lines(xyz: Floats, turned: Floats) -> tuple[Floats, Floats, Floats, Floats]: ...
def off_plane(xyz: Floats, turned: Floats) -> Floats: ...

# core/detectors: SOR, LOF, elevation, Gabriel graph -----------------------------------------------

_Near: TypeAlias = tuple[Index, Index, Ints, Index]

def average_distances(xyz: Floats, lists: Index, begin: int, end: int, result: Floats) -> None: ...
def write_densities(
    near: _Near, xyz: Floats, square: Floats, begin: int, end: int, density: Floats
) -> None: ...
def write_density_ratios(
    near: _Near, density: Floats, begin: int, end: int, factor: Floats
) -> None: ...
def sort_rows_as_given(
    first: Ints, order: Ints, position: Ints, begin: int, end: int, more: Index
) -> None: ...
def elevation_differences(
    elevation: Floats, index: Index, begin: int, end: int, result: Floats
) -> None: ...
def gabriel_edges(xyz: Floats, tree: Tree, begin: int, end: int) -> Index: ...

# core/detectors/alpha_beta_gamma ------------------------------------------------------------------

def predict_in_tiles(
    columns: Floats, pad: int, windows: tuple[int, int, int, int, bool], result: Floats
) -> None: ...
def predict_one_by_one(
    columns: Floats,
    pad: int,
    before: Ints,
    after: Ints,
    which: Ints,
    slots: Ints,
    windows: tuple[int, int, int, int, bool],
    result: Floats,
) -> None: ...
def estimate_precision(standard: Floats, first: Ints, floor: float, result: Floats) -> None: ...
def score_windows(
    standard: Floats,
    precision: Floats,
    which: Ints,
    critical: float,
    either: bool,
    score: Floats,
    rank: Floats,
) -> None: ...
def find_worst(
    failing: Ints, rank: Floats, before: Ints, after: Ints, reach: int, result: Bools
) -> None: ...
def unlink_points(worst: Ints, before: Ints, after: Ints, reach: int, rejected: Bools) -> Ints: ...

# core/detectors/quadric ---------------------------------------------------------------------------

SURFACE_POINTS: int  # of a surface, at least

def sort_leaves(xyz: Floats, tree: Tree, these: Ints, place: Ints) -> None: ...
def judge_sections(
    xyz: Floats,
    variance: Floats,
    tree: Tree,
    cores: Ints,
    section: int,
    rules: Rules,
    score: Floats,
) -> tuple[Ints, Floats]: ...
def judge_patches(
    xyz: Floats,
    variance: Floats,
    nearest: Index,
    place: Ints,
    rank: Ints,
    begin: int,
    end: int,
    rules: Rules,
    score: Floats,
) -> None: ...

# core/detectors/boosted_trees: neighbours ---------------------------------------------------------

def write_large_components(near: Near, begin: int, end: int, is_large: Bools) -> None: ...
def judge_near(
    near: Near, trees: Trees, which: Ints, begin: int, end: int, odds: Singles, values: Singles
) -> None: ...
def judge_far(
    far: Far, trees: Trees, which: Ints, begin: int, end: int, odds: Singles, values: Singles
) -> None: ...

# core/detectors/boosted_trees: scan patterns ------------------------------------------------------

def add_trees(trees: Trees, features: Singles, total: Singles) -> None: ...
def add_contributions(trees: Trees, means: Singles, values: Singles, added: Singles) -> None: ...
def write_roughness(pattern: Pattern, begin: int, end: int, rough: Singles) -> None: ...
def find_beside(pattern: Pattern, begin: int, end: int, near: Index) -> None: ...
def find_segments(pattern: Pattern, reach: float) -> tuple[Index, Index]: ...
def join_segments(pattern: Pattern, near: Index, reach: float, segments: Segments) -> Index: ...
def describe_groups(pattern: Pattern, segments: Segments, group: Index) -> Singles: ...
def write_groups(
    pattern: Pattern, segments: Segments, group: Index, described: Singles, out: Singles
) -> None: ...
def write_heights(pattern: Pattern, around: Floor, begin: int, end: int, out: Singles) -> None: ...
def judge_pattern(
    prepared: Prepared,
    first: FirstPass,
    second: bool,
    asked: Bools,
    trees: Trees,
    column: Ints,
    begin: int,
    end: int,
    odds: Singles,
    values: Singles,
) -> None: ...
def find_panes(prepared: Prepared, places: Ints, begin: int, end: int, out: Singles) -> None: ...
def count_scores(pattern: Pattern, score: Singles) -> tuple[Index, Singles, float]: ...
def scale_odds(
    pattern: Pattern,
    odds: Singles,
    least: float,
    limit: float,
    begin: int,
    end: int,
    score: Floats,
    rejected: Bools,
) -> None: ...
