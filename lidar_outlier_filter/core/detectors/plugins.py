# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The installed detectors: those of this package, and those that other distributions add.

Each score of ours is computed in the module or folder of that name here, imported on first use.

A distribution adds a detector by an entry point of the group ``lidar_outlier_filter.detectors``. A
declaration that is wrong is refused in one sentence and affects nothing else.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from importlib.metadata import Distribution, EntryPoint, distributions
from typing import Any

from lidar_outlier_filter.core.detectors.builtin import (
    AlphaBetaGamma,
    BoostedTrees,
    CropBox,
    DualReturn,
    Elevation,
    FieldRange,
    Hierarchical,
    Lof,
    MixedPixels,
    Quadric,
    RingOutlier,
    ScanShadows,
    Sor,
)
from lidar_outlier_filter.core.detectors.declaration import Detector
from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import BITS, Installed, Section, shown, walk

GROUP = 'lidar_outlier_filter.detectors'  # of entry points
LINES = ('no', 'uses', 'needs')
LARGE = ('files', 'tiles', 'no')

DEFAULT = 'boosted_trees'  # the chain
MAX_USUAL_SHARE = 0.05  # of the points that it rejects, above which that is worth a warning
# Modules that explain the scores of a detector. REASONS: what the numbers in Scores.reason mean,
# from 1 to 255, unique among all detectors. METHODS: for each, its features with a description.
EXPLANATIONS = {'boosted_trees': f'{__package__}.boosted_trees.methods'}
_EVERY = (
    Detector(
        name='alpha_beta_gamma',
        bit=1,
        section=AlphaBetaGamma,
        score=f'{__package__}.alpha_beta_gamma.detector:score',
        lines='needs',
        large='files',
        usual=0.05,
        rejects='is improbable after the points before and behind it in its line segment',
    ),
    Detector(
        name='quadric',
        bit=2,
        section=Quadric,
        score=f'{__package__}.quadric.detector:score',
        neighbours=lambda parameters: parameters.of(Quadric).list_length,
        large='tiles',
        usual=0.05,
        rejects='lies on none of the planes, paraboloids or quadrics through its neighbourhood: '
        '`window: section` tests all points of a section at once, `patch` each in its own patch',
    ),
    Detector(
        name='lof',
        bit=4,
        section=Lof,
        score=f'{__package__}.lof:score',
        neighbours=lambda parameters: parameters.of(Lof).min_pts,
        large='files',
        usual=0.15,
        rejects='lies in a place much less dense than its neighbours do (local outlier factor, or '
        'LOF2)',
    ),
    Detector(
        name='sor',
        bit=8,
        section=Sor,
        score=f'{__package__}.sor:score',
        neighbours=lambda parameters: parameters.of(Sor).list_length,
        large='files',
        usual=0.1,
        rejects='is too far from its nearest neighbours: statistical (`sor`, `sor2`), or by '
        '`radius`; both may grow with the range (DSOR, DROR)',
    ),
    Detector(
        name='hierarchical',
        bit=16,
        section=Hierarchical,
        score=f'{__package__}.hierarchical:score',
        usual=0.6,
        rejects='belongs to a cluster of fewer than `min_cluster` points: of the minimum spanning '
        'tree, then (bit 32768 beside it) of the Gabriel graphs, without their long edges; '
        '`min_cluster` ÷ score is the size of the cluster',
    ),
    Detector(
        name='elevation',
        bit=32,
        section=Elevation,
        score=f'{__package__}.elevation:score',
        usual=0.1,
        rejects='is set apart in elevation, or differs by more than 3 σ from its neighbours on the '
        'map, or is too far above or below the ground (airborne clouds, z up)',
    ),
    Detector(
        name='boosted_trees',
        bit=64,
        section=BoostedTrees,
        score=f'{__package__}.boosted_trees.methods:detect',
        lines='uses',
        columns=lambda parameters: parameters.of(BoostedTrees).columns,
        large='files',
        usual=MAX_USUAL_SHARE,
        rejects='is an outlier by gradient-boosted trees: on the returns beside it in the scan '
        'pattern (spinning sensors, and profile scanners whose mirror turns or swings), or else '
        'on its nearest neighbours',
    ),
    Detector(
        name='scan_shadows',
        bit=128,
        section=ScanShadows,
        score=f'{__package__}.scan_shadows:score',
        lines='needs',
        large='files',
        rejects='lies in its scan line beside a nearer point, where the line between neighbours '
        'runs nearly along the beam: mixed pixels (laser_filters)',
    ),
    Detector(
        name='ring_outlier',
        bit=256,
        section=RingOutlier,
        score=f'{__package__}.ring_outlier:score',
        lines='needs',
        large='files',
        rejects='belongs to a short walk of few points along its ring, between jumps in range '
        '(Autoware)',
    ),
    Detector(
        name='dual_return',
        bit=512,
        section=DualReturn,
        score=f'{__package__}.dual_return:score',
        lines='needs',
        large='files',
        rejects='has another return of its shot behind it, and no return of the shots beside it at '
        'about its range (after Autoware)',
    ),
    Detector(
        name='crop_box',
        bit=1024,
        section=CropBox,
        score=f'{__package__}.crop_box:score',
        large='files',
        rejects='is too near or too far, or outside a box in the frame of the sensor; or inside '
        'it, with `negative`',
    ),
    Detector(
        name='mixed_pixels',
        bit=2048,
        section=MixedPixels,
        score=f'{__package__}.boosted_trees.mixed_pixels:detect',
        lines='uses',
        columns=lambda parameters: parameters.of(BoostedTrees).columns,
        rejects='lies between two surfaces at an edge, by trees trained for it alone (spinning '
        'sensors)',
    ),
    Detector(
        name='field_range',
        bit=4096,
        section=FieldRange,
        score=f'{__package__}.field_range:score',
        field=lambda parameters: parameters.of(FieldRange).field,
        large='files',
        rejects='has a field, such as reflectivity, out of its bounds, in a band of ranges',
    ),
)
BUILTIN = {one.name: one for one in _EVERY}


