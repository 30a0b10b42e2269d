"""Frames from any iterable and from live cameras."""

from __future__ import annotations

import ctypes
import gc
import sys
import time
import weakref
from collections.abc import Iterator
from datetime import timedelta
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from image_samples import grey

from ospc.calibrator import calibrate
from ospc.errors import ExposureError, FrameError, MissingExtraError, RecordingError, SettingError
from ospc.recording import ArrayRecording, open_recording
from ospc.recording.live import open_camera
from ospc.recording.live.drivers import DepthAiCamera, OpenCvCamera, RealSenseCamera
from ospc.recording.options import ReadingOptions
from ospc.recording.stream import frames_of
from ospc.simulation import SimulationSettings, frames

SIZE = (64, 48)


def test_frames_and_tuples_are_taken_as_they_come() -> None:
    images = [grey(i, SIZE) for i in range(3)]
    made = [*ArrayRecording(images[:1], [1.0]), (images[1], 2), (images[2], 4.0, 7.5)]
    found = list(frames_of(made))
    assert [frame.index for frame in found] == [0, 1, 2]
    assert [frame.exposure_ms for frame in found] == [1, 2, 4]
    assert [frame.stamp_s for frame in found] == [0, 1, 7.5]
    np.testing.assert_array_equal([frame.image for frame in found], images)


def test_the_remedies_fit_the_mistakes() -> None:
    with pytest.raises(FrameError, match="item 0: grey values must be uint8 or uint16, not float64"):
        next(frames_of([(grey() / 255, 1.0)]))
    with pytest.raises(FrameError, match=r"item 0: has more than 8 bits; .* max_grey=4095\)$"):
        next(frames_of([(grey().astype(np.uint16), 1.0)]))


@pytest.mark.parametrize(
    ("item", "error"),
    [
        (5, FrameError),
        ((grey(),), FrameError),
        ((grey(), "long"), ExposureError),
        ((grey(), 0.0), ExposureError),
        ((grey(), float("inf")), ExposureError),
        ((np.zeros((2, 2, 3), np.uint8), 1.0), FrameError),
        ((grey().astype(np.uint16), 1.0), FrameError),
        ((grey().astype(float), 1.0), FrameError),
    ],
)
def test_an_invalid_frame_is_named_by_its_number(item: Any, error: type[Exception]) -> None:
    found = frames_of([(grey(), 1.0), item])
    next(found)
    with pytest.raises(error, match=r"(item|frame) 1"):
        next(found)


def test_nothing_is_kept() -> None:
    made: list[weakref.ref[Any]] = []

    def endless() -> Iterator[tuple[Any, float]]:
        while True:
            image = np.zeros((48, 64), np.uint8)
            made.append(weakref.ref(image))
            yield image, 1.0

    for frame in frames_of(endless()):
        if frame.index == 100:
            break
    assert sum(image() is not None for image in made) == 1


def test_a_generator_gives_the_calibration_of_the_recording() -> None:
    settings = SimulationSettings(size=(160, 120), frames=12, exposure="cycle", exposures_ms=(3.0, 6.0, 12.0, 24.0))
    made = list(frames(settings))
    recording = ArrayRecording([f.image for f in made], [f.exposure_ms for f in made])
    found, expected = calibrate((f.image, f.exposure_ms) for f in made), calibrate(recording)
    assert found.response is not None
    assert expected.response is not None
    np.testing.assert_array_equal(found.response.inverse_table, expected.response.inverse_table)
    assert found.source["kind"] == "stream"


