# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The house: which room may use which, and what from outside. ``pytest -rP`` prints the graph."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import defaultdict
from functools import cache
from typing import TYPE_CHECKING

import pytest
from helpers import ROOT

from lidar_outlier_filter.core.detectors.plugins import BUILTIN

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

PACKAGE, LAB = 'lidar_outlier_filter', 'lidar_outlier_lab'
# From the ground up: a room may use those before it, and nothing behind it. The laboratory, whose
# rooms begin with `lab.`, may use the product, and the product nothing of it.
FLOORS = (
    ('errors',),
    ('parameters', 'disk'),
    ('core',),
    ('messages',),
    ('pipeline',),
    ('files', 'recordings', 'ros'),
    ('archive', 'evaluation'),
    ('tuning', 'report'),
    ('cli', 'lab.simulation'),
    ('lab.training', 'lab.results'),
    ('lab.cli',),
)
ROOMS = tuple(room for floor in FLOORS for room in floor)
# What each room may import from outside, beside the standard library.
MESSAGES = ('diagnostic_msgs', 'nav_msgs', 'rcl_interfaces', 'sensor_msgs', 'std_msgs', 'std_srvs')
OUTSIDE = {
    'errors': (),
    'parameters': ('numpy', 'yaml'),
    'disk': ('numpy',),
    'core': ('numpy', 'scipy'),
    'messages': ('numpy',),
    'pipeline': ('numpy', 'zstandard'),
    'recordings': ('mcap', 'numpy', 'rosbags', 'yaml'),
    'files': ('laspy', 'lazrs', 'lzf', 'numpy', 'pyarrow', 'pye57', 'pyproj'),
    'ros': ('numpy', 'rclpy', *MESSAGES),
    'archive': ('dask', 'distributed', 'fsspec', 'numpy'),
    'evaluation': ('matplotlib', 'numpy', 'rich', 'scipy'),
    'tuning': ('numpy', 'rosbags', 'rich', 'scipy', 'yaml'),
    'report': ('matplotlib', 'numpy', 'scipy'),
    'cli': ('argcomplete', 'numpy', 'rich', 'yaml'),
    'lab.simulation': ('numpy', 'rich', 'rosbags', 'scipy'),
    'lab.training': ('numpy', 'rosbags', 'yaml', 'scipy', 'sklearn'),
    'lab.results': (
        *('PIL', 'matplotlib', 'numpy', 'open3d', 'rich', 'rosbags', 'scipy', 'sklearn'),
        'small_gicp',
    ),
    'lab.cli': ('numpy', 'rich'),
}

ANNOTATIONS = f'{PACKAGE}.core.annotations'
HERE = ROOT / 'test/house/test_rooms.py'
# Words that stood for others: feature, contribution, score, rng, reject, train.
PRIVATE_WORDS = re.compile(
    r'\b(witness(es)?|testimony|dice|gossip|loudest|condemn(s|ed)?|hears?|heard|told|taught)\b',
    re.IGNORECASE,
)


class Module:
    """A file of the package and what it imports."""

    def __init__(self, path: Path) -> None:
        """Read the file."""
        self.name = '.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__')
        self.tree = ast.parse(path.read_text('utf-8'))

    @property
    def room(self) -> str:
        """The folder below the package, or the file in it; empty for the package itself."""
        package, _, below = self.name.partition('.')
        room = below.split('.')[0]
        return f'lab.{room}' if package == LAB and room else room

    def imports(self) -> Iterator[str]:
        """Name what is imported anywhere in the file, for types only too."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f'{self.name} imports by dots'
                yield from (f'{node.module}.{alias.name}' for alias in node.names)


@cache
def modules() -> dict[str, Module]:
    """All modules of the package by name."""
    found = [Module(one) for top in (PACKAGE, LAB) for one in sorted((ROOT / top).rglob('*.py'))]
    return {module.name: module for module in found}


def used(module: Module) -> set[str]:
    """Name the modules of the package that one imports."""
    names = set()
    for name in module.imports():
        while name and name not in modules():
            name = name.rpartition('.')[0]  # noqa: PLW2901  a name of a module is within a module
        names.add(name)
    return names - {'', PACKAGE, module.name}


def test_every_module_has_a_room() -> None:
    """Only the door and the errors lie at the entrance."""
    assert {module.room for module in modules().values()} - {''} == set(ROOMS)


def test_rooms_use_only_those_below_them() -> None:
    """Imports go one way, those for types too; the table of them is printed."""
    table: dict[str, set[str]] = defaultdict(set)
    wrong = []
    for module in modules().values():
        for name in used(module):
            below = modules()[name].room
            if not (module.room and below) or below == module.room:
                continue
            table[module.room].add(below)
            floor = next(i for i, rooms in enumerate(FLOORS) if module.room in rooms)
            if not any(below in rooms for rooms in FLOORS[:floor]):
                wrong.append(f'{module.name} uses {name}')
    for room in ROOMS:
        print(  # noqa: T201  asked for with -rP
            f'{room:12} uses {", ".join(sorted(table[room], key=ROOMS.index)) or "nothing"}'
        )
    assert not wrong


def test_no_circle() -> None:
    """No module reaches itself by what it imports."""
    graph = {name: used(module) for name, module in modules().items()}
    circles = []
    for name in graph:
        reached: set[str] = set()
        pending = [name]
        while pending:
            for other in graph[pending.pop()] - reached:
                reached.add(other)
                pending.append(other)
        if name in reached:
            circles.append(name)
    assert not circles


@pytest.mark.parametrize('room', ROOMS)
def test_from_outside(room: str) -> None:
    """The standard library and what is listed, no more; arguments are for the command line."""
    allowed = {PACKAGE, LAB, *OUTSIDE[room], *sys.stdlib_module_names}
    allowed -= set() if room.endswith('cli') else {'argparse'}
    wrong = [
        f'{module.name} imports {name}'
        for module in modules().values()
        if module.room == room
        for name in module.imports()
        if name.split('.')[0] not in allowed
    ]
    assert not wrong


def type_aliases(module: Module) -> Iterator[tuple[str, str]]:
    """Give the names that a module has for types of its annotations, and what they stand for."""
    guarded = (one for node in module.tree.body if isinstance(node, ast.If) for one in node.body)
    for one in (*module.tree.body, *guarded):
        if isinstance(one, ast.Assign) and not isinstance(one.value, ast.Call):
            name = ast.unparse(one.targets[0])
            if re.fullmatch(r'_?([A-Z][a-z]+)+', name):
                yield name, ast.unparse(one.value)


def test_no_alias_of_a_type_twice() -> None:
    """A name of a type means one thing; those of arrays are in ``core.annotations``."""
    found = defaultdict(list)
    for module in modules().values():
        for node in module.tree.body:
            if isinstance(node, ast.ClassDef):
                found[node.name].append(module.name)
        for name, meaning in type_aliases(module) if module.name != ANNOTATIONS else ():
            found[name].append(module.name)
            if meaning.startswith('NDArray['):
                found[name].append(ANNOTATIONS)
    assert not {name: where for name, where in found.items() if len(where) > 1}


DETECTORS = f'{PACKAGE}.core.detectors'


def homes() -> dict[str, str]:
    """Find the module or folder of each detector by the first part of its parameters' names."""
    return {name: f'{DETECTORS}.{name}' for name in BUILTIN}


