# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the detectors of this package, which are declared in :mod:`.plugins`."""

from dataclasses import dataclass

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import Section, declare


@dataclass(frozen=True)
class AlphaBetaGamma(Section):
    """The moving fixed-interval α-β-γ smoother along each line segment."""

    before: int = declare(3, 'Points of the window in front of the tested one.', '', 0, 1000)
    after: int = declare(3, 'Points of the window behind the tested one.', '', 0, 1000)
    order: int = declare(
        1, 'Motion along the line: 2 with acceleration (α-β-γ), 1 without (α-β).', '', 1, 2
    )
    significance: float = declare(
        1e-6, 'Two-sided probability to reject a good point, for one test.', '', 1e-15, 0.5
    )
    sides: str = declare(
        'either',
        'both: the window around the point decides (the paper); either: a point that agrees with '
        'the window on one side is kept, so edges and corners stay.',
        choices=('both', 'either'),
    )
    sigma: float = declare(
        0.0, 'Standard deviation of a coordinate; 0: estimated from each line.', 'm', 0.0, 100.0
    )
    sigma_floor: float = declare(
        0.005, 'Lower limit of estimated standard deviations.', 'm', 1e-6, 100.0
    )
    passes: int = declare(
        30, 'Maximum number of passes; the last rejects all failing points.', '', 1, 1000
    )

    @property
    def min_window(self) -> int:
        """Fewest other points in a window: one more than the unknowns of the motion.

        With as many as unknowns all points of a window would fail alike.
        """
        return self.order + 2

    def check(self) -> None:
        """Refuse windows that are too short."""
        got = f'{self.before} and {self.after}'
        if self.before + self.after < self.min_window:
            must_be = f'together at least order + 2 = {self.min_window}'
            raise ParameterError('alpha_beta_gamma.before and after', must_be, got)
        if self.sides == 'either' and max(self.before, self.after) < self.min_window:
            must_be = f'one of them at least order + 2 = {self.min_window}, with sides: either'
            raise ParameterError('alpha_beta_gamma.before and after', must_be, got)


@dataclass(frozen=True)
class Quadric(Section):
    """Quadric surfaces through the neighbourhood."""

    window: str = declare(
        'section',
        'section: all points of a section of the cloud are tested against its surface; patch: each '
        'point against that of its own neighbours, slow.',
        choices=('section', 'patch'),
    )
    section: int = declare(
        64, 'Maximum number of points tested in a section, with others around it.', '', 16, 10_000
    )
    k: int = declare(30, 'Neighbours in the patch around each point.', '', 10, 1000)
    significance: float = declare(
        1e-6, 'Two-sided probability to reject a good point, for one test.', '', 1e-15, 0.5
    )
    surfaces: int = declare(
        3, 'Maximum number of surfaces in one window, under model: lowest.', '', 1, 10
    )
    model: str = declare(
        'lowest',
        'lowest: a plane or paraboloid if it is enough, from the half that agrees best; always: '
        'all ten parameters, fitted to all points of the window, and one surface (the paper).',
        choices=('lowest', 'always'),
    )
    sigma_floor: float = declare(
        0.005, 'Lower limit of estimated standard deviations.', 'm', 1e-6, 100.0
    )

    @property
    def list_length(self) -> int:
        """Length of the neighbour lists that the windows need."""
        return self.k if self.window == 'patch' else 1


@dataclass(frozen=True)
class Lof(Section):
    """Local outlier factor: density against that of the neighbours."""

    min_pts: int = declare(20, 'Neighbours that make the density; ties count too.', '', 1, 1000)
    threshold: float = declare(
        1.2, 'Rejected above this factor; lof2: above this difference.', '', 1e-6, 1e9
    )
    statistic: str = declare(
        'lof',
        'lof: the factor; lof2: its absolute difference from the median of all.',
        choices=('lof', 'lof2'),
    )


