# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""A node's parameters: declared, checked, set while it runs, saved to a file and put back."""

import os
from abc import abstractmethod
from array import array
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from std_srvs.srv import Trigger

from lidar_outlier_filter.disk.new_files import replaced
from lidar_outlier_filter.errors import ParameterError, quote_error
from lidar_outlier_filter.parameters.declaration import Parameter, did_you_mean, shown
from lidar_outlier_filter.parameters.filter import FilterParameters, describe
from lidar_outlier_filter.parameters.yaml_files import NODE_NAME, write_yaml
from lidar_outlier_filter.ros.channel import Channel

SAVED_HEADER = (
    '# Saved by ~/save_parameters. It overwrites this file only while this line is here.\n'
)
NODE_TIMEOUT = 10.0  # seconds until a change that the node has not begun is withdrawn


class TunableNode(Node):  # type: ignore[misc]
    """A node with the parameters of :mod:`lidar_outlier_filter.parameters.filter`.

    They are set one by one or together; an invalid value is refused, and no parameter is
    changed.

    Attributes
    ----------
    filter_parameters : as they were set last
    channels : one for each input; empty while a managed node is not configured
    statuses : the last diagnostics, one for each input; empty while the node does not run

    """

    def __init__(self, values: Mapping[str, object], **options: Any) -> None:
        """Declare every parameter; ``values`` replace defaults and win over the command line.

        Raises
        ------
        ParameterError
            If a parameter, given here or on the command line, makes no sense.

        """
        given = [RosParameter(name, value=_to_ros(values[name])) for name in values]
        super().__init__(NODE_NAME, parameter_overrides=given, **options)
        self.channels: tuple[Channel, ...] = ()
        self.statuses: Sequence[DiagnosticStatus] = ()
        self.filter_parameters = self._parameters_first = self._declare()

    def set_parameters(self, parameter_list: list[RosParameter]) -> list[SetParametersResult]:
        """Set each by itself."""
        return [self.set_parameters_atomically([item]) for item in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set all or none; refuse here, since rclpy's own messages have no units.

        A read-only parameter may be given with the value that it has, as in a file of all
        parameters. A number may be text: ros2cli passes '1e-06' so.
        """
        for item in parameter_list:
            if not self.has_parameter(item.name):
                must_be = 'one of this node, as ~/save_parameters writes them'
                got = shown(item.name) + did_you_mean([item.name], (one.name for one in describe()))
                return _refusal(ParameterError('a parameter', must_be, got))
        given = [item for item in _as_declared(parameter_list) if not self._is_as_it_is(item)]
        if not given:
            return SetParametersResult(successful=True)
        try:
            changed = self._changed(given)
        except ParameterError as err:
            return _refusal(err)
        result = super().set_parameters_atomically(given)
        if result.successful and changed != self.filter_parameters:
            before, after = self.filter_parameters.flat(), changed.flat()
            said = (
                f'{name}: {_to_ros(after[name])}' for name in after if after[name] != before[name]
            )
            self.get_logger().info(f'parameters set: {", ".join(said)}')
            self.filter_parameters = changed
            self.apply(changed)
        return result

    @abstractmethod
    def apply(self, parameters: FilterParameters) -> None:
        """Use changed parameters from the next block."""

    def _is_as_it_is(self, item: RosParameter) -> bool:
        """Return whether a read-only parameter is given the value that it has."""
        is_same: bool = _to_ros(self.get_parameter(item.name).value) == _to_ros(item.value)
        return is_same and bool(self.describe_parameter(item.name).read_only)

    def _serve_parameters(self) -> None:
        """Offer to save the parameters, and to put them back."""
        self.create_service(Trigger, '~/save_parameters', self._save)
        self.create_service(Trigger, '~/reset', self._reset)

    def _declare(self) -> FilterParameters:
        """Declare every parameter, and refuse values that make no sense, alone or together."""
        given = {
            name: parameter.value
            for name, parameter in self._parameter_overrides.items()
            # Those that ROS declares itself are not for us.
            if not (self.has_parameter(name) or name.startswith('qos_overrides.'))
        }
        parameters = FilterParameters().changed(given)
        values = parameters.flat()
        for item in describe():
            # Not the override but its checked value: a whole number may stand for a float.
            self.declare_parameter(
                item.name, _to_ros(values[item.name]), _descriptor(item), ignore_override=True
            )
        return parameters

    def _changed(self, parameters: Iterable[RosParameter]) -> FilterParameters:
        known = {parameter.name: parameter for parameter in describe()}
        values = {item.name: item.value for item in parameters if item.name in known}
        now = self.filter_parameters.flat()
        for name, value in values.items():
            if known[name].fixed:
                must_be = f'{_to_ros(now[name])!r} (read-only)'
                raise ParameterError(name, must_be, repr(value))
        return self.filter_parameters.changed(values)

    def _save(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Write the parameters to a file that ``--params-file`` reads."""
        path = self._file()
        try:
            path = path.expanduser()
            _write_whole(path, write_yaml(self.filter_parameters.flat()))
        except ParameterError as err:
            response.message = f'the parameters were not saved: {err}'
        # expanduser() raises RuntimeError for an unknown user, open() ValueError for a null byte.
        except (OSError, RuntimeError, ValueError) as err:
            got = f'{shown(str(path))}: {quote_error(err)}'
            wrong = ParameterError('the file', 'one that can be written', got)
            response.message = f'the parameters were not saved: {wrong}'
        else:
            response.success, response.message = True, str(path)
        return response

    def _file(self) -> Path:
        """Return ``save_to``, or else a file in ROS_HOME, named after this node; ~ stays."""
        if self.filter_parameters.save_to:
            return Path(str(self.filter_parameters.save_to))
        home = Path(os.environ.get('ROS_HOME') or '~/.ros')
        name: str = self.get_fully_qualified_name()
        return home / (name.strip('/').replace('/', '.') + '.yaml')

    def _reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Put every parameter back to what it was at the start."""
        now, first = self.filter_parameters.flat(), self._parameters_first.flat()
        changed = [name for name in first if now[name] != first[name]]
        values = [RosParameter(name, value=_to_ros(first[name])) for name in changed]
        result = self.set_parameters_atomically(values)
        response.success, response.message = result.successful, result.reason
        if response.success:
            response.message = 'reset to start values: ' + (', '.join(changed) or 'nothing to do')
        return response


class NodeAccess:
    """Reads a node at any time, and changes it in the executor's thread only."""

    def __init__(self, node: TunableNode) -> None:
        self._node = node

    @property
    def name(self) -> str:
        """The full name of the node."""
        return str(self._node.get_fully_qualified_name())

    @property
    def topics(self) -> list[str]:
        """The full names of its inputs; a managed node has none before it is configured."""
        return [channel.resolved for channel in self._node.channels]

    @property
    def parameters(self) -> FilterParameters:
        """The parameters as they were set last."""
        return self._node.filter_parameters

    def statuses(self) -> list[dict[str, object]]:
        """Say what the diagnostics said last, a status for each input."""
        return [
            {
                'name': status.hardware_id,
                'level': int.from_bytes(status.level, 'little'),
                'message': status.message,
                'values': {item.key: item.value for item in status.values},
            }
            for status in self._node.statuses
        ]

    def set(self, values: Mapping[str, str]) -> str:
        """Set all parameters or none, as `ros2 param set` does; return the error, '' if none.

        A change that the node has not begun in time is cancelled.
        """
        reply: Future[str] = Future()

        def apply() -> None:
            if not reply.set_running_or_notify_cancel():
                return
            given = [RosParameter(name, value=value) for name, value in values.items()]
            try:
                result = self._node.set_parameters_atomically(given)
            except BaseException as err:
                reply.set_exception(err)
                raise
            reply.set_result('' if result.successful else result.reason)

        executor = self._node.executor
        if executor is None:
            return 'the node is starting or shutting down'
        executor.create_task(apply)
        try:
            return reply.result(NODE_TIMEOUT)
        except TimeoutError:
            if reply.cancel():
                return f'the node did not reply within {NODE_TIMEOUT:g} s'
            return reply.result()  # it has begun, and ends soon


def _write_whole(path: Path, text: str) -> None:
    """Write a file that is never seen half written; replace only one that was written here."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if os.path.lexists(path):
        is_plain = not path.is_symlink() and (path.is_file() or path.is_dir())
        begin = b''
        # Files of the system may block, and say that they are empty; others may be endless.
        if is_plain and path.stat().st_size >= len(SAVED_HEADER):
            with path.open('rb') as stream:
                begin = stream.read(len(SAVED_HEADER))
        if begin != SAVED_HEADER.encode():
            must_be = 'new, or saved by ~/save_parameters'
            raise ParameterError('the file', must_be, shown(str(path)))
    with replaced(path) as built:
        built.write_text(SAVED_HEADER + text, encoding='utf-8')


def _refusal(err: ParameterError) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=str(err))


def _to_ros(value: object) -> object:
    """Return arrays of every kind as lists."""
    return list(value) if isinstance(value, tuple | list | array) else value


def _as_declared(parameters: Iterable[RosParameter]) -> list[RosParameter]:
    """Read numbers from text, and let whole numbers stand for floats, where these are declared."""
    kinds = {item.name: type(item.default) for item in describe()}
    accepted = {RosParameter.Type.STRING, RosParameter.Type.INTEGER}
    result = []
    for item in parameters:
        kind, converted = kinds.get(item.name), item
        if kind in {int, float} and item.type_ in accepted:
            with suppress(ValueError):
                converted = RosParameter(item.name, value=kind(item.value))
        result.append(converted)
    return result


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=parameter.text + (f' [{parameter.unit}]' if parameter.unit else ''),
        additional_constraints=parameter.range_text,
        read_only=parameter.fixed,
    )
    if parameter.low is not None and parameter.high is not None:
        if isinstance(parameter.default, float):
            low, high = float(parameter.low), float(parameter.high)
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        else:
            first, last = int(parameter.low), int(parameter.high)
            descriptor.integer_range = [IntegerRange(from_value=first, to_value=last, step=1)]
    return descriptor
