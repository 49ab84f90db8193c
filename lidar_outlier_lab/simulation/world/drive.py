# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A drive through a scene: what its shots measure, and what goes wrong with them.

More shots can be disturbed than are needed for a share of outliers. Then some are chosen by lot;
the others measure what they would have measured undisturbed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_outlier_filter.core.annotations import Bools, Bytes, Floats, Ints, Rows
from lidar_outlier_filter.errors import FilterError
from lidar_outlier_filter.evaluation.truth import Cause, Kind
from lidar_outlier_lab._kernels import PANE, ROUND
from lidar_outlier_lab.simulation.world.prisms import FreeScanner
from lidar_outlier_lab.simulation.world.scene import Rays, Scene
from lidar_outlier_lab.simulation.world.sensors import Echoes, ProfileScanner, SpinningScanner
from lidar_outlier_lab.simulation.world.trajectory import Route, Trajectory

IN_THE_AIR = 0.05  # share of the light that a cloud of droplets sends back


@dataclass(frozen=True)
class Disturbances:
    """What goes wrong with shots at surfaces.

    Attributes
    ----------
    reflection, near_surface : shares of the shots at the road that are measured above it
    reflection_height, near_surface_height : (low, high) how far above, metres
    reflection_scale : heights of reflections fall off exponentially, by e in so many metres
    glass : share of the shots at glass that are mirrored, so that what is in front of it appears
        behind it
    wet : share of the grazing shots at a road that are mirrored likewise; of steeper ones it falls
        as (1 - cosine of incidence)^5 does (Schlick)
    mirrored : share of the light that is left after two mirrors

    """

    reflection: float = 0.004
    reflection_height: tuple[float, float] = (0.10, 1.4)
    reflection_scale: float = 0.5
    near_surface: float = 0.001
    near_surface_height: tuple[float, float] = (0.03, 0.08)
    glass: float = 0.0
    wet: float = 0.0
    mirrored: float = 0.3


@dataclass(frozen=True)
class Drive:
    """Everything that makes a recording: the same drive gives the same bytes.

    ``lines`` are revolutions of the scanner. Points are in the frame of the scene, or with
    ``in_own_frame`` in that of the scanner at the moment of each.
    """

    scene: Scene
    lines: int
    sensor: ProfileScanner | SpinningScanner | FreeScanner = field(default_factory=ProfileScanner)
    trajectory: Trajectory | Route = field(default_factory=Trajectory)
    disturbances: Disturbances = field(default_factory=Disturbances)
    seed: int = 1
    in_own_frame: bool = False

    @property
    def shots(self) -> int:
        """Number of shots, with and without echo."""
        return self.lines * self.sensor.shots_per_line

    def rays(self, shot: Ints) -> Rays:
        """Footprints of shots, in the scene."""
        t = self.sensor.seconds(shot)
        offset, direction = self.sensor.bundle(shot)
        rotation = self.trajectory.rotation(t)
        lever = offset + np.reshape(self.trajectory.mount, (3, 1, 1))
        origin = np.einsum('ijn,jnk->ink', rotation, lever)
        origin += self.trajectory.position(t)[:, :, None]
        return Rays(origin, np.einsum('ijn,jnk->ink', rotation, direction), t, self.sensor.reach)


class Returns(NamedTuple):
    """Points with the numbers of their shots; their ``t`` is not yet set."""

    shot: Ints
    points: Rows

    def take(self, index: NDArray[np.intp] | Bools | slice) -> Returns:
        """Choose points by index, mask or slice, in that order."""
        return Returns(self.shot[index], self.points[index])


class Block(NamedTuple):
    """What some consecutive shots measured.

    Attributes
    ----------
    clean : what the surfaces alone give, with all that their shapes, mirrors and motion do
    spoilt : what shots gave instead that were disturbed on their way; in order
    lot : (len(spoilt.shot),) of each disturbed shot, uniform in 0 to 1, to choose some of them by

    """

    clean: Returns
    spoilt: Returns
    lot: Floats


@dataclass
class _Shots:
    """What N shots measure, in the making."""

    distance: Floats
    cosine: Floats
    bright: Floats
    kind: Bytes
    cause: Bytes

    def copy(self) -> _Shots:
        """Copy all."""
        return replace(self, **{name: value.copy() for name, value in vars(self).items()})


