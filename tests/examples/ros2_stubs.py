"""Stubs of rclpy and launch for the example, and messages created from their real definitions."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

_STORE = get_typestore(Stores.ROS2_HUMBLE)
_STORE.register(
    get_types_from_msg(
        "std_msgs/Header header\nuint64 camera_time\nint16 brightness\nuint32 exposure_time\n"
        "uint32 max_exposure_time\nfloat32 gain\n",
        "flir_camera_msgs/msg/ImageMetaData",
    )
)
TYPES = _STORE.types


def header(frame: Any) -> Any:
    nanoseconds = round(frame.stamp_s * 1e9)
    stamp = TYPES["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp, "camera")


def image_message(frame: Any, encoding: str = "mono8") -> Any:
    height, width = frame.image.shape[:2]
    data = np.frombuffer(frame.image.tobytes(), np.uint8)
    return TYPES["sensor_msgs/msg/Image"](header(frame), height, width, encoding, 0, len(data) // height, data)


def exposure_message(frame: Any, gain_db: float = 0.0) -> Any:
    microseconds = round(frame.exposure_ms * 1000 / 10 ** (gain_db / 20))
    return TYPES["flir_camera_msgs/msg/ImageMetaData"](header(frame), 0, -1, microseconds, 0, gain_db)


class Node:
    """Stands in for rclpy.node.Node; tests can inspect its topics, timers and parameters."""

    parameters: ClassVar[dict[str, Any]] = {}

    def __init__(self, name: str) -> None:
        self.name, self.takers, self.published, self.timers, self.warnings = name, {}, [], [], []

    def declare_parameter(self, name: str, value: Any) -> Any:
        return SimpleNamespace(value=self.parameters.get(name, value))

    def create_publisher(self, kind: type, topic: str, qos: int) -> Any:
        return SimpleNamespace(publish=self.published.append)

    def create_subscription(self, kind: type, topic: str, callback: Any, qos: Any) -> None:
        self.takers[topic] = (kind, callback)

    def create_timer(self, period_s: float, callback: Any) -> None:
        self.timers.append(callback)

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=lambda text, throttle_duration_sec: self.warnings.append(text))

    def destroy_node(self) -> None:
        pass


class Future:
    def __init__(self) -> None:
        self._result = None

    def done(self) -> bool:
        return self._result is not None

    def set_result(self, result: Any) -> None:
        self._result = result


class Played:
    """Stands in for launch's classes and stores its arguments."""

    def __init__(self, *positional: Any, **named: Any) -> None:
        self.positional, self.named = positional, named


def modules(spin: Any) -> dict[str, ModuleType]:
    """Return the stub modules by import name; ``spin`` sends the messages to a node."""
    contents = {
        "rclpy": {
            "init": lambda: None,
            "try_shutdown": lambda: None,
            "spin_until_future_complete": spin,
        },
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": object()},
        "rclpy.task": {"Future": Future},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Image": TYPES["sensor_msgs/msg/Image"]},
        "std_msgs": {},
        "std_msgs.msg": {"String": lambda data: data},
        "flir_camera_msgs": {},
        "flir_camera_msgs.msg": {"ImageMetaData": TYPES["flir_camera_msgs/msg/ImageMetaData"]},
        "launch": {"LaunchDescription": Played},
        "launch.actions": {"DeclareLaunchArgument": Played},
        "launch.substitutions": {"LaunchConfiguration": Played},
        "launch_ros": {},
        "launch_ros.actions": {"Node": Played},
    }
    found = {}
    for name, content in contents.items():
        found[name] = ModuleType(name)
        vars(found[name]).update(content)
    return found


def install(monkeypatch: Any, spin: Any = None) -> None:
    """Make the stubs importable during a test."""
    for name, module in modules(spin).items():
        monkeypatch.setitem(sys.modules, name, module)
