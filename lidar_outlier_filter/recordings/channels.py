# SPDX-FileCopyrightText: 2026 The lidar_outlier_filter authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a recording, from its connections, and the conversion of messages to CDR."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, cast

from rosbags.convert.converter import is_same_wireformat
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag1,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.interfaces.typing import Typesdict
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from lidar_outlier_filter.errors import RecordingError

_FOREVER = QosTime(9223372036, 854775807)
# The ROS 2 profile of a latched ROS 1 topic: late subscribers still receive the last message.
LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    _FOREVER,
    _FOREVER,
    QosLiveliness.AUTOMATIC,
    _FOREVER,
    avoid_ros_namespace_conventions=False,
)
# Types that ROS 2 has under another name.
_RENAMED = {'tf/msg/tfMessage': 'tf2_msgs/msg/TFMessage'}
_SEPARATOR = '=' * 80 + '\n'


@dataclass(frozen=True, eq=False)  # looked up for every message: by identity, which is fast
class Topic:
    """One topic of a recording, without its messages.

    ``definition`` is the text of the message type with all it contains, ``digest`` its RIHS01
    hash; both are empty where they are unknown. ``qos`` holds the offered profiles.
    """

    name: str
    msgtype: str
    definition: str
    digest: str
    qos: tuple[Qos, ...] = ()


_FORMATS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL,
    '': MessageDefinitionFormat.NONE,
}
TYPES = 256  # whose hashes are kept
Channels = dict[int, 'tuple[Topic, Callable[[bytes], bytes]]']


def ros2_channels(connections: Sequence[Connection]) -> Channels:
    """Return the topic of each connection, and the conversion to CDR, which changes nothing."""
    groups: dict[tuple[str, str], list[Connection]] = {}
    for connection in connections:
        groups.setdefault((connection.topic, connection.msgtype), []).append(connection)
    channels: Channels = {}
    for (name, msgtype), group in groups.items():
        extensions = [cast('ConnectionExtRosbag2', connection.ext) for connection in group]
        if other := {extension.serialization_format for extension in extensions} - {'cdr'}:
            raise RecordingError(f'the encoding of {name}', "'cdr'", repr(other.pop()))
        qos = dict.fromkeys(
            profile for extension in extensions for profile in extension.offered_qos_profiles
        )
        topic = Topic(name, msgtype, *_ros2_definition(group[0]), tuple(qos))
        channels.update({connection.id: (topic, bytes) for connection in group})
    return channels


def topic_of(  # noqa: PLR0913  the columns of a database
    name: str,
    msgtype: str,
    definition: tuple[str, str],
    encoding: str,
    qos: str,
    digest: str = '',
) -> Topic:
    """Describe a topic of ROS 2; on damaged bytes the decoders may raise any error."""
    owner: Any = None
    kind = MessageDefinition(_FORMATS[definition[0]], definition[1])
    extension = ConnectionExtRosbag2(encoding, parse_qos(qos) if qos else [])
    connection = Connection(0, name, msgtype, kind, digest, 0, extension, owner)
    return ros2_channels([connection])[0][0]


def _ros2_definition(connection: Connection) -> tuple[str, str]:
    """Return definition and hash of the type of a ROS 2 connection, as far as they are known."""
    kind, text = connection.msgdef
    if kind == MessageDefinitionFormat.NONE:
        return unchanged_definition(connection.msgtype)
    return text, connection.digest or _digest(kind, text, connection.msgtype)


@lru_cache(TYPES)
def _digest(kind: MessageDefinitionFormat, text: str, msgtype: str) -> str:
    """Compute a type hash missing in the file; empty if the definition cannot be parsed.

    The recordings of an archive share their types, and parsing one takes 10 ms.
    """
    try:
        if kind == MessageDefinitionFormat.MSG:
            types = get_types_from_msg(text, msgtype)
        else:
            types = {}
            for part in text.split(_SEPARATOR)[1:]:
                types.update(get_types_from_idl(part.partition('\n')[2]))
        return _typestore(types).hash_rihs01(msgtype)
    except Exception:  # noqa: BLE001  a type that cannot be parsed is copied all the same
        return ''


def unchanged_definition(msgtype: str) -> tuple[str, str]:
    """Return definition and hash of a type that never changed, for bags older than Iron."""
    stores = [
        known_types(name) for name in (Stores.ROS2_FOXY, Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY)
    ]
    stores = [store for store in stores if msgtype in store.fielddefs]
    digests = {store.hash_rihs01(msgtype) for store in stores}
    if len(digests) != 1:
        return '', ''
    return stores[-1].generate_msgdef(msgtype, ros_version=2)[0], digests.pop()


def ros1_channels(connections: Sequence[Connection]) -> Channels:
    """Return the topic of each connection, and the conversion of its messages to CDR."""
    jazzy = known_types()
    types: dict[str, tuple[str, Typestore]] = {}
    topics: dict[tuple[str, str], Topic] = {}
    latched = {c.topic for c in connections if cast('ConnectionExtRosbag1', c.ext).latching}
    channels: Channels = {}
    for connection in connections:
        name, msgtype = connection.topic, connection.msgtype
        if msgtype not in types:
            types[msgtype] = (connection.digest, _ros1_types(connection, jazzy))
        digest, store = types[msgtype]
        if digest != connection.digest:
            got = f'{digest} and {connection.digest}'
            raise RecordingError(f'the definition of {msgtype}', 'the same on all topics', got)
        definition = _ros1_definition(msgtype, store, jazzy)
        topic = Topic(name, *definition, (LATCHED,) if name in latched else ())
        topic = topics.setdefault((name, topic.msgtype), topic)
        channels[connection.id] = (topic, _ros1_converter(store, msgtype))
    return channels


def _ros1_definition(msgtype: str, store: Typestore, jazzy: Typestore) -> tuple[str, str, str]:
    """Return name, definition and hash that a ROS 1 type has in ROS 2."""
    name = _RENAMED.get(msgtype, msgtype)
    # Where the bytes are the same: the definition of ROS 2, with the names it gave the fields.
    if name in jazzy.fielddefs and is_same_wireformat(store, jazzy, msgtype, name):
        store = jazzy
    else:
        name = msgtype
    return name, store.generate_msgdef(name, ros_version=2)[0], store.hash_rihs01(name)


def _ros1_types(connection: Connection, jazzy: Typestore) -> Typestore:
    """Read the type of a ROS 1 connection, with the header of ROS 2, which has no number in it."""
    types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
    types['std_msgs/msg/Header'] = jazzy.fielddefs['std_msgs/msg/Header']
    return _typestore(types)


def _ros1_converter(store: Typestore, msgtype: str) -> Callable[[bytes], bytes]:
    return lambda data: bytes(store.ros1_to_cdr(data, msgtype))


def _typestore(types: Typesdict) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store


@cache
def known_types(name: Stores = Stores.ROS2_JAZZY) -> Typestore:
    """Return the message types of a distribution, with the code generated for them so far.

    No type is added: they are shared by all recordings.
    """
    return get_typestore(name)
