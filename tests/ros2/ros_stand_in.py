"""What the node and its launch file use of ROS 2, without ROS: names, signatures and effects of rclpy and launch_ros.

Messages are classes made of their definitions, with those fields and no others.
"""

import sys
import time
from itertools import accumulate
from pathlib import Path
from types import ModuleType, SimpleNamespace

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS2 = Path(__file__).parent.parent.parent / "ros2"
STORE = get_typestore(Stores.ROS2_HUMBLE)
for path in (ROS2 / "deckline_msgs" / "msg").glob("*.msg"):
    STORE.register(get_types_from_msg(path.read_text(), f"deckline_msgs/msg/{path.stem}"))
PACKAGES = {
    "deckline_msgs": ["Guidance"],
    "diagnostic_msgs": ["DiagnosticArray"],
    "geometry_msgs": ["PoseStamped", "PoseWithCovarianceStamped"],
    "nav_msgs": ["Odometry"],
    "sensor_msgs": ["CameraInfo", "CompressedImage", "Image"],
    "tf2_msgs": ["TFMessage"],
    "visualization_msgs": ["ImageMarker", "MarkerArray"],
}
PARAMETER_TYPES = {"PARAMETER_BOOL": bool, "PARAMETER_DOUBLE": float, "PARAMETER_STRING": str}


def message_class(kind):
    """A class with the fields and constants of a type."""
    constants, fields = STORE.fielddefs[kind]
    nested = {name: message_class(of[1]) for name, of in fields if of[0] == Nodetype.NAME}

    def begin(self):
        for name, _ in fields:
            setattr(self, name, nested[name]() if name in nested else None)

    values = {"__slots__": [name for name, _ in fields], "__init__": begin, "kind": kind}
    return type(kind, (), values | {name: value for name, _, value in constants})


def encode(message):
    """The bytes of a filled message; an error for values that do not fit its type."""
    return bytes(STORE.serialize_cdr(_typed(message), message.kind))


def _typed(message):
    values = {name: getattr(message, name) for name in message.__slots__}
    return STORE.types[message.kind](
        **{name: _typed(value) if hasattr(value, "kind") else value for name, value in values.items()}
    )


class Publisher:
    """Sends nothing until it is enabled, as rclpy's lifecycle publisher."""

    def __init__(self, kind, sent):
        self.kind, self.sent, self.enabled = kind, sent, False

    def publish(self, message):
        if self.enabled:
            self.sent.append(message if isinstance(message, bytes) else encode(message))


class LifecycleNode:
    """Parameters, topics and transitions; a test calls what takes messages."""

    stated = {}  # noqa: RUF012 - parameters that a test states

    def __init__(self, name):
        self.name, self.described, self.values = name, {}, {}
        self.taken, self.sent, self.publishers_, self.lines = {}, {}, [], []
        log = lambda line, **_: self.lines.append(line)  # noqa: E731
        self.logger = SimpleNamespace(info=log, warning=log, error=log)

    def declare_parameter(self, name, value, descriptor):
        self.described[name], self.values[name] = descriptor, self.stated.get(name, value)

    def get_parameter(self, name):
        return SimpleNamespace(value=self.values[name])

    def create_subscription(self, kind, topic, take, qos):
        self.taken[topic] = (take, qos)
        return topic

    def destroy_subscription(self, topic):
        del self.taken[topic]

    def create_lifecycle_publisher(self, kind, topic, qos):
        self.publishers_.append(Publisher(kind, self.sent.setdefault(topic, [])))
        return self.publishers_[-1]

    def destroy_lifecycle_publisher(self, publisher):
        self.publishers_.remove(publisher)

    def resolve_topic_name(self, topic):
        return f"/{topic}"

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=time.time_ns()))

    def get_logger(self):
        return self.logger

    def destroy_node(self):
        self.is_destroyed = True

    def _enable(self, on):
        for publisher in self.publishers_:
            publisher.enabled = on
        return "success"

    def on_configure(self, state):
        return "success"

    def on_activate(self, state):
        return self._enable(True)

    def on_deactivate(self, state):
        return self._enable(False)

    on_cleanup = on_shutdown = on_error = on_configure


def install(monkeypatch):
    """Put the stand-in in ROS's place, and the node's package on the path."""
    record = lambda **values: SimpleNamespace(**values)  # noqa: E731
    policies = {name: SimpleNamespace(RELIABLE=name, TRANSIENT_LOCAL=name) for name in ("reliability", "durability")}
    action = lambda *args, **values: SimpleNamespace(args=args, **values)  # noqa: E731
    parts = {
        "rclpy": {"init": lambda: None, "spin": None, "try_shutdown": lambda: None},
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.lifecycle": {
            "LifecycleNode": LifecycleNode,
            "LifecycleState": None,
            "TransitionCallbackReturn": SimpleNamespace(SUCCESS="success", FAILURE="failure"),
        },
        "rclpy.qos": {
            "QoSProfile": record,
            "qos_profile_sensor_data": record(depth=5, reliability="best effort"),
            "ReliabilityPolicy": policies["reliability"],
            "DurabilityPolicy": policies["durability"],
        },
        "rcl_interfaces.msg": {
            "ParameterDescriptor": record,
            "FloatingPointRange": record,
            "ParameterType": SimpleNamespace(**{name: name for name in PARAMETER_TYPES}),
        },
        "launch": {"LaunchDescription": list},
        "launch.actions": dict.fromkeys(("DeclareLaunchArgument", "EmitEvent", "RegisterEventHandler"), action),
        "launch.events": {"matches_action": lambda node: node},
        "launch.substitutions": {"LaunchConfiguration": lambda name: f"${name}"},
        "launch_ros.actions": {"LifecycleNode": action},
        "launch_ros.event_handlers": {"OnStateTransition": action},
        "launch_ros.events.lifecycle": {"ChangeState": action},
        "launch_ros.parameter_descriptions": {"ParameterValue": action},
        "lifecycle_msgs.msg": {"Transition": SimpleNamespace(TRANSITION_CONFIGURE=1, TRANSITION_ACTIVATE=3)},
        **{
            f"{name}.msg": {kind: message_class(f"{name}/msg/{kind}") for kind in kinds}
            for name, kinds in PACKAGES.items()
        },
    }
    parents = {parent: {} for name in parts for parent in accumulate(name.split("."), "{}.{}".format)}
    for name, values in (parents | parts).items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    for name in [name for name in sys.modules if name.startswith("deckline_ros")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(ROS2 / "deckline_ros"))