class Capture:
    """Behaves like cv2.VideoCapture with a camera."""

    def __init__(self, driver: str, states: list[tuple[float, float]], channels: int = 3) -> None:
        self.driver, self.states, self.channels = driver, states, channels
        self.at = -1
        self.released = False

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def read(self) -> tuple[bool, Any]:
        self.at += 1
        if self.at == len(self.states):
            return False, None
        image = grey(self.at, SIZE)
        return True, np.stack([image, image // 2, image // 4], axis=2) if self.channels == 3 else image

    def get(self, prop: int, /) -> float:
        return self.states[self.at][{cv2.CAP_PROP_EXPOSURE: 0, cv2.CAP_PROP_GAIN: 1}[prop]]

    def getBackendName(self) -> str:  # noqa: N802
        return self.driver

    def release(self) -> None:
        self.released = True


def opencv_camera(capture: Any, **stated: str) -> OpenCvCamera:
    return OpenCvCamera(capture, "camera 0", ReadingOptions.of(stated))


class TestOpenCv:
    def test_units_are_those_of_the_driver(self) -> None:
        states = [(10.0, 3.0), (20.0, 3.0)]
        with opencv_camera(capture := Capture("V4L2", states), channel="green") as camera:
            found = list(camera)
        assert [frame.exposure_ms for frame in found] == pytest.approx([1, 2])
        np.testing.assert_array_equal(found[1].image, grey(1, SIZE) // 2)
        assert found[1].stamp_s > found[0].stamp_s
        assert capture.released
        assert "100us" in camera.notes[0]
        camera = opencv_camera(Capture("DSHOW", [(-6.0, 0), (-7.0, 0)], channels=1))
        assert [frame.exposure_ms for frame in camera] == pytest.approx([1000 / 64, 1000 / 128])

    def test_values_missing_from_the_driver_have_to_be_given(self) -> None:
        capture = Capture("GSTREAMER", [(2.0, 6.0205999)])
        with pytest.raises(SettingError, match="unknown for the driver GSTREAMER"):
            opencv_camera(capture)
        assert capture.released
        camera = opencv_camera(capture, exposure_unit="ms", gain_unit="db")
        assert next(iter(camera)).exposure_ms == pytest.approx(4)

    def test_a_gain_of_unknown_unit_must_not_change(self) -> None:
        found = iter(opencv_camera(Capture("V4L2", [(10.0, 3.0), (10.0, 4.0)])))
        next(found)
        with pytest.raises(ExposureError, match="gain changed from 3 to 4"):
            next(found)

    @pytest.mark.parametrize("exposure", [0.0, float("nan"), -1.0])
    def test_a_driver_without_exposures_is_reported(self, exposure: float) -> None:
        with pytest.raises(ExposureError, match=r"camera 0: the driver's exposure .* is not a positive"):
            next(iter(opencv_camera(Capture("V4L2", [(exposure, 0.0)]))))

    def test_opencvs_own_capture_fits(self, tmp_path: Path) -> None:
        path = str(tmp_path / "a.avi")
        writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"MJPG"), 10.0, SIZE)
        writer.write(np.full((*SIZE[::-1], 3), 90, np.uint8))
        writer.release()
        camera = opencv_camera(cv2.VideoCapture(path), exposure_unit="ms")
        with pytest.raises(ExposureError, match=r"camera 0: the driver's exposure .* is not a positive"):
            next(iter(camera))
        camera.close()

    def test_no_such_camera(self) -> None:
        with pytest.raises(RecordingError, match="camera 97: cannot be opened"):
            open_camera("opencv:97")


def _realsense() -> Any:
    """Return the vendor's library; it needs libusb, from the package libusb-package if the system has none."""
    found = find_spec("libusb_package")
    for place in (found.submodule_search_locations or []) if found is not None else []:
        for library in Path(place).glob("libusb-1.0.so*"):
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    try:
        import pyrealsense2
    except ModuleNotFoundError:
        pytest.skip("needs the extra 'realsense'")
    except ImportError as error:
        pytest.skip(f"pyrealsense2 cannot be loaded: {error}")
    return pyrealsense2


def software_camera(rs: Any) -> tuple[Any, Any, Any]:
    """Return the vendor's software device, its sensor and the profile of its infrared stream."""
    device = rs.software_device()
    sensor = device.add_sensor("Stereo Module")
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = rs.stream.infrared, 1, 0, rs.format.y8
    stream.width, stream.height, stream.fps, stream.bpp = (*SIZE, 30, 1)
    stream.intrinsics = rs.intrinsics()
    return device, sensor, sensor.add_video_stream(stream)


def send(rs: Any, sensor: Any, profile: Any, frames: int, pause_s: float = 0.0) -> None:
    """Send frames of 3, 6, 12 … ms, each as half its exposure time with a gain of 2."""
    for i in range(frames):
        sensor.set_metadata(rs.frame_metadata_value.actual_exposure, 1500 * 2**i)
        sensor.set_metadata(rs.frame_metadata_value.gain_level, 32)
        made = rs.software_video_frame()
        made.stride, made.bpp, made.pixels = SIZE[0], 1, grey(i, SIZE)
        made.timestamp, made.domain = 1000.0 + 50 * i, rs.timestamp_domain.hardware_clock
        made.frame_number, made.profile = i, profile.as_video_stream_profile()
        sensor.on_video_frame(made)
        time.sleep(pause_s)


class TestRealSense:
    def test_what_the_vendors_recorder_wrote_is_read_live_and_as_a_bag(self, tmp_path: Path) -> None:
        rs = _realsense()
        device, sensor, profile = software_camera(rs)
        path = tmp_path / "walk.db3"
        try:
            recorder = rs.recorder(str(path), device)
        except RuntimeError as error:
            pytest.skip(f"this version records otherwise: {error}")
        recorded = recorder.query_sensors()[0]
        recorded.open(recorded.get_stream_profiles()[0])
        recorded.start(rs.frame_queue(20))
        send(rs, sensor, profile, 4, pause_s=0.05)
        recorded.stop()
        recorded.close()
        # The file is closed once nothing references the recorder.
        del recorded, recorder, sensor, device
        gc.collect()
        with open_camera(f"realsense:{path}") as camera:
            played = list(camera)
        bag = open_recording(path)
        for exposures, images in (
            ([f.exposure_ms for f in played], [f.image for f in played]),
            (bag.exposures_ms, [f.image for f in bag]),
        ):
            assert exposures == pytest.approx([3, 6, 12, 24])
            np.testing.assert_array_equal(images, [grey(i, SIZE) for i in range(4)])
        assert "Actual Exposure in µs" in " ".join(bag.notes)

    def test_frames_of_the_vendors_software_device(self) -> None:
        rs = _realsense()
        _device, sensor, profile = software_camera(rs)
        queue = rs.frame_queue(10, keep_frames=True)
        sensor.open(profile)
        sensor.start(queue)
        send(rs, sensor, profile, 3)
        with RealSenseCamera(lambda: queue.wait_for_frame(200), "software", stop=sensor.stop) as camera:
            coming = iter(camera)
            found = list(islice(coming, 3))
            with pytest.raises(RecordingError, match="stopped delivering frames"):
                next(coming)
        assert [frame.exposure_ms for frame in found] == pytest.approx([3, 6, 12])
        assert [frame.stamp_s for frame in found] == pytest.approx([1, 1.05, 1.1])
        np.testing.assert_array_equal([frame.image for frame in found], [grey(i, SIZE) for i in range(3)])

    def test_frames_as_documented(self, monkeypatch: pytest.MonkeyPatch) -> None:
        keys = SimpleNamespace(actual_exposure="e", gain_level="g")
        monkeypatch.setitem(sys.modules, "pyrealsense2", SimpleNamespace(frame_metadata_value=keys))

        def frame(**said: float) -> Any:
            return SimpleNamespace(
                supports_frame_metadata=lambda key: key in said,
                get_frame_metadata=said.__getitem__,
                get_timestamp=lambda: 2500.0,
                get_data=lambda: np.stack([grey(0, SIZE)] * 3, axis=2),
            )

        waiting = iter([frame(e=8000), frame(e=8000, g=248), frame(g=16)])
        camera = RealSenseCamera(lambda: next(waiting), "made up")
        found = iter(camera)
        first = next(found)
        assert (first.exposure_ms, first.stamp_s) == (8.0, 2.5)
        np.testing.assert_array_equal(first.image, grey(0, SIZE))
        assert next(found).exposure_ms == pytest.approx(8 * 248 / 16)
        with pytest.raises(ExposureError, match="delivers no exposures with its frames"):
            next(found)
        assert list(RealSenseCamera(lambda: None, "ended")) == []

    def test_a_recording_that_is_not_there(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setitem(sys.modules, "pyrealsense2", SimpleNamespace(config=lambda: None))
        with pytest.raises(RecordingError, match="no such file"):
            open_camera(f"realsense:{tmp_path / 'none.bag'}")


class Oak:
    """Behaves like the documented interface of DepthAI 3."""

    def __init__(self, exposures_us: list[int], iso: int) -> None:
        self.waiting = [self.frame(i, us, iso) for i, us in enumerate(exposures_us)]
        self.asked: list[Any] = []
        self.stopped = False

    @staticmethod
    def frame(index: int, us: int, iso: int) -> Any:
        return SimpleNamespace(
            getExposureTime=lambda: timedelta(microseconds=us),
            getSensitivity=lambda: iso,
            getTimestampDevice=lambda: timedelta(seconds=3 + index),
            getCvFrame=lambda: grey(index, SIZE),
        )

    def module(self) -> Any:
        node = SimpleNamespace(
            build=lambda socket: self.asked.append(socket) or node,
            requestOutput=lambda size, kind: self.asked.append((size, kind)) or node,
            createOutputQueue=lambda: SimpleNamespace(get=lambda: self.waiting.pop(0)),
        )
        pipeline = SimpleNamespace(
            create=lambda _kind: node,
            start=lambda: None,
            isRunning=lambda: bool(self.waiting),
            stop=lambda: setattr(self, "stopped", True),
        )
        return SimpleNamespace(
            Pipeline=lambda: pipeline,
            node=SimpleNamespace(Camera="camera"),
            CameraBoardSocket=SimpleNamespace(CAM_A="a", CAM_B="b", CAM_C="c"),
            ImgFrame=SimpleNamespace(Type=SimpleNamespace(GRAY8="grey", BGR888i="colour")),
        )


class TestDepthAi:
    def test_frames_as_documented(self, monkeypatch: pytest.MonkeyPatch) -> None:
        oak = Oak([1500, 3000], iso=200)
        monkeypatch.setitem(sys.modules, "depthai", oak.module())
        with open_camera("depthai:right") as camera:
            found = list(camera)
        assert oak.asked == ["c", ((640, 480), "grey")]
        assert oak.stopped
        assert [frame.exposure_ms for frame in found] == pytest.approx([3, 6])
        assert [frame.stamp_s for frame in found] == [3, 4]
        np.testing.assert_array_equal([frame.image for frame in found], [grey(i, SIZE) for i in range(2)])

    def test_the_vendors_library_has_the_functions_used(self) -> None:
        depthai = pytest.importorskip("depthai", reason="needs the extra 'depthai'")
        used = {
            depthai.Pipeline: ("create", "start", "isRunning", "stop"),
            depthai.node.Camera: ("build", "requestOutput"),
            depthai.Node.Output: ("createOutputQueue",),
            depthai.MessageQueue: ("get",),
            depthai.ImgFrame: ("getExposureTime", "getSensitivity", "getTimestampDevice", "getCvFrame"),
            depthai.ImgFrame.Type: ("GRAY8", "BGR888i"),
            depthai.CameraBoardSocket: ("CAM_A", "CAM_B", "CAM_C"),
        }
        assert [(kind, name) for kind, names in used.items() for name in names if not hasattr(kind, name)] == []

    def test_failures_are_reported(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def fail() -> Any:
            raise RuntimeError("X_LINK_ERROR\nlost")

        with pytest.raises(RecordingError, match=r"stopped delivering frames \(X_LINK_ERROR lost\)"):
            next(iter(DepthAiCamera(fail, "lost")))
        monkeypatch.setitem(
            sys.modules, "depthai", SimpleNamespace(**vars(Oak([], 100).module()) | {"Pipeline": fail})
        )
        with pytest.raises(RecordingError, match="cannot be opened"):
            open_camera("depthai")
        with pytest.raises(RecordingError, match="'up' is not a sensor"):
            open_camera("depthai:up")


@pytest.mark.parametrize(
    ("camera", "module", "extra"), [("realsense", "pyrealsense2", "realsense"), ("depthai", "depthai", "depthai")]
)
def test_without_the_extra_it_is_named(camera: str, module: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"ospc\[{extra}\]"):
        open_camera(camera)


@pytest.mark.parametrize("text", ["", "webcam", "opencv:x", "opencv:-1", "opencv:99999", "/dev/video0"])
def test_what_is_no_camera(text: str) -> None:
    with pytest.raises(SettingError, match=r"nor an existing recording; .* name a camera: opencv:NUMBER"):
        open_camera(text, ReadingOptions())
