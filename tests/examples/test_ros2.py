"""The ROS 2 example with stubs of rclpy, and with rclpy itself if it is installed."""

from __future__ import annotations

import ast
import importlib
import inspect
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import ros2_stubs
from ros2_stubs import exposure_message, image_message

from ospc import Calibration, OnlineCalibrator
from ospc.recording import Frame
from ospc.simulation import SimulationSettings, frames

EXAMPLE = Path(__file__).parents[2] / "examples" / "ros2"
SETTINGS = SimulationSettings(size=(160, 120), frames=24, exposure="sweep", exposure_min_ms=3, exposure_max_ms=12)


@pytest.fixture(scope="module")
def filmed() -> list[Frame]:
    return [
        Frame.of_array(f.image, round(f.exposure_ms * 1000) / 1000, index=f.index, stamp_s=round(f.stamp_s, 9))
        for f in frames(SETTINGS)
    ]


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Run the node's main with the driver's messages; return the node and the saved calibration."""

    def run(send, **parameters):
        nodes = []

        def spin(node, future):
            nodes.append(node)
            send({topic: take for topic, (_, take) in node.takers.items()})
            node.live.wait()
            for timer in node.timers:
                timer()
            if not future.done():
                raise KeyboardInterrupt

        ros2_stubs.install(monkeypatch, spin)
        monkeypatch.syspath_prepend(EXAMPLE)
        monkeypatch.setattr(ros2_stubs.Node, "parameters", {"out": str(tmp_path / "saved.json"), **parameters})
        for name in ("ospc_live", "ospc_live.node"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        importlib.import_module("ospc_live.node").main()
        saved = tmp_path / "saved.json"
        return nodes[0], Calibration.load(saved) if saved.exists() else None

    return run


def test_it_saves_what_the_same_frames_give_and_publishes_advice(run, filmed):
    def send(topics):
        for frame in filmed:
            topics["exposure"](exposure_message(frame))
            topics["image"](image_message(frame))

    node, saved = run(send)
    directly = OnlineCalibrator()
    for frame in filmed:
        directly.push(frame)
    expected = directly.calibration()
    np.testing.assert_allclose(saved.response.inverse_table, expected.response.inverse_table, rtol=1e-9)
    np.testing.assert_allclose(saved.vignette.image(), expected.vignette.image(), rtol=1e-9)
    assert saved.counts["frames"] == len(filmed)
    assert node.published == [node.live.status.advice]
    assert not node.warnings


def test_unreadable_messages_are_warned_of_and_do_not_end_it(run, filmed, capsys):
    def send(topics):
        topics["image"](image_message(filmed[0], "32FC1"))
        topics["exposure"](exposure_message(Frame.of_array(filmed[0].image, 0.0)))

    node, saved = run(send)
    assert len(node.warnings) == 2
    assert saved is None
    assert "no frame" in capsys.readouterr().out


def test_the_launch_file_starts_the_node_with_its_parameters(monkeypatch):
    ros2_stubs.install(monkeypatch)
    scope = {}
    exec((EXAMPLE / "launch" / "live.launch.py").read_text("utf-8"), scope)
    *declared, node = scope["generate_launch_description"]().positional[0]
    names = {argument.positional[0] for argument in declared}
    source = (EXAMPLE / "ospc_live" / "node.py").read_text("utf-8")
    assert names == {"image", "exposure", *node.named["parameters"][0]}
    assert all(f'"{name}"' in source for name in names)
    assert [name for name, _ in node.named["remappings"]] == ["image", "exposure"]
    assert (node.named["package"], node.named["executable"]) == ("ospc_live", "live")


def test_the_package_installs_what_it_says(monkeypatch):
    said = ElementTree.parse(EXAMPLE / "package.xml").getroot()
    call = next(n for n in ast.walk(ast.parse((EXAMPLE / "setup.py").read_text())) if isinstance(n, ast.Call))
    done = {keyword.arg: ast.literal_eval(keyword.value) for keyword in call.keywords}
    assert said.find("name").text == done["name"] == "ospc_live"
    assert said.find("version").text == done["version"]
    assert all((EXAMPLE / file).is_file() for _, files in done["data_files"] for file in files)
    assert done["entry_points"] == {"console_scripts": ["live = ospc_live.node:main"]}
    depends = {element.text for element in said.findall("exec_depend")}
    assert depends == {"rclpy", "sensor_msgs", "std_msgs", "launch_ros"}


def test_rclpy_takes_what_its_stub_takes():
    pytest.importorskip("rclpy", reason="ROS 2 is not installed here")
    for module, stub in (("rclpy.node", ros2_stubs.Node), ("rclpy.task", ros2_stubs.Future)):
        real = getattr(importlib.import_module(module), stub.__name__)
        for name, method in inspect.getmembers(stub, inspect.isfunction):
            taken = list(inspect.signature(getattr(real, name)).parameters)
            assert len(taken) >= len(inspect.signature(method).parameters) or name == "__init__"


def test_messages_of_rclpy_are_read(filmed):
    messages = pytest.importorskip("sensor_msgs.msg", reason="ROS 2 is not installed here")
    from ospc.recording.live.ros import RosFrames

    made = image_message(filmed[0])
    message = messages.Image(height=made.height, width=made.width, encoding="mono8", step=made.step)
    message.data = made.data.tobytes()
    message.header.stamp.sec = 7
    exposure = exposure_message(Frame.of_array(filmed[0].image, 2.0, stamp_s=7.0))
    pair = RosFrames("flir_camera_msgs/msg/ImageMetaData")
    assert pair.image(message) is None
    assert np.array_equal(pair.exposure(exposure).image, filmed[0].image)
