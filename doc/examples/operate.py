# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Operate a running node where there is no ``ros2``.

python operate.py NODE diagnostics           # NODE: such as /outlier_filter_node
python operate.py NODE set chain "['lof']"   # as ros2 param set
python operate.py NODE enable false          # the services: enable, save_parameters, reset
python operate.py NODE configure             # a managed node: also activate, deactivate, shutdown …

The exit status is 1 where the node refuses.
"""

import sys
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import get_parameter_value
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

TIMEOUT = 10.0  # seconds
KNOWN = (
    'diagnostics, set NAME VALUE, enable true, enable false, save_parameters, reset, '
    'configure, activate, deactivate, cleanup, shutdown'
)


def check(node: str = '', *words: str) -> None:
    """Refuse other words than those that are known."""
    is_set = len(words) == 3 and words[0] == 'set'  # noqa: PLR2004  a name and a value
    if not is_set and ' '.join(words) not in KNOWN.split(', '):
        got = ' '.join([node, *words])
        sys.exit(f'the arguments must be NODE and one of: {KNOWN}; got {got!r}')


def main(node: str, what: str, *values: str) -> Any:
    """Do what is said, and return the response of the node, or its diagnostics."""
    if what == 'set':
        name, value = values
        parameter = Parameter(name=name, value=get_parameter_value(value))
        return call(SetParameters, f'{node}/set_parameters', parameters=[parameter]).results[0]
    if what == 'enable':
        return call(SetBool, f'{node}/enable', data=values == ('true',))
    if what in {'save_parameters', 'reset'}:
        return call(Trigger, f'{node}/{what}')
    if what == 'diagnostics':
        return diagnostics(node.removeprefix('/'))
    return call(ChangeState, f'{node}/change_state', transition=Transition(label=what))


def diagnostics(node: str) -> str:
    """Wait for the diagnostics of a node; each value has a line."""
    found = Future()

    def receive(message: DiagnosticArray) -> None:
        said = [one for one in message.status if one.name.startswith(f'{node}: ')]
        if said and not found.done():
            found.set_result(said)

    me.create_subscription(DiagnosticArray, '/diagnostics', receive, 10)
    lines = []
    for status in wait(found, f'/{node} must be running, and active if managed'):
        lines.append(f'{status.name}: {status.message}')
        lines += [f'  {value.key}: {value.value}' for value in status.values]
    return '\n'.join(lines)


def call(kind: Any, name: str, **fields: object) -> Any:
    """Call a service."""
    client = me.create_client(kind, name)
    if not client.wait_for_service(TIMEOUT):
        sys.exit(f'{name} must be a service of a running node, got none')
    return wait(client.call_async(kind.Request(**fields)), f'{name} must respond')


def wait(future: Future, must_be: str) -> Any:
    """Return what comes, or exit with a sentence."""
    rclpy.spin_until_future_complete(me, future, timeout_sec=TIMEOUT)
    if not future.done():
        sys.exit(f'{must_be}, got nothing for {TIMEOUT:.0f} s')
    return future.result()


if __name__ == '__main__':
    check(*sys.argv[1:])
    rclpy.init()
    me = rclpy.create_node('operate')
    answer = main(*sys.argv[1:])
    sys.stdout.write(f'{answer}\n')
    is_done = [getattr(answer, name, True) for name in ('success', 'successful')]
    sys.exit(not all(is_done))