def find_detectors(reserved: Collection[str]) -> Installed:
    """Find all detectors; ``reserved`` names cannot be those of a section of parameters."""
    return add_plugins(entry_points(distributions()), reserved)


def entry_points(every: Iterable[Distribution]) -> Iterator[tuple[str, EntryPoint]]:
    """Yield the entry points of detectors, with the names of their distributions ('': none).

    A distribution that is found twice counts as first found.
    """
    names = set()
    for one in every:
        if GROUP not in (one.read_text('entry_points.txt') or ''):
            continue
        name = _name_of(one)
        if name not in names or not name:
            names.add(name)
            yield from ((name, point) for point in one.entry_points if point.group == GROUP)


def _name_of(distribution: Distribution) -> str:
    try:
        return str(distribution.metadata['Name'] or '')
    except Exception:  # noqa: BLE001  a reader of metadata may raise anything
        return ''


def add_plugins(points: Iterable[tuple[str, EntryPoint]], reserved: Collection[str]) -> Installed:
    """Load declarations beside the built-in ones, in the order of their distributions' names."""
    found = dict(BUILTIN)
    refused: dict[str, ParameterError] = {}
    for origin, point in sorted(points, key=lambda one: (one[0], one[1].name)):
        title = f'the detector {point.name} of {origin or "a distribution without a name"}'
        try:
            found[point.name] = _load(point, title, found, reserved)
        except ParameterError as err:
            # The name of a detector that is installed stays usable.
            refused.setdefault(title if point.name in found else point.name, err)
    ordered = sorted(found.items(), key=lambda item: item[1].bit)
    return Installed(dict(ordered), refused, (DEFAULT,))


def _load(
    point: EntryPoint, title: str, found: Mapping[str, Detector], reserved: Collection[str]
) -> Detector:
    """Load one declaration.

    Raises
    ------
    ParameterError
        If it cannot be imported, is not a valid declaration, or conflicts with another one.

    """
    try:
        one = point.load()
    except KeyboardInterrupt:
        raise
    except BaseException as err:
        got = f'{type(err).__name__}: {err}'
        raise ParameterError(title, 'a declaration that can be imported', got) from err
    if not isinstance(one, Detector):
        raise ParameterError(title, 'a Detector', shown(one))
    _check_fields(one, title)
    if one.name != point.name:
        raise ParameterError(f'the name of {title}', 'that of its entry point', repr(one.name))
    if one.name in {*reserved, *found}:
        raise ParameterError(f'the name of parameters of {title}', 'a new one', repr(one.name))
    free = [bit for bit in BITS if bit not in {other.bit for other in found.values()}]
    if one.bit not in free:
        must_be = f'a free one ({", ".join(map(str, free)) or "none is left"})'
        raise ParameterError(f'the bit of {title}', must_be, shown(one.bit))
    return one


def _check_fields(one: Any, title: str) -> None:
    for name, (is_right, must_be) in _FIELDS.items():
        value = getattr(one, name)
        if not is_right(value):
            raise ParameterError(f'{name} of {title}', must_be, shown(value))


def _is_function(value: Any) -> bool:
    return callable(value) or (isinstance(value, str) and ':' in value)


def _is_section(section: Any) -> bool:
    """Return whether an object is a class of parameters whose defaults are allowed."""
    is_class = isinstance(section, type) and issubclass(section, Section)
    try:
        for parameter in walk(section, ''):
            parameter.check(parameter.default)
        section().check()
        hash(section())
    except Exception:  # noqa: BLE001  the class is a plug-in's
        return False
    return is_class


_FIELDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    'name': (lambda value: isinstance(value, str) and value.isidentifier(), 'an identifier'),
    'bit': (lambda value: type(value) is int, 'an integer'),
    'section': (_is_section, 'a frozen dataclass of declared parameters'),
    'score': (_is_function, "a function, or 'module:function'"),
    'rejects': (lambda value: isinstance(value, str), 'a string'),
    'neighbours': (callable, 'a function of the parameters'),
    'lines': (LINES.__contains__, f'one of {", ".join(LINES)}'),
    'columns': (callable, 'a function of the parameters'),
    'field': (callable, 'a function of the parameters'),
    'large': (LARGE.__contains__, f'one of {", ".join(LARGE)}'),
    'usual': (lambda value: isinstance(value, float) and 0 < value <= 1, 'a share up to 1.0'),
}
