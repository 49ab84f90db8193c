# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters as text: ROS parameter YAML, read and written."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from lidar_outlier_filter.errors import ParameterError
from lidar_outlier_filter.parameters.declaration import read_small
from lidar_outlier_filter.parameters.filter import FilterParameters, describe

NODE_NAME = 'outlier_filter_node'
MAX_YAML_BYTES = 1_000_000  # bytes
DEEPEST = 20  # levels


def config_folder() -> Path:
    """Return the folder ``config`` of the package: installed, or beside its sources.

    It does not exist where somebody copied the sources alone.
    """
    package = Path(__file__).parents[1]
    for root in package.parents:  # a wheel is built below the sources
        for folder in (root / 'share' / package.name / 'config', root / 'config'):
            if (folder / 'defaults.yaml').is_file() and (folder.parent / 'package.xml').is_file():
                return folder
    return package.parent / 'config'


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
        data = read_small(path, MAX_YAML_BYTES)
        if len(data) > MAX_YAML_BYTES:
            raise ParameterError(str(path), f'of at most {MAX_YAML_BYTES} bytes', 'more')
        tree = parse(data.decode())
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
    """Read YAML as ROS does: without aliases, and with numbers as people write them.

    So 1e-6 is a number, and 1:30, 010 and 2001-01-01 are texts, all unlike in YAML 1.1.

    Raises
    ------
    yaml.YAMLError
        If it is no YAML, if it has aliases, or if it nests more than 20 deep.

    """
    try:
        return yaml.load(text, Loader=_Loader)  # noqa: S506  a SafeLoader
    except ValueError as err:  # a number of thousands of digits
        raise yaml.YAMLError(str(err)) from err


class _Loader(yaml.SafeLoader):
    """A safe loader with the numbers of JSON, and no structure that is larger than its text."""

    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Build a node, unless it is an alias or lies too deep."""
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError('an alias, which ROS does not allow')
        if self.depth == DEEPEST:
            raise yaml.YAMLError(f'more than {DEEPEST} levels')
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


_Loader.yaml_implicit_resolvers = {
    first: [one for one in found if one[0].rpartition(':')[2] not in {'int', 'float', 'timestamp'}]
    for first, found in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:int',
    re.compile(r'[-+]?(0|[1-9][0-9]*|0x[0-9a-fA-F]+)$'),
    list('-+0123456789'),
)
_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(
        r'([-+]?((0|[1-9][0-9]*)?\.[0-9]+|(0|[1-9][0-9]*)(\.[0-9]*)?)([eE][-+]?[0-9]+)?'
        r'|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))$'
    ),
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


def as_yaml(value: Any) -> str:
    """Write a value so that ROS reads it back: to its YAML, 1e-06 would be a string."""
    plain = list(value) if isinstance(value, tuple) else value
    text: str = yaml.safe_dump(plain, default_flow_style=True, width=1000)
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
        lines += [
            f'{indent}# {parameter.text}',
            f'{indent}# {parameter.range_text}'
            + (' (set at the start only)' if parameter.fixed else ''),
            f'{indent}{leaf}: {as_yaml(value)}',
        ]
    return '\n'.join(lines) + '\n'


def ros_lines(start: FilterParameters, values: Mapping[str, object]) -> list[str]:
    """Write commands that change a running node, one parameter at a time.

    Their order is such that the node, if it runs with its start-up parameters, accepts each.
    """
    left = {name: value for name, value in values.items() if start.flat()[name] != value}
    lines, now = [], start
    while left:
        for name, value in left.items():
            try:
                now = now.changed({name: value})
            except ParameterError:
                continue
            break
        else:
            # No order of single steps is valid: one step is refused, and must be repeated later.
            name, value = next(iter(left.items()))
        lines.append(f'ros2 param set /{NODE_NAME} {name} {as_yaml(value)}')
        del left[name]
    return lines
