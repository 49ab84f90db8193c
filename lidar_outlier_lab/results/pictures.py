# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a cloud before and after: in perspective, and from the side or from above."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from PIL import Image

from lidar_outlier_filter.core.annotations import Bools, Floats, Rows
from lidar_outlier_filter.evaluation.truth import Cause

Panel = Callable[[Axes, 'Shown'], str]
View = tuple[tuple[float, ...], tuple[float, ...]]  # the eye's position, and its target

WIDTH, HEIGHT, DPI = 14.0, 9.0, 100  # inches, dots per inch
COLOURS = 96  # of the palette: keeps the file small
FOUND, LEFT, LOST = '#0072b2', '#d81b1b', '#f0a30a'
INK, PAPER = '#30343a', '#ffffff'
FIELD_OF_VIEW = 0.62  # half the width of the view over its depth
VIEW_WIDTH = 0.46  # share of the picture's width that the perspective takes
SPARSE = 100_000  # points: of fewer each is drawn larger
LOW = 0.5  # metres; most points below lie on the road, and most of these in the driven lane
PROFILE_HALF_WIDTH = 3.0  # metres to both sides of the driven line
PLAN, PLAN_AHEAD = 60.0, 32.0  # metres: length of a plan, and how much of it lies ahead


class Shown(NamedTuple):
    """What a panel shows of N points.

    Attributes
    ----------
    xyz : (3, N) float64, metres
    brightness : (N,) float64, 0 to 1
    grey : (N,) bool, the points in grey; None: all, as a pale ground to find one's way on
    coloured : masks (N,) with their colours, drawn over it

    """

    xyz: Floats
    brightness: Floats
    grey: Bools | None
    coloured: list[tuple[Bools, str]]


def draw(points: Rows, rejected: Bools, path: Path, title: str = '') -> None:
    """Draw a street in perspective, and the air above its road from the side; see :func:`_draw`."""
    middle = float(np.median(points['x']))
    view = ((middle - 28.0, -2.6, 7.0), (middle + 4.0, 0.3, 1.2))
    _draw(points, rejected, title, view, _profile, path)


def draw_sweep(points: Rows, rejected: Bools, path: Path, title: str = '') -> None:
    """Draw a sweep in perspective and from above, in its sensor's frame; see :func:`_draw`."""
    _draw(points, rejected, title, ((-21.0, -5.0, 8.5), (8.0, 0.5, 0.0)), _plan, path)


def _draw(  # noqa: PLR0913  what makes a picture
    points: Rows, rejected: Bools, title: str, view: View, beside: Panel, path: Path
) -> None:
    """Draw three rows, before, cleaned and outliers, each in perspective and otherwise, as PNG.

    ``view`` is the eye's position in perspective, and its target; ``beside`` draws the panel
    beside, and returns the label of its x axis.
    """
    xyz = np.stack([points[axis] for axis in 'xyz']).astype(np.float64)
    bad = points['label'] != Cause.GOOD
    brightness = _brightness(points['intensity'].astype(np.float64))
    rows = (
        ('Before', ~bad, [(bad, LEFT)]),
        ('Cleaned', ~bad & ~rejected, [(bad & ~rejected, LEFT)]),
        ('Outliers', None, [(rejected & ~bad, LOST), (rejected & bad, FOUND)]),
    )
    figure = Figure((WIDTH, HEIGHT), dpi=DPI, facecolor=PAPER)
    canvas = FigureCanvasAgg(figure)
    bottoms = (0.652, 0.345, 0.038)
    for (name, grey, coloured), bottom in zip(rows, bottoms, strict=True):
        scene = figure.add_axes((0.012, bottom, VIEW_WIDTH, 0.265))
        other = figure.add_axes((VIEW_WIDTH + 0.065, bottom + 0.02, 0.92 - VIEW_WIDTH, 0.235))
        shown = Shown(xyz, brightness, grey, coloured)
        _perspective(scene, shown, view)
        below = beside(other, shown)
        _frame(other)
        scene.set_title(name, loc='left', fontsize=15, fontweight='bold', color=INK, pad=4)
    other.set_xlabel(below, fontsize=12, color=INK, labelpad=1)
    entries = (
        ('good point', '#8d9299'),
        ('outlier still in the cloud', LEFT),
        ('outlier taken out', FOUND),
        ('good point taken out', LOST),
    )
    add_legend(figure, entries)
    figure.text(0.012, 0.966, title, fontsize=13, color=INK)
    save(canvas, path, COLOURS)