def is_about(text: str, names: Iterable[str]) -> bool:
    """Return whether a text is the name of a detector, or of one of its parameters."""
    return any(text == name or text.startswith(f'{name}.') for name in names)


def named(module: Module, names: set[str]) -> Iterator[str]:
    """Name what a module says of detectors: as an import, an attribute or a text of its own.

    A name alone may be a variable, as the angle ``elevation``. Docstrings and help are sentences.
    """
    for imported in module.imports():
        if imported.startswith(f'{DETECTORS}.') and is_about(imported[len(DETECTORS) + 1 :], names):
            yield f'import {imported}'
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Attribute) and node.attr in names:
            yield f'.{node.attr}'
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and is_about(text, names):
            yield repr(text)


# The tables of all detectors.
TABLES = {
    *('core.detectors.builtin', 'core.detectors.plugins', 'core.detectors.thresholds'),
    'tuning.search_space',
}


def test_nobody_names_a_detector() -> None:
    """Detectors are named in a few tables, and nowhere else."""
    found = homes()
    wrong = []
    for module in modules().values():
        below = module.name.removeprefix(f'{PACKAGE}.')
        if below == module.name or below in TABLES:
            continue
        others = {name for name, home in found.items() if not module.name.startswith(home)}
        wrong += [f'{module.name}: {one}' for one in named(module, others)]
    assert found
    assert set(wrong) <= {f"{PACKAGE}.cli.info: 'elevation'"}  # the angle of rings


def test_plain_words() -> None:
    """The field's words are used everywhere: features contribute, and models are trained."""
    folders = (PACKAGE, LAB, 'test', 'doc', 'config', 'launch')
    paths = [path for folder in folders for path in (ROOT / folder).rglob('*')]
    paths.remove(HERE)  # it has the words
    paths += [ROOT / name for name in ('README.md', 'CONTRIBUTING.md', 'CHANGELOG.rst')]
    wrong = [
        f'{path.relative_to(ROOT)}: {found[0]}'
        for path in paths
        if path.suffix in {'.py', '.md', '.rst', '.yaml'}
        for found in PRIVATE_WORDS.finditer(path.read_text('utf-8'))
    ]
    assert not wrong


def test_programs_end_with_their_call() -> None:
    """Where a module is a program, too, nothing is defined behind the call: too late."""
    early = []
    for module in modules().values():
        body = module.tree.body
        calls = [one for one in body if ast.unparse(one).startswith("if __name__ == '__main__'")]
        early += [module.name for one in calls if one is not body[-1]]
    assert not early


# What a plain `pip install .` has not, and the modules that cannot be imported without it.
EXTRAS = (
    *('argcomplete', 'dask', 'distributed', 'fsspec', 'laspy', 'lzf', 'matplotlib', 'PIL'),
    *('psutil', 'pyarrow', 'pye57', 'pyproj', 'sklearn'),
)
NEED_EXTRAS = {
    *('evaluation.plots', 'files.copc', 'files.e57', 'files.las', 'files.las_header'),
    *('files.parquet', 'files.pcd', 'report.figures'),
}
IMPORT_ALL = f"""
import importlib, pkgutil, sys
import {PACKAGE}

sys.modules |= dict.fromkeys({EXTRAS})
for module in pkgutil.walk_packages({PACKAGE}.__path__, '{PACKAGE}.'):
    try:
        importlib.import_module(module.name)
    except ModuleNotFoundError:
        print(module.name)
"""


def test_extras_are_needed_where_they_are_used() -> None:
    """A command that reads no LAS runs without laspy: no other module cannot be imported."""
    told = subprocess.run(
        [sys.executable, '-c', IMPORT_ALL], capture_output=True, text=True, check=True
    )
    assert set(told.stdout.split()) == {f'{PACKAGE}.{name}' for name in NEED_EXTRAS}