@dataclass(frozen=True)
class Sor(Section):
    """Distance to the nearest neighbours."""

    k: int = declare(20, 'Neighbours whose mean distance counts, the point left out.', '', 1, 1000)
    statistic: str = declare(
        'sor',
        'sor: mean distance against mean + multiplier × standard deviation of all; sor2: its '
        'absolute difference from the median against limit; radius: min_neighbors within radius.',
        choices=('sor', 'sor2', 'radius'),
    )
    multiplier: float = declare(2.0, 'Standard deviations above the mean of all.', '', 0.0, 1000.0)
    limit: float = declare(
        0.1, 'Largest absolute difference from the median (sor2).', 'm', 1e-6, 1e6
    )
    radius: float = declare(
        0.5, 'Radius that must contain min_neighbors others (radius).', 'm', 1e-6, 1e6
    )
    min_neighbors: int = declare(3, 'Minimum number of others in the radius.', '', 1, 1000)
    range_scaled: bool = declare(
        default=False,
        text='Let the limit grow with the distance from the origin: sor, sor2: the limit × '
        'range_factor × range (DSOR); radius: at least range_factor × range (DROR).',
    )
    range_factor: float = declare(0.05, 'Growth of the limit with the range.', '1/m', 1e-9, 1e3)

    @property
    def list_length(self) -> int:
        """Length of the neighbour lists that the statistic needs."""
        return self.min_neighbors if self.statistic == 'radius' else self.k


@dataclass(frozen=True)
class Hierarchical(Section):
    """Clusters that a graph falls into when its long edges are cut."""

    global_confidence: float = declare(
        0.99,
        'Phase 1: edges of the spanning tree that are longer than this two-sided interval around '
        'the median allows are cut.',
        '',
        0.0,
        1.0 - 1e-9,
    )
    local_confidence: float = declare(
        0.95,
        'Phase 2: the same for the Gabriel graph of each cluster of phase 1.',
        '',
        0.0,
        1.0 - 1e-9,
    )
    min_cluster: int = declare(
        100,
        'Minimum size of a kept cluster; clouds with fewer points stay untested.',
        '',
        1,
        1_000_000_000,
    )


@dataclass(frozen=True)
class Elevation(Section):
    """Elevation against the mean of the neighbours on the map, or against the ground."""

    against: str = declare(
        'neighbours',
        'neighbours: their mean elevation (the paper); ground: a local ground surface.',
        choices=('neighbours', 'ground'),
    )
    height: float = declare(
        50.0, 'Maximum height above the ground (against: ground).', 'm', 1e-3, 1e6
    )
    depth_counts: float = declare(
        50.0,
        'Weight of depth against height: the allowed depth is height ÷ this.',
        '',
        1e-3,
        1e6,
    )
    cell: float = declare(
        2.0,
        'Side of the cells whose lowest points make the ground; some points lie in each.',
        'm',
        1e-3,
        1e4,
    )
    widest: float = declare(
        40.0, 'Width of the widest object on the ground, such as a building.', 'm', 0.0, 1e4
    )
    k: int = declare(30, 'Neighbours whose mean elevation counts; ties count too.', '', 1, 1000)
    multiplier: float = declare(
        3.0, 'Maximum difference, in standard deviations of all differences.', '', 1e-6, 1000.0
    )
    sides: str = declare(
        'both',
        'Points that are rejected: low or high ones, or both; low is the formula of the paper.',
        choices=('both', 'low', 'high'),
    )
    gap: float = declare(
        5.0,
        'Empty range of elevations beyond which points are rejected; 0: off.',
        'm',
        0.0,
        1e6,
    )


@dataclass(frozen=True)
class BoostedTrees(Section):
    """Gradient-boosted trees on the features of each point."""

    sensor: str = declare(
        'auto',
        'Where the scan pattern comes from: spinning: rings; profile: one scan line after another; '
        'auto: whichever fits; free: a scanner without rings, in its own frame, such as a Livox; '
        'survey: none, points are compared with their nearest neighbours only.',
        choices=('auto', 'profile', 'spinning', 'survey', 'free'),
    )
    threshold: float = declare(
        1.0, "Rejected above this many times the block's own threshold.", '', 1e-6, 1e6
    )

    @property
    def columns(self) -> tuple[str, ...]:
        """What it reads of a cloud besides points and times."""
        return ('intensity', 'ring') if self.sensor in {'auto', 'spinning'} else ('intensity',)