def simulate(drive: Drive) -> Iterator[tuple[int, Returns]]:
    """Cast a drive, and yield it in blocks: the number of shots so far, and the block's returns."""
    for end, block in cast(drive):
        yield end, merge(block.clean, block.spoilt)


def cast(drive: Drive) -> Iterator[tuple[int, Block]]:
    """Cast a drive, and yield it in blocks: the number of shots so far, and what they measured."""
    step = drive.sensor.block
    for first in range(0, drive.shots, step):
        end = min(first + step, drive.shots)
        rng = np.random.default_rng([drive.seed, first // step])
        yield end, _cast(drive, np.arange(first, end, dtype=np.int64), rng)


def merge(clean: Returns, spoilt: Returns) -> Returns:
    """Put what disturbed shots gave into the place of what they had given, in order of shots."""
    left = clean.take(~np.isin(clean.shot, spoilt.shot, assume_unique=True))
    shot = np.concatenate([left.shot, spoilt.shot])
    order = np.argsort(shot, kind='stable')
    return Returns(shot[order], np.concatenate([left.points, spoilt.points])[order])


def gather(
    drive: Drive, points: int | None = None, progress: Callable[[float], object] = lambda _: None
) -> Block:
    """Cast a drive until ``points`` shots have an echo, undisturbed; None: all of it.

    ``progress`` is called with the share done.

    Raises
    ------
    FilterError
        If the whole drive has fewer points.

    """
    blocks, found = [], 0
    for end, block in cast(drive):
        blocks.append(block)
        found += len(block.clean.shot)
        progress(end / drive.shots if points is None else min(found / points, 1.0))
        if points is not None and found >= points:
            break
    if points is not None and found < points:
        raise FilterError('the points of the drive', f'at least {points}', found)
    return Block(
        join([block.clean for block in blocks]),
        join([block.spoilt for block in blocks]),
        np.concatenate([block.lot for block in blocks]),
    )


def join(parts: list[Returns]) -> Returns:
    """Put returns behind each other."""
    return Returns(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def exactly(block: Block, points: int, outliers: int) -> Returns:
    """Take the first ``points`` shots with an echo, and disturb some, so that ``outliers`` are.

    Raises
    ------
    FilterError
        If the scene itself makes more outliers, or too few shots are disturbed.

    """
    clean = block.clean.take(slice(0, points))
    where, inside = _same_shots(clean, block.spoilt)
    # Only shots that stay a point, and become an outlier.
    fit = inside & (clean.points['label'][where] == Cause.GOOD)
    candidates, lot = block.spoilt.take(fit), block.lot[fit]
    own = int(np.count_nonzero(clean.points['label']))
    if not own <= outliers <= own + len(lot):
        must_be = f'from {own / points:.6f} to {(own + len(lot)) / points:.6f} here'
        raise FilterError('the share', must_be, f'{outliers / points:.6f}')
    chosen = np.sort(np.argsort(lot, kind='stable')[: outliers - own])
    return merge(clean, candidates.take(chosen))


def about(block: Block, share: float) -> Returns:
    """Disturb some shots, so that the share of outliers comes as near to ``share`` as it can.

    Raises
    ------
    FilterError
        If the scene itself makes a larger share, or too few shots are disturbed.

    """
    clean, spoilt = block.clean, block.spoilt
    where, inside = _same_shots(clean, spoilt)
    order = np.argsort(block.lot, kind='stable')
    is_new = ~inside[order]
    was_good = clean.points['label'][where[order]] == Cause.GOOD
    points = len(clean.shot) + np.concatenate([[0], np.cumsum(is_new)])
    own = np.count_nonzero(clean.points['label'])
    outliers = own + np.concatenate([[0], np.cumsum(is_new | was_good)])
    shares = outliers / points
    if not shares[0] <= share <= shares[-1]:
        raise FilterError('the share', f'from {shares[0]:.6f} to {shares[-1]:.6f} here', share)
    chosen = np.sort(order[: int(np.argmin(np.abs(shares - share)))])
    return merge(clean, spoilt.take(chosen))


def _same_shots(clean: Returns, spoilt: Returns) -> tuple[NDArray[np.intp], Bools]:
    """Return where the shots of some returns are among those of others, and whether they are."""
    where = np.minimum(np.searchsorted(clean.shot, spoilt.shot), max(len(clean.shot) - 1, 0))
    return where, clean.shot[where] == spoilt.shot


def _cast(drive: Drive, shot: Ints, rng: np.random.Generator) -> Block:
    """Cast some shots: what they meet, what goes wrong on the way, noise."""
    rays = drive.rays(shot)
    clean = _meet(drive, rays, rng)
    spoilt = clean.copy()
    _fly(drive.scene, rays, spoilt, rng)
    _lift(drive.disturbances, rays.direction[2, :, 0], spoilt, rng)
    noise, glitter = rng.standard_normal((2, len(shot)))
    lot = rng.random(len(shot))
    changed = spoilt.cause != clean.cause
    seen = changed & _is_inside(drive, spoilt.distance)
    every = np.flatnonzero(_is_inside(drive, clean.distance))
    other = np.flatnonzero(seen)
    return Block(
        Returns(shot[every], _points(drive, shot, rays, clean, noise, glitter, every)),
        Returns(shot[other], _points(drive, shot, rays, spoilt, noise, glitter, other)),
        lot[other],
    )


def _meet(drive: Drive, rays: Rays, rng: np.random.Generator) -> _Shots:
    """Find what each shot measures of the surfaces alone."""
    scene, sensor = drive.scene, drive.sensor
    hits = scene.cast(rays)
    echoes = sensor.receive(hits, scene.reflectance[hits.surface])
    shots, how = _echoed(scene, echoes), drive.disturbances
    if how.glass or how.wet:
        part = np.where(np.isfinite(shots.distance), echoes.part, ROUND)
        kind, good = shots.kind, (shots.cause == Cause.GOOD) & (part % PANE != ROUND)
        fresnel = how.wet * (1.0 - echoes.cosine) ** 5
        chance = np.where(kind == Kind.GLASS, how.glass, np.where(kind == Kind.ROAD, fresnel, 0.0))
        _mirror(drive, rays, shots, part % PANE, good & (rng.random(len(chance)) < chance))
    return shots


def _echoed(scene: Scene, echoes: Echoes) -> _Shots:
    """Say of echoes what they are of."""
    pane = (echoes.part >= PANE).astype(np.intp)
    kind, cause = scene.kinds[echoes.surface, pane], scene.causes[echoes.surface]
    # Between leaves, and blades of grass, everything is mixed, and nobody would call it wrong.
    soft = (kind == Kind.FOLIAGE) | (kind == Kind.TERRAIN)
    cause[echoes.mixed & (cause == Cause.GOOD) & ~soft] = Cause.MIXED
    bright = scene.reflectance[echoes.surface] * echoes.cosine
    return _Shots(echoes.distance, echoes.cosine, bright, kind, cause)


def second_echoes(drive: Drive, shot: Ints) -> Returns:
    """Give those of some shots whose light comes back from two distances a second point each.

    It is the second strongest echo, of the surfaces alone; ``shot`` is in order.
    """
    found, step = [], drive.sensor.block
    for first in range(0, drive.shots, step):
        some = shot[slice(*np.searchsorted(shot, (first, first + step)))]
        rays = drive.rays(some)
        hits = drive.scene.cast(rays)
        hits = replace(hits, distance=drive.sensor.without_strongest(hits.distance))
        shots = _echoed(
            drive.scene, drive.sensor.receive(hits, drive.scene.reflectance[hits.surface])
        )
        rng = np.random.default_rng([drive.seed, first // step, 2])
        noise, glitter = rng.standard_normal((2, len(some)))
        seen = np.flatnonzero(_is_inside(drive, shots.distance))
        points = _points(drive, some, rays, shots, noise, glitter, seen)
        found.append(Returns(some[seen], points))
    return join(found)


def _mirror(drive: Drive, rays: Rays, shots: _Shots, axis: Ints, mirrored: Bools) -> None:
    """Let some shots go on from a face normal to ``axis``: they measure the whole way.

    What is met in the mirror lies behind it, on the straight line. Nothing met: nothing measured.
    """
    index = np.flatnonzero(mirrored)
    some = rays.take(index)
    origin, direction = some.origin[:, :, :1], some.direction[:, :, :1].copy()
    before = shots.distance[index]
    origin = origin + before[:, None] * direction
    direction[axis[index], np.arange(len(index)), 0] *= -1.0
    scene, sensor = drive.scene, drive.sensor
    # A little off the face, which would be met again.
    hits = scene.cast(Rays(origin + 1e-6 * direction, direction, some.t, sensor.reach))
    whole, met = before + hits.distance[:, 0], hits.surface[:, 0]
    bright = drive.disturbances.mirrored * scene.reflectance[met] * hits.cosine[:, 0]
    seen = sensor.is_seen(whole, bright)
    road = shots.kind[index] == Kind.ROAD
    shots.distance[index] = np.where(seen, whole, np.inf)
    shots.cosine[index], shots.bright[index] = hits.cosine[:, 0], bright
    shots.cause[index] = np.where(seen, np.where(road, Cause.REFLECTION, Cause.GHOST), Cause.GOOD)
    shots.kind[index] = Kind.AIR


def _fly(scene: Scene, rays: Rays, shots: _Shots, rng: np.random.Generator) -> None:
    """Send some shots back from what hangs in the air."""
    for thing in scene.air:
        far = thing.meet(rays, shots.distance, shots.bright, rng.random(len(shots.distance)))
        back = far < shots.distance
        shots.distance[back], shots.bright[back] = far[back], IN_THE_AIR
        shots.cause[back], shots.kind[back] = thing.cause, Kind.AIR


def _lift(how: Disturbances, fall: Floats, shots: _Shots, rng: np.random.Generator) -> None:
    """Lift some points off the road, along their rays."""
    lot, draw = rng.random((2, len(fall)))
    road = (shots.kind == Kind.ROAD) & (shots.cause == Cause.GOOD)
    twice = road & (lot < how.reflection)
    close = road & ~twice & (lot < how.reflection + how.near_surface)
    low, high = how.reflection_height
    span = -np.expm1(-(high - low) / how.reflection_scale)
    lift = np.where(twice, low - how.reflection_scale * np.log1p(-draw * span), 0.0)
    low, high = how.near_surface_height
    lift = np.where(close, low + draw * (high - low), lift)
    shots.cause[twice], shots.cause[close] = Cause.REFLECTION, Cause.NEAR_SURFACE
    shots.kind[twice | close] = Kind.AIR
    lifted = lift > 0.0
    shots.distance += np.where(lifted, lift / np.where(lifted, fall, 1.0), 0.0)


def _is_inside(drive: Drive, distance: Floats) -> Bools:
    """Return which distances are within the scanner's limits, both exclusive."""
    return (distance < drive.sensor.farthest) & (distance > drive.sensor.nearest)


def _points(  # noqa: PLR0913  one shot's whole state
    drive: Drive,
    shot: Ints,
    rays: Rays,
    shots: _Shots,
    noise: Floats,
    glitter: Floats,
    seen: NDArray[np.intp],
) -> Rows:
    """Make the points of the shots that are seen."""
    sensor = drive.sensor
    kind, distance = shots.kind[seen], shots.distance[seen]
    # A droplet and a doubly reflected shot have no face that leans.
    cosine = np.where(kind == Kind.AIR, 1.0, shots.cosine[seen])
    measured = sensor.measure(distance + noise[seen] * sensor.range_sigma(distance, cosine))
    points = np.zeros(len(seen), sensor.point)
    if drive.in_own_frame:
        _, direction = sensor.bundle(shot[seen])
        xyz = measured * direction[:, :, 0]
    else:
        xyz = rays.origin[:, seen, 0] + measured * rays.direction[:, seen, 0]
    for axis, name in enumerate('xyz'):
        points[name] = xyz[axis]
    points['intensity'] = 100.0 * shots.bright[seen] * np.exp(0.1 * glitter[seen])
    sensor.note(points, shot[seen])
    points['label'], points['surface'] = shots.cause[seen], kind
    return points
