# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Operate a running node where there is no ``ros2``.

python operate.py NODE diagnostics           # of all nodes; NODE: such as /outlier_filter_node
python operate.py NODE set chain "['lof']"   # as ros2 param set
python operate.py NODE enable false          # the services: enable, save_parameters, reset
python operate.py NODE configure             # a managed node: also activate, deactivate, cleanup
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
from rclpy.wait_for_message import wait_for_message
from std_srvs.srv import SetBool, Trigger

TIMEOUT = 10.0  # seconds
KNOWN = (
    'diagnostics, set NAME VALUE, enable true, enable false, save_parameters, reset, '
    'configure, activate, deactivate, cleanup'
)


def check(node: str = '', *words: str) -> None:
    """Refuse other words than those that are known."""
    is_set = len(words) == 3 and words[0] == 'set'  # noqa: PLR2004  a name and a value
    if not is_set and ' '.join(words) not in KNOWN.split(', '):
        got = ' '.join([node, *words])
        sys.exit(f'the arguments must be NODE and one of: {KNOWN}; got {got!r}')


def main(node: str, what: str, *values: str) -> object:
    """Do what is said, and return the response of the node."""
    if what == 'set':
        name, value = values
        parameter = Parameter(name=name, value=get_parameter_value(value))
        return call(SetParameters, f'{node}/set_parameters', parameters=[parameter])
    if what == 'enable':
        return call(SetBool, f'{node}/enable', data=values == ('true',))
    if what in {'save_parameters', 'reset'}:
        return call(Trigger, f'{node}/{what}')
    if what == 'diagnostics':
        return diagnostics()
    transition = Transition(id=getattr(Transition, f'TRANSITION_{what.upper()}'))
    return call(ChangeState, f'{node}/change_state', transition=transition)


def diagnostics() -> str:
    """Wait for the diagnostics; each value has a line."""
    come, said = wait_for_message(DiagnosticArray, me, '/diagnostics', time_to_wait=TIMEOUT)
    if not come:
        sys.exit('/diagnostics must be published by a running node, got nothing')
    lines = []
    for status in said.status:
        lines.append(f'{status.name}: {status.message}')
        lines += [f'  {value.key}: {value.value}' for value in status.values]
    return '\n'.join(lines)


def call(kind: Any, name: str, **fields: object) -> object:
    """Call a service."""
    client = me.create_client(kind, name)
    if not client.wait_for_service(TIMEOUT):
        sys.exit(f'{name} must be a service of a running node, got none')
    response = client.call_async(kind.Request(**fields))
    rclpy.spin_until_future_complete(me, response, timeout_sec=TIMEOUT)
    return response.result()


if __name__ == '__main__':
    check(*sys.argv[1:])
    rclpy.init()
    me = rclpy.create_node('operate')
    sys.stdout.write(f'{main(*sys.argv[1:])}\n')