@dataclass(frozen=True)
class ScanShadows(Section):
    """The shadow angle between neighbours of a scan line, as in laser_filters."""

    min_angle: float = declare(
        10.0, 'Points behind one with a smaller shadow angle are rejected.', 'deg', 0.01, 89.99
    )
    neighbors: int = declare(
        1, 'Points on either side of a shadow that are rejected if farther.', '', 1, 100
    )
    window: int = declare(1, 'Points on either side that angles are measured to.', '', 1, 100)


@dataclass(frozen=True)
class RingOutlier(Section):
    """Short walks along a ring, as in Autoware."""

    object_length_threshold: float = declare(
        0.1, 'Walks that are at least as long are kept.', 'm', 1e-3, 1e3
    )
    distance_ratio: float = declare(
        1.03, 'A walk ends where the ratio of two ranges is not smaller.', '', 1.0, 1e3
    )
    num_points_threshold: int = declare(4, 'Walks of more points are kept.', '', 1, 1_000_000_000)


@dataclass(frozen=True)
class DualReturn(Section):
    """Early returns of a shot that stand alone, after Autoware."""

    distance_ratio: float = declare(
        1.03,
        'An early return is kept if its range and one of a shot beside it have a smaller ratio.',
        '',
        1.0,
        1e3,
    )


@dataclass(frozen=True)
class CropBox(Section):
    """Ranges and a box, in the frame of the sensor."""

    max_range: float = declare(1e9, 'Points that are farther are rejected.', 'm', 1e-3, 1e9)
    min_range: float = declare(0.0, 'Points that are nearer are rejected.', 'm', 0.0, 1e9)
    min_x: float = declare(-1e9, 'Least x in the box.', 'm', -1e9, 1e9)
    max_x: float = declare(1e9, 'Largest x in the box.', 'm', -1e9, 1e9)
    min_y: float = declare(-1e9, 'Least y in the box.', 'm', -1e9, 1e9)
    max_y: float = declare(1e9, 'Largest y in the box.', 'm', -1e9, 1e9)
    min_z: float = declare(-1e9, 'Least z in the box.', 'm', -1e9, 1e9)
    max_z: float = declare(1e9, 'Largest z in the box.', 'm', -1e9, 1e9)
    negative: bool = declare(
        default=False, text='Reject points inside the box instead of those outside.'
    )

    def check(self) -> None:
        """Refuse limits that leave nothing between them."""
        for name in ('range', 'x', 'y', 'z'):
            low, high = getattr(self, f'min_{name}'), getattr(self, f'max_{name}')
            if low >= high:
                must_be = f'below crop_box.max_{name} = {high:g} m'
                raise ParameterError(f'crop_box.min_{name}', must_be, f'{low:g} m')


@dataclass(frozen=True)
class FieldRange(Section):
    """Bounds of a field, in a band of ranges."""

    field: str = declare(
        'intensity', 'Field that is tested, such as reflectivity, signal or deviation.', fixed=True
    )
    max_range: float = declare(1e9, 'Points that are not nearer are kept.', 'm', 1e-3, 1e9)
    min_range: float = declare(0.0, 'Points that are nearer are kept.', 'm', 0.0, 1e9)
    min_value: float = declare(-1e18, 'Least value that is kept.', '', -1e18, 1e18)
    max_value: float = declare(1e18, 'Largest value that is kept.', '', -1e18, 1e18)

    def check(self) -> None:
        """Refuse a field without a name, and limits that leave nothing between them."""
        if not self.field:
            raise ParameterError('field_range.field', 'the name of a field', "''")
        if self.min_range >= self.max_range:
            must_be = f'below field_range.max_range = {self.max_range:g} m'
            raise ParameterError('field_range.min_range', must_be, f'{self.min_range:g} m')
        if self.min_value > self.max_value:
            must_be = f'at most field_range.max_value = {self.max_value:g}'
            raise ParameterError('field_range.min_value', must_be, f'{self.min_value:g}')


@dataclass(frozen=True)
class MixedPixels(Section):
    """Gradient-boosted trees on points between two surfaces."""

    threshold: float = declare(
        1.0, "Rejected above this many times the model's own threshold.", '', 1e-6, 1e6
    )
