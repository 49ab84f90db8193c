# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``train``. It imports what is heavy when it runs, so that help is instant."""

# ruff: noqa: PLC0415  as said above

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidar_outlier_filter.cli.arguments import add_parameter_options
from lidar_outlier_filter.cli.terminal import (
    DONE,
    read_parameters,
    show,
    stoppable_bar,
)
from lidar_outlier_filter.errors import FilterError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping, Sequence

    from rich.table import Table

    from lidar_outlier_filter.cli.arguments import Commands
    from lidar_outlier_filter.core.annotations import Progress
    from lidar_outlier_filter.core.points.points import Points
    from lidar_outlier_lab.simulation.world.sensors import SpinningScanner

    _Trained = tuple[str, float, list[Table]]  # the file, its threshold, and its figures

DATA = Path('../shared/data')
OUTPUT, PROFILE_OUTPUT = Path('pattern_model.json'), Path('profile_model.json')
SURVEY_OUTPUT, FREE_OUTPUT = Path('survey_model.json'), Path('free_model.json')
MIXED_OUTPUT, SWEEP_OUTPUT = Path('mixed_model.json'), Path('sweep_model.json')


def add_train(commands: Commands) -> None:
    """Add the command ``train``."""
    parser = commands.add_parser(
        'train',
        help='train boosted_trees on weather in clean recordings of spinning sensors',
        description='Put weather into clean recordings of spinning sensors, simulate streets, '
        'train the trees of `boosted_trees` on both, and write their file. Each sensor is left out '
        'once, and the figures printed are for the sensor left out. With --profile, train the '
        'trees for profile scanners, on simulated streets alone. With --survey, train those for '
        'clouds without scan lines; with --sweep, those for sweeps in the frame of a vehicle, '
        'whose rings do not show; with --free, on recordings without their rings and simulated '
        'scanners, those for scanners without rings; with --mixed, those of `mixed_pixels`. It '
        'takes about a quarter of an hour of processor time; with --profile, --survey or --mixed a '
        'few minutes. Needs the extra "lab".',
        epilog='examples:\n  lidar-outlier-filter train --data clean --output trees.json\n'
        '  lidar-outlier-filter train --survey --output trees.json',
    )
    parser.add_argument(
        '--profile', action='store_true', help='for profile scanners, on simulated streets alone'
    )
    parser.add_argument(
        '--survey',
        action='store_true',
        help='for clouds without scan lines, on simulated surveys alone',
    )
    parser.add_argument(
        '--free',
        action='store_true',
        help='for scanners without rings: on simulated ones, and recordings without their rings',
    )
    parser.add_argument(
        '--sweep', action='store_true', help='for sweeps without rings, in the frame of a vehicle'
    )
    parser.add_argument(
        '--mixed', action='store_true', help='for `mixed_pixels`: points between two surfaces alone'
    )
    parser.add_argument(
        '--data',
        type=Path,
        metavar='DIR',
        help=f"folder of the project's clean recordings; default: {DATA}, or none with --onto",
    )
    parser.add_argument(
        '--onto',
        type=Path,
        nargs='+',
        default=[],
        metavar='RECORDING',
        help='own clean recordings, each from a different spinning sensor',
    )
    add_parameter_options(parser)
    parser.add_argument(
        '--output',
        type=Path,
        metavar='FILE',
        help=f'new; default: {OUTPUT}, {PROFILE_OUTPUT} with --profile, {SURVEY_OUTPUT} with '
        f'--survey, {SWEEP_OUTPUT} with --sweep, {FREE_OUTPUT} with --free, {MIXED_OUTPUT} with '
        '--mixed',
    )
    parser.add_argument(
        '--seed', type=int, default=1, metavar='N', help='random seed, from 0; default: 1'
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from lidar_outlier_filter.disk.new_files import check_new, new_output

    import_module('sklearn')  # before the work
    kinds = {
        'profile': (PROFILE_OUTPUT, _train_scenes),
        'survey': (SURVEY_OUTPUT, _train_scenes),
        'sweep': (SWEEP_OUTPUT, _train_sweeps),
        'free': (FREE_OUTPUT, _train_free),
        'mixed': (MIXED_OUTPUT, _train_spinning),
    }
    chosen = [kind for name, kind in kinds.items() if getattr(options, name)]
    if len(chosen) > 1:
        raise FilterError(', '.join(f'--{name}' for name in kinds), 'one of them', 'more')
    default, train = (*chosen, (OUTPUT, _train_spinning))[0]
    output = options.output or default
    if options.seed < 0:
        raise FilterError('--seed', 'at least 0', options.seed)
    check_new(output)
    with stoppable_bar('training') as progress:
        text, threshold, tables = train(options, progress)
    with new_output(output) as built:
        built.write_text(text, encoding='utf-8')
    spaced = (part for table in tables for part in (table, ''))
    show(*spaced, f'threshold: log-odds of {threshold:g}', f'written to {output}')
    return DONE


def _train_spinning(options: argparse.Namespace, progress: Progress) -> _Trained:
    from lidar_outlier_lab.simulation.weather.kinds import WEATHERS
    from lidar_outlier_lab.training import scenes, train_ghosts, train_mixed
    from lidar_outlier_lab.training.train import Recipe, train

    progress(0, 1, 'reading')
    recordings, scanners = _recordings(options), _scanners(options)
    laws = () if options.mixed else scenes.TRAINED
    weathers = [train_mixed.MIXED] if options.mixed else [*WEATHERS]
    sweeps = scenes.make_sweeps(
        recordings, scanners, options.seed, progress, laws=laws, weathers=weathers
    )
    about = _about([name for name, _ in recordings], [*scanners], weathers, laws)
    if options.mixed:
        about['about'] = 'Trees on mixed pixels, by lidar-outlier-filter train --mixed'
        result = train_mixed.train(sweeps, about, options.seed, progress)
        return result.text, result.threshold, [_mixed_table(result.held_out)]
    result = train(sweeps, about, Recipe(options.seed), progress)
    text = train_ghosts.add_ghosts(sweeps, result.text, progress)
    return text, result.threshold, _tables(result.held_out)


def _train_sweeps(options: argparse.Namespace, progress: Progress) -> _Trained:
    """Train on recordings with weather, without their rings."""
    from lidar_outlier_lab.simulation.weather.kinds import WEATHERS
    from lidar_outlier_lab.training import scenes, train_sweeps
    from lidar_outlier_lab.training.folds import train_in_folds

    progress(0, 1, 'reading')
    recordings, scanners = _recordings(options), _scanners(options)
    every = scenes.make_sweeps(recordings, scanners, options.seed, progress)
    sweeps = train_sweeps.choose(every)
    recipe, seen = train_sweeps.recipe_for(sweeps), [*map(train_sweeps.scene_of, sweeps)]
    about = _about([name for name, _ in recordings], [*scanners], [*WEATHERS], scenes.TRAINED)
    about['about'] = 'Two ensembles of trees for sweeps without rings, by train --sweep'
    result = train_in_folds(seen, recipe, about, options.seed, progress)
    return result.text, result.threshold, [_scenes_table(result.held_out, recipe.what)]


def _train_free(options: argparse.Namespace, progress: Progress) -> _Trained:
    """Train on scanners without rings that are simulated, and on recordings in bands."""
    from lidar_outlier_filter import __version__
    from lidar_outlier_lab.training import free_sweeps
    from lidar_outlier_lab.training.train import train

    progress(0, 1, 'reading')
    recordings = _recordings(options)
    sweeps = free_sweeps.make_sweeps(recordings, options.seed, progress)
    about = {
        'about': 'Two ensembles of trees for scanners without rings, by train --free',
        'package': __version__,
        'trained_on': free_sweeps.about([name for name, _ in recordings]),
    }
    recipe = free_sweeps.RECIPE._replace(seed=options.seed)
    result = train(sweeps, about, recipe, progress)
    return result.text, result.threshold, _tables(result.held_out)


def _train_scenes(options: argparse.Namespace, progress: Progress) -> _Trained:
    """Train on streets, or on surveys, that are simulated."""
    from lidar_outlier_filter import __version__
    from lidar_outlier_lab.training import train_profile, train_survey
    from lidar_outlier_lab.training.folds import train_in_folds

    _check_alone(options, '--profile' if options.profile else '--survey')
    scenes: Sequence[Any]
    if options.profile:
        recipe, streets = train_profile.RECIPE, train_profile.make_streets(progress)
        scenes = streets
    else:
        recipe, scenes = train_survey.RECIPE, train_survey.make_scenes(progress)
    what, count = recipe.what, len(scenes)
    about = {
        'about': f'Ensembles of trees, trained on {what}s by lidar-outlier-filter train',
        'package': __version__,
        'trained_on': {f'{what}s': count, f'{what}_seeds': [0, count - 1]},
    }
    result = train_in_folds(scenes, recipe, about, options.seed, progress)
    if options.profile:
        result = result._replace(text=train_profile.add_mixed(streets, result.text, options.seed))
    return result.text, result.threshold, [_scenes_table(result.held_out, what)]


def _check_alone(options: argparse.Namespace, name: str) -> None:
    """Refuse options that only training on spinning sensors has."""
    given = {
        '--data': options.data,
        '--onto': options.onto,
        '--params': options.params,
        '--set': options.settings,
    }
    for other, value in given.items():
        if value:
            raise FilterError(name, f'without {other}', f'{name} with {other}')


def _table(head: Sequence[str], rows: Mapping[str, Sequence[str]]) -> Table:
    """Lay out figures of what was left out: a name, and numbers to its right."""
    from lidar_outlier_filter.evaluation.report import number_table

    table = number_table(*head)
    for name, figures in rows.items():
        table.add_row(name, *figures)
    return table


def _scenes_table(held_out: Mapping[str, Any], what: str) -> Table:
    """Lay out the figures of the scenes left out."""
    rows = {cause: (f'{100 * share:.2f} %',) for cause, share in held_out['recall'].items()}
    rows['F1'] = (f'{held_out["f1"]:.3f}',)
    rows['good points lost'] = (f'{100 * held_out["lost"]:.4f} %',)
    rows[f'of the median kind of {what}'] = (f'{100 * held_out["lost_of_median_kind"]:.4f} %',)
    return _table((f'cause, {what} left out', 'found'), rows)


def _folder(options: argparse.Namespace) -> Path | None:
    """Return the folder of real data; None: it does not exist."""
    given: Path | None = options.data
    return given or (None if options.onto else DATA)


def _recordings(options: argparse.Namespace) -> list[tuple[str, Sequence[Points]]]:
    """Read clean clouds of each sensor."""
    from lidar_outlier_lab.training import scenes

    found: list[tuple[str, Sequence[Points]]] = []
    folder = _folder(options)
    if folder is not None:
        found = scenes.read_recordings(folder)
        if not found:
            raise FilterError('--data', 'a folder with bags/ of the known recordings', folder)
    values = read_parameters(options.params, options.settings)
    found += [
        (path.stem, scenes.read_sweeps(scenes.CleanRecording(path.stem, path, values)))
        for path in options.onto
    ]
    for sensor, clouds in found:
        if not all(map(scenes.has_pattern, clouds)):
            raise FilterError('a recording to train on', 'one of a spinning sensor', sensor)
    return found


def _scanners(options: argparse.Namespace) -> dict[str, SpinningScanner]:
    """Simulate the sensors whose tables of rings the folder of real data has."""
    from lidar_outlier_lab.training.ring_tables import known_scanners

    folder = _folder(options)
    return {} if folder is None else known_scanners(folder / 'ring_tables')


def _about(
    sensors: list[str], scanners: list[str], weathers: list[str], laws: Sequence[str]
) -> dict[str, Any]:
    from lidar_outlier_filter import __version__
    from lidar_outlier_lab.training import scenes

    return {
        'about': 'Two ensembles of trees for spinning sensors, by lidar-outlier-filter train',
        'package': __version__,
        'trained_on': {
            'recordings': sensors,
            'weather': weathers,
            'sweeps_of_each': scenes.OF_EACH,
            'laws': [*laws],
            'sweeps_of_law': scenes.OF_LAW,
            'simulated': scanners,
            'simulated_seeds': list(scenes.TABLE_SEEDS),
            'streets': list(scenes.STREETS),
            'street_seeds': list(scenes.STREET_SEEDS),
            'street_seed_held_out': scenes.STREET_SEED_HELD_OUT,
        },
    }


def _mixed_table(held_out: Mapping[str, Any]) -> Table:
    """Lay out the figures of mixed pixels, of the sensors left out."""
    rows = {
        sensor: (
            f'{100 * held_out["found"].get(sensor, 0.0):.1f} %',
            f'{100 * share:.4f} %',
            f'{100 * held_out["clean_rejected"][sensor]:.4f} %',
        )
        for sensor, share in held_out['known_good_rejected'].items()
    }
    head = ('sensor left out', 'found', 'known good points lost', 'all points of clean sweeps')
    return _table(head, rows)


def _tables(held_out: Mapping[str, Any]) -> list[Table]:
    """Lay out the figures of the sensors left out."""
    dark, without = held_out['without_intensity'], 'without intensity'
    weather = {
        kind: (
            *(f'{one["f1"]:.3f}', f'{one["best_f1"]:.3f}', f'{100 * one["lost"]:.3f} %'),
            f'{dark["weather"][kind]["f1"]:.3f}',
        )
        for kind, one in held_out['weather'].items()
    }
    clean = {
        sensor: (f'{100 * share:.4f} %', f'{100 * dark["clean_rejected"][sensor]:.4f} %')
        for sensor, share in held_out['clean_rejected'].items()
    }
    street = {
        name: (f'{f1:.3f}', f'{dark["street_f1"][name]:.3f}')
        for name, f1 in held_out['street_f1'].items()
    }
    head = ('weather, sensor left out', 'F1', 'best F1', 'good points lost', without)
    return [
        _table(head, weather),
        _table(('clean, sensor left out', 'rejected', without), clean),
        _table(('street, sensor left out', 'F1', without), street),
    ]
