# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""Start the filter: ``ros2 launch lidar_outlier_filter filter.launch.py input_topic:=/points``.

Several sensors: ``input_topic:=/left/points,/right/points`` for one process that serves them all,
or ``namespace:=left,right input_topic:=points sensor:=ouster,livox`` for a process each.
"""

import itertools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile
from rclpy.expand_topic_name import expand_topic_name

from lidar_outlier_filter.pipeline.topics import output_topics
from lidar_outlier_filter.ros.executable import split_files, split_namespaces, whole_number
from lidar_outlier_filter.ros.node import NODE_NAME, remappings

RESPAWN_DELAY = 2.0  # seconds: one that ends at once does not fill the log
# Seconds from SIGINT to SIGTERM, which ends the node at once: until then it filters what it has.
SIGTERM_TIMEOUT = '30'
RELIABILITIES = ('best_effort', 'reliable')
POLICIES: dict[str, Callable[[str, str], object]] = {
    'reliability': lambda _, text: text,
    'depth': whole_number,
}
CONFIG = Path(__file__).parents[1] / 'config'
# Variables that name the settings for large clouds, by middleware; each reads its own only.
LARGE_CLOUDS = {
    'FASTRTPS_DEFAULT_PROFILES_FILE': str(CONFIG / 'fastdds_large_clouds.xml'),  # before Fast DDS 3
    'CYCLONEDDS_URI': f'file://{CONFIG / "cyclonedds_large_clouds.xml"}',
}
ARGUMENTS = [
    DeclareLaunchArgument(
        'input_topic',
        default_value='points',
        description='Topic of the sensor, clouds or scans; its /cleaned and /outliers follow. '
        'Several, with commas between: one process serves them all.',
    ),
    DeclareLaunchArgument(
        'sensor',
        default_value='',
        description='Name of a parameter file in config/, such as ouster or autoware. '
        'Several, with commas between: one for each namespace.',
    ),
    DeclareLaunchArgument(
        'params_file',
        default_value='',
        description='ROS parameter file for the filter, which comes before that of the sensor. '
        'Several, with commas between: one for each namespace.',
    ),
    DeclareLaunchArgument('name', default_value=NODE_NAME, description='Name of the node.'),
    DeclareLaunchArgument(
        'namespace',
        default_value='',
        description='Namespace of the node, and of an input_topic without a leading slash. '
        'Several, with commas between: a process in each, and no topic has a leading slash.',
    ),
    DeclareLaunchArgument(
        'input_reliability',
        default_value='',
        choices=['', *RELIABILITIES],
        description='Quality of service of the input; empty: best_effort, for every driver.',
    ),
    DeclareLaunchArgument(
        'input_depth', default_value='', description='Queue of the input, in clouds; empty: 50.'
    ),
    DeclareLaunchArgument(
        'output_reliability',
        default_value='',
        choices=['', *RELIABILITIES],
        description='Quality of service of both outputs; empty: reliable.',
    ),
    DeclareLaunchArgument(
        'output_depth', default_value='', description='Queue of the outputs, in clouds; empty: 10.'
    ),
    DeclareLaunchArgument(
        'use_sim_time',
        default_value='false',
        choices=['true', 'false'],
        description='Take the time from /clock, as when a recording is played with --clock.',
    ),
    DeclareLaunchArgument(
        'large_clouds',
        default_value='true',
        choices=['true', 'false'],
        description='Give the node the settings for large clouds, of Fast DDS and Cyclone DDS, '
        'which the driver needs, too; what FASTRTPS_DEFAULT_PROFILES_FILE or CYCLONEDDS_URI names '
        'already stays.',
    ),
    DeclareLaunchArgument(
        'rviz',
        default_value='false',
        choices=['true', 'false'],
        description='Open RViz, where rviz2 is installed, and set `scores`, by which outliers have '
        'the colour of their detector; of several inputs the first is shown.',
    ),
    DeclareLaunchArgument(
        'fixed_frame',
        default_value='map',
        description='Frame in which RViz shows the clouds: their own where there is no tf.',
    ),
    DeclareLaunchArgument(
        'lifecycle',
        default_value='false',
        choices=['true', 'false'],
        description='Start a managed node, which a manager configures and activates.',
    ),
    DeclareLaunchArgument(
        'page',
        default_value='false',
        choices=['true', 'false'],
        description='Show clouds, diagnostics and sliders on a page for browsers of this machine; '
        'the log of each node names its address, with a token.',
    ),
    DeclareLaunchArgument(
        'page_port',
        default_value='0',
        description='Port of the page on 127.0.0.1; 0: any free one.',
    ),
    DeclareLaunchArgument(
        'respawn',
        default_value='false',
        choices=['true', 'false'],
        description='Start a node that has ended anew; else its end shuts down the whole launch.',
    ),
    DeclareLaunchArgument(
        'log_level',
        default_value='info',
        choices=['debug', 'info', 'warn', 'error', 'fatal'],
        description='Least severe message that the node logs.',
    ),
]


def filter_nodes(context: LaunchContext) -> list[Node]:
    """Make a node for each namespace; only now are the topics known."""
    argument = context.launch_configurations
    topics = [topic.strip() for topic in argument['input_topic'].split(',')]
    namespaces = split_namespaces(argument['namespace'], topics)
    given = [text.strip() for text in argument['sensor'].split(',')]
    sensors = ','.join(str(CONFIG / f'{name}.yaml') if name else '' for name in given)
    files = zip(
        split_files('sensor', sensors, len(namespaces)),
        split_files('params_file', argument['params_file'], len(namespaces)),
        strict=True,
    )
    is_large = argument['large_clouds'] == 'true'
    environment = {k: v for k, v in LARGE_CLOUDS.items() if is_large and k not in os.environ}
    at_end: dict[str, Any] = {'on_exit': end}
    if argument['respawn'] == 'true':
        at_end = {'respawn': True, 'respawn_delay': RESPAWN_DELAY}
    arguments = ['--lifecycle'] if argument['lifecycle'] == 'true' else []
    if argument['page'] == 'true':
        arguments += ['--page', argument['page_port']]
    nodes = []
    for namespace, paths in zip(namespaces, files, strict=True):
        common: dict[str, Any] = {'namespace': namespace, 'additional_env': environment}
        chosen = [some] if (some := parameters(argument, namespace, topics)) else []
        if argument['rviz'] == 'true':
            nodes.append(viewer(topics[0], argument, common))
        nodes.append(
            Node(
                package='lidar_outlier_filter',
                executable='outlier_filter_node',
                name=argument['name'],
                parameters=[*(ParameterFile(path) for path in paths if path), *chosen],
                remappings=remappings(topics[0]) if len(topics) == 1 else [],
                arguments=arguments,
                ros_arguments=['--log-level', argument['log_level']],
                output='screen',
                sigterm_timeout=LaunchConfiguration('sigterm_timeout', default=SIGTERM_TIMEOUT),
                **at_end,
                **common,
            )
        )
    return nodes


def end(event: ProcessExited, context: LaunchContext) -> Shutdown:
    """End the launch with its node; an error alone gives `ros2 launch` a status, 1."""
    ended = f'{event.process_name} has ended with status {event.returncode}'
    if event.returncode and not context.is_shutdown:
        raise ChildProcessError(ended)
    return Shutdown(reason=ended)


def parameters(argument: dict[str, str], namespace: str, topics: list[str]) -> dict[str, object]:
    """Return the parameters that arguments set; they win over those of files."""
    given: dict[str, object] = {'inputs': topics} if len(topics) > 1 else {}
    for name, by in (('use_sim_time', 'use_sim_time'), ('scores', 'rviz')):
        if argument[by] == 'true':
            given[name] = True
    for topic in topics:
        full = expand_topic_name(topic, argument['name'], '/' + namespace.strip('/'))
        for side, kind, names in (
            ('input', 'subscription', [full]),
            ('output', 'publisher', output_topics(full)),
        ):
            for name, (policy, read) in itertools.product(names, POLICIES.items()):
                if value := argument[what := f'{side}_{policy}']:
                    given[f'qos_overrides.{name}.{kind}.{policy}'] = read(what, value)
    return given


def viewer(topic: str, argument: dict[str, str], common: dict[str, Any]) -> Node:
    """Open RViz on the outputs of a topic."""
    return Node(
        package='rviz2',
        executable='rviz2',
        arguments=['-d', str(CONFIG / 'filter.rviz'), '-f', argument['fixed_frame']],
        parameters=[{'use_sim_time': argument['use_sim_time'] == 'true'}],
        remappings=[(f'/{old}', new) for old, new in remappings(topic)],
        **common,
    )


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, then start the nodes with them."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=filter_nodes)])
