# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters as text: ROS parameter YAML, read and written, and the tables of the documentation."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import yaml

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.filter import describe

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

NODE_NAME = 'outlier_filter_node'


def read_yaml(path: Path) -> dict[str, object]:
    """Read the parameters for this node from a ROS parameter file, by flat, dotted names.

    Taken are the sections for this node's name in any namespace and the wildcards ``/**`` and
    ``*``; later sections win. What ROS itself declares (``use_sim_time``, ``qos_overrides``) stays
    among them.

    Raises
    ------
    ParameterError
        If the file cannot be read, is no YAML, or has no section for this node.

    """
    try:
        tree = parse(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as err:
        reason = ' '.join(str(err).split())
        raise ParameterError(str(path), 'a readable YAML file', reason) from err
    sections = list(_sections(tree)) if isinstance(tree, dict) else []
    if not sections:
        must_be = f"a ROS parameter file with 'ros__parameters' for {NODE_NAME!r} or '/**'"
        raise ParameterError(str(path), must_be, 'none')
    values: dict[str, object] = {}
    for section in sections:
        values.update(_flatten(section, ''))
    return values


def parse(text: str) -> Any:
    """Read YAML as ROS does, to which 1e-6 is a number; to PyYAML, it is a text without a dot."""
    return yaml.load(text, Loader=_Loader)  # noqa: S506  a SafeLoader


class _Loader(yaml.SafeLoader):
    """A safe loader that knows the floats of YAML 1.2."""


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+'),
    list('-+.0123456789'),
)


def _sections(tree: Mapping[str, Any], name: str = '') -> Iterator[Mapping[str, Any]]:
    """Yield the parameters of every section that is meant for this node."""
    for key, value in tree.items():
        if key == 'ros__parameters':
            if name.rpartition('/')[2] in {NODE_NAME, '**', '*'} and isinstance(value, dict):
                yield value
        elif isinstance(value, dict):
            yield from _sections(value, f'{name}/{str(key).strip("/")}')


def _flatten(tree: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flatten(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


def _scalar(value: object) -> str:
    text: str = yaml.safe_dump(value, default_flow_style=True, width=1000)
    return text.removesuffix('...\n').strip()


def write_yaml(values: Mapping[str, object] | None = None) -> str:
    """Write a ROS parameter file, each parameter under its sentence; without values: defaults."""
    lines = ['/**:', '  ros__parameters:']
    section = ''
    for parameter in describe():
        head, _, leaf = parameter.name.rpartition('.')
        if head != section:
            lines += ['', f'    {head}:']
            section = head
        indent = '    ' + '  ' * bool(head)
        value = (
            parameter.default if values is None else values.get(parameter.name, parameter.default)
        )
        plain = list(value) if isinstance(value, tuple) else value
        lines += [
            f'{indent}# {parameter.text}',
            f'{indent}# {parameter.range_text}'
            + (' (set at the start only)' if parameter.fixed else ''),
            f'{indent}{leaf}: {_scalar(plain)}',
        ]
    return '\n'.join(lines) + '\n'


def table(section: str | None = None) -> str:
    """Write a table of parameters for the documentation, in Markdown.

    All of them; or those of one section, such as ``lof``, the empty one being those of none.
    """
    lines = ['| parameter | default | allowed | what it does |', '| --- | --- | --- | --- |']
    for parameter in describe():
        if section not in {None, parameter.name.rpartition('.')[0]}:
            continue
        value = parameter.default
        shown = ', '.join(value) if isinstance(value, tuple) else _scalar(value)
        mark = ' (start)' if parameter.fixed else ''
        lines.append(
            f'| `{parameter.name}`{mark} | `{shown}` | {parameter.range_text} | {parameter.text} |'
        )
    return '\n'.join(lines) + '\n'