def save(canvas: FigureCanvasAgg, path: Path, colours: int) -> None:
    """Save what is drawn as PNG of few colours, those of the legend among them however rare."""
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    image = Image.fromarray(pixels).convert('RGB')
    chosen = image.quantize(colours).getpalette() or []
    palette = Image.new('P', (1, 1))
    legend = b''.join(bytes.fromhex(colour[1:]) for colour in (FOUND, LEFT, LOST))
    palette.putpalette(chosen[: 3 * colours] + list(legend))
    image.quantize(palette=palette, dither=Image.Dither.NONE).save(path, optimize=True)


def _brightness(intensity: Floats) -> Floats:
    """Grey of each point, 0 to 1: the darker, the less came back."""
    low, high = np.percentile(intensity, [2, 98]) if len(intensity) else (0.0, 1.0)
    scaled = np.clip((intensity - low) / max(high - low, 1e-9), 0.0, 1.0)
    return 0.45 + 0.4 * np.sqrt(scaled)


def _perspective(axes: Axes, shown: Shown, view: View) -> None:
    """Look from a position to another."""
    eye, goal = np.array(view[0]), np.array(view[1])
    forward = (goal - eye) / np.linalg.norm(goal - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    seen = shown.xyz - eye[:, None]
    depth = forward @ seen
    front = depth > 1.0
    u = right @ seen / np.where(front, depth, 1.0)
    v = up @ seen / np.where(front, depth, 1.0)
    order = np.argsort(-depth, kind='stable')
    order = order[front[order]]
    _scatter(axes, (u, v), shown, order)
    axes.set_xlim(-FIELD_OF_VIEW, FIELD_OF_VIEW)
    box = axes.get_position()
    tall = FIELD_OF_VIEW * (box.height * HEIGHT) / (box.width * WIDTH)
    axes.set_ylim(-tall, tall)
    axes.axis('off')


def _profile(axes: Axes, shown: Shown) -> str:
    """Look from the side at what is above the driven lane, heights exaggerated."""
    x, y, z = shown.xyz
    lane = np.abs(y - np.median(y[z < LOW])) < PROFILE_HALF_WIDTH
    order = np.flatnonzero(lane)
    _scatter(axes, (x, z), shown, order)
    axes.set_xlim(*np.percentile(x[order], [0.5, 99.5]))
    axes.set_ylim(-0.12, 1.75)
    axes.set_ylabel('height, m', fontsize=12, color=INK, labelpad=3)
    return 'along the street, m'


def _plan(axes: Axes, shown: Shown) -> str:
    """Look from above, as long as wide in metres."""
    order = np.argsort(shown.xyz[2], kind='stable')
    _scatter(axes, (shown.xyz[0], shown.xyz[1]), shown, order)
    box = axes.get_position()
    half = PLAN / 2.0 * (box.height * HEIGHT) / (box.width * WIDTH)
    axes.set_xlim(PLAN_AHEAD - PLAN, PLAN_AHEAD)
    axes.set_ylim(-half, half)
    axes.set_ylabel('to the left, m', fontsize=12, color=INK, labelpad=3)
    return 'ahead of the sensor, m'


def _frame(axes: Axes) -> None:
    axes.tick_params(labelsize=12, colors=INK, length=3)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(False)
    for side in ('left', 'bottom'):
        axes.spines[side].set_color('#9aa0a6')


def _scatter(
    axes: Axes, flat: tuple[Floats, Floats], shown: Shown, order: NDArray[np.intp]
) -> None:
    """Draw the points of ``order``: greys first, then the coloured ones over them."""
    u, v = flat
    some = order if shown.grey is None else order[shown.grey[order]]
    shade = np.full(len(some), 0.93) if shown.grey is None else shown.brightness[some]
    size = (72.0 / DPI) ** 2
    wide = size * (1.0 if len(shown.brightness) > SPARSE else 2.5)
    grey: dict[str, Any] = {'cmap': 'gray', 'vmin': 0, 'vmax': 1, 'marker': 's', 'linewidths': 0}
    axes.scatter(u[some], v[some], s=wide, c=shade, **grey)
    for mask, colour in shown.coloured:
        some = order[mask[order]]
        axes.scatter(u[some], v[some], s=5 * size, c=colour, marker='o', linewidths=0)


def add_legend(figure: Figure, entries: Sequence[tuple[str, str]]) -> None:
    """Name dots, by text and colour, in the upper right corner of a figure."""
    handles = [
        Line2D([], [], marker='o', linestyle='', markersize=7, color=colour, label=text)
        for text, colour in entries
    ]
    figure.legend(
        handles=handles,
        loc='upper right',
        ncols=len(entries),
        frameon=False,
        fontsize=13,
        labelcolor=INK,
        handletextpad=0.1,
        columnspacing=1.4,
        bbox_to_anchor=(0.995, 1.0),
    )
