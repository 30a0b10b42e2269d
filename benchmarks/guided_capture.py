"""Measure whether following the instructions of ``ospc live`` ends a capture sooner than undirected motion.

In simulated rooms, one camera is held by a person who follows the instructions, and another moves like a hand-held
camera. Both have the same exposure control and turn at similar speeds. The program measures the time until response
and vignette reach the goal, by the stated uncertainty and by the truth.

    python benchmarks/guided_capture.py --rooms 10
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from ospc import Calibration, Frame, OnlineCalibrator, Response
from ospc.arrays import Float32Array, FloatArray
from ospc.evaluation.metrics import response_shape_rmse
from ospc.live.advice import Adviser, Instruction
from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.vignette import diagonal_profile
from ospc.settings.live import GOAL
from ospc.simulation import SimulationSettings, truth
from ospc.simulation.camera import Sensor
from ospc.simulation.motion import Motion, rotation
from ospc.simulation.rendering import View, radiance
from ospc.simulation.scene import Scene

RESPONSES = ("srgb", "gamma2.2", "linear", "filmic")
FPS = 20.0
ESTIMATE_S, CHECK_S = 0.5, 2.0
"""Seconds between full estimates: when the preview reaches the goal, and otherwise, for comparison with the truth."""

ADVICE_S, REACTION_S = 0.5, 0.7
"""Seconds between updates of the adviser, and until a person follows a new instruction."""

TURN_DEG_S, SETTLE_S = 30.0, 0.3
"""Turning speed of a person, and its time constant. Hand-held motion also turns by 30 degrees/s on average."""

SWEEP_DEG, SWEEP_S = 16.0, 2.5
"""Angle and duration of a person's sweep to and fro."""

NEIGHBOUR_DEG = 25.0
"""Largest distance of brighter or darker surroundings, so that the target stays in view."""

DWELL_S, SEEN = 5.0, 0.3
"""Time after which a person looks for another target of the same kind, and the weight of targets already used."""

YAWS, PITCHES = np.radians(np.arange(0, 360, 15)), np.radians([-20, 0, 20])
"""Directions in which a person looks for something bright or dark, without the camera."""

ALMOST_WHITE, ALMOST_BLACK = (0.75, 0.97), (0.02, 0.2)
"""Grey levels that a person considers almost white and almost black."""

_EYE, _BLOCK, _EVEN = (64, 48), 4, 0.1
"""Size of a person's view and of its blocks in pixels, and largest relative standard deviation of the radiance of an
even block."""


def turned(yaw: float, pitch: float) -> FloatArray:
    """Return the camera-to-world rotation without roll, shape (3, 3)."""
    return np.asarray(rotation(*np.array([[yaw], [pitch], [0.0]]))[0])


def settled(look: Float32Array, response: Response, mean: float) -> tuple[float, float, float]:
    """Return the settled exposure of a view, and the shares of even blocks that are almost white and almost black."""
    exposures = np.geomspace(1e-3, 1e3, 61) / look.mean()
    exposure = float(np.interp(mean, [response(np.clip(look * e, 0, 1)).mean() for e in exposures], exposures))
    rows, columns = look.shape[0] // _BLOCK, look.shape[1] // _BLOCK
    blocks = look.reshape(rows, _BLOCK, columns, _BLOCK)
    means, spreads = blocks.mean(axis=(1, 3)), blocks.std(axis=(1, 3))
    even = response(np.clip(means[spreads < _EVEN * means] * exposure, 0, 1))
    white, black = (np.sum((even > low) & (even < high)) for low, high in (ALMOST_WHITE, ALMOST_BLACK))
    return exposure, float(white) / means.size, float(black) / means.size


class Camera:
    """A camera in a room, with auto exposure that meters the last image."""

    def __init__(self, settings: SimulationSettings) -> None:
        self._settings = settings
        self.truth = truth(settings)
        self.scene = Scene.of(settings)
        self._sensor = Sensor(self.truth.response, settings)
        self._attenuation = self.truth.vignette.image()
        self._log_e = np.log(settings.reference_exposure_ms)
        self._index = 0

    def shoot(self, position_m: FloatArray, turn: FloatArray) -> Frame:
        s = self._settings
        time_s = self._index / FPS
        light = radiance(self.scene, View(s.size, s.focal_px, position_m, turn), time_s) * self._attenuation
        exposure_ms = float(np.exp(self._log_e))
        image = self._sensor.expose(light * np.float32(exposure_ms), frame=self._index)
        frame = Frame.of_array(image, exposure_ms, index=self._index, stamp_s=time_s)
        wanted = s.auto_gain * np.log(s.auto_target / max(float(image.mean()) / 255, 1e-3))
        low, high = np.log([s.exposure_min_ms, s.exposure_max_ms])
        self._log_e = np.clip(self._log_e + np.clip(wanted, -s.auto_rate, s.auto_rate), low, high)
        self._index += 1
        return frame


class Person:
    """A person who follows instructions."""

    def __init__(self, scene: Scene, settings: SimulationSettings, response: Response) -> None:
        poses = Motion.of(settings)
        self._place: Callable[[float], FloatArray] = lambda time_s: poses.at(time_s * 0.3)[0][0]
        self._focal = settings.focal_px / settings.size[0], settings.focal_px / settings.size[1]
        self._gaze = np.array([0.0, 0.0])
        self._speed = np.zeros(2)
        self._instruction: Instruction | None = None
        self._since_s = 0.0
        self._views = [(yaw, pitch) for yaw in YAWS for pitch in PITCHES]
        looks = [
            radiance(scene, View(_EYE, _EYE[0] * self._focal[0], self._place(0.0), turned(*view)), 0.0)
            for view in self._views
        ]
        exposures, white, black = np.array([settled(look, response, settings.auto_target) for look in looks]).T
        self._log_e = np.log(np.clip(exposures, settings.exposure_min_ms, settings.exposure_max_ms))
        self._worth = {"bright": white, "dark": black}
        self._ends = (self._gaze, self._gaze)

    def pose(self, time_s: float, instruction: Instruction) -> tuple[FloatArray, FloatArray]:
        """Return position and rotation of the camera one frame later."""
        known, for_s = self._instruction, time_s - self._since_s
        is_new = known is None or (known.kind, known.arrow) != (instruction.kind, instruction.arrow)
        if known is None or (is_new and for_s > REACTION_S) or for_s > DWELL_S:
            self._instruction, self._since_s = instruction, time_s
            self._aim(instruction)
        limit = np.radians(TURN_DEG_S) * (0.4 if self._instruction and self._instruction.kind == "slower" else 1.0)
        away = self._target(time_s) - self._gaze
        away[0] = _wrapped(away[0])
        wanted = away / SETTLE_S
        wanted *= min(1.0, limit / max(float(np.hypot(*wanted)), 1e-9))
        self._speed += (wanted - self._speed) * min(1.0, 1 / (FPS * SETTLE_S))
        self._gaze = self._gaze + self._speed / FPS
        return self._place(time_s), turned(*self._gaze)

    def _aim(self, instruction: Instruction) -> None:
        """Choose the two directions to turn between."""
        kind = instruction.kind
        if instruction.arrow is not None:
            (x0, y0), (x1, y1) = instruction.arrow
            turn = np.array([-(x1 - x0) / self._focal[0], (y1 - y0) / self._focal[1]])
            self._ends = self._gaze, self._gaze - turn
        elif kind in self._worth:
            distance = np.array([_apart(view, self._gaze) for view in self._views])
            first = int(np.argmax(np.log(self._worth[kind] + 1e-3) - 0.5 * distance))
            self._worth[kind][[_apart(v, self._views[first]) < np.radians(20) for v in self._views]] *= SEEN
            near = [i for i, v in enumerate(self._views) if _apart(v, self._views[first]) < np.radians(NEIGHBOUR_DEG)]
            sign = 1 if kind == "bright" else -1
            second = min(near, key=lambda i: sign * self._log_e[i])
            self._ends = np.array(self._views[first]), np.array(self._views[second])
        elif kind == "vary":
            self._ends = self._most_unlike()
        else:
            self._ends = self._gaze, self._gaze + np.radians([SWEEP_DEG, 0.5 * SWEEP_DEG])

    def _most_unlike(self) -> tuple[FloatArray, FloatArray]:
        """Return two nearby directions of very different brightness."""
        best, ends = -np.inf, (self._gaze, self._gaze)
        for i, one in enumerate(self._views):
            for j, other in enumerate(self._views):
                if _apart(one, other) < np.radians(2 * NEIGHBOUR_DEG):
                    unlike = min(self._log_e[j] - self._log_e[i], np.log(3))
                    if unlike - 0.5 * _apart(one, self._gaze) > best:
                        best, ends = unlike - 0.5 * _apart(one, self._gaze), (np.array(one), np.array(other))
        return ends

    def _target(self, time_s: float) -> FloatArray:
        phase = np.pi * (time_s - self._since_s) / SWEEP_S
        wobble = np.radians(0.3 * SWEEP_DEG) * np.array([np.sin(1.7 * phase), np.sin(2.9 * phase)])
        away = self._ends[1] - self._ends[0]
        away[0] = _wrapped(away[0])
        return np.asarray(self._ends[0] + away * (1 - np.cos(phase)) / 2 + wobble)


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def _apart(one: FloatArray | tuple[float, float], other: FloatArray | tuple[float, float]) -> float:
    return float(np.hypot(_wrapped(one[0] - other[0]), one[1] - other[1]))


def errors(known: Calibration, camera: Camera) -> tuple[float, float]:
    if known.response is None or known.vignette is None:
        return np.inf, np.inf
    response = response_shape_rmse(known.response, camera.truth.response, 0, 255)
    profiles = [diagonal_profile(v, PROFILE_RADII) for v in (known.vignette, camera.truth.vignette)]
    return response, float(np.sqrt(np.mean(np.subtract(*profiles) ** 2)))


def capture(settings: SimulationSettings, longest_s: float, *, directed: bool, verbose: bool) -> dict[str, float]:
    """Film until the goal is reached, and return the time, by the stated uncertainty and by the truth."""
    camera, calibrator, adviser = Camera(settings), OnlineCalibrator(), Adviser()
    person, motion = Person(camera.scene, settings, camera.truth.response), Motion.of(settings)
    instruction, said = adviser.instruction, ""
    found = {"stated": np.inf, "true": np.inf, "response": np.inf, "vignette": np.inf}
    estimated_s, known = 0.0, None
    for number in range(int(longest_s * FPS)):
        time_s = number / FPS
        if directed:
            position_m, turn = person.pose(time_s, instruction)
        else:
            position_m, turn = (each[0] for each in motion.at(time_s))
        calibrator.push(camera.shoot(position_m, turn))
        if number % int(ADVICE_S * FPS) == 0:
            instruction = adviser.look(calibrator.preview(), time_s, known)
            if verbose and instruction.kind != said:
                said = instruction.kind
                print(f"    {time_s:5.1f} s {said:8} response ±{instruction.response_sigma}")
        if time_s >= estimated_s + (ESTIMATE_S if adviser.expects_end else CHECK_S):
            estimated_s = time_s
            known = calibrator.calibration()
            response, vignette = errors(known, camera)
            found["true"] = np.inf if max(response, vignette) > GOAL else min(found["true"], time_s)
            if adviser.look(calibrator.preview(), time_s, known).kind == "done":
                found |= {"stated": time_s, "response": response, "vignette": vignette}
                break
    if verbose:
        print(f"    {'directed' if directed else 'undirected'}: {found}")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="seed of the first room")
    parser.add_argument("--longest", type=float, default=60.0, help="longest capture in seconds")
    parser.add_argument("-v", "--verbose", action="store_true")
    arguments = parser.parse_args()
    rows = []
    for seed in range(arguments.first, arguments.first + arguments.rooms):
        settings = SimulationSettings(size=(320, 240), fps=FPS, seed=seed, response=RESPONSES[seed % len(RESPONSES)])
        both = [
            capture(settings, arguments.longest, directed=directed, verbose=arguments.verbose)
            for directed in (True, False)
        ]
        rows.append(both)
        shown = "; ".join(f"{what} {both[0][what]:5.1f} s and {both[1][what]:5.1f} s" for what in ("stated", "true"))
        print(f"room {seed:2} {settings.response!s:9} directed and undirected: {shown}", flush=True)
    for what in ("stated", "true"):
        directed, undirected = (np.median([row[i][what] for row in rows]) for i in (0, 1))
        sooner, later = (sum(sign * row[0][what] < sign * row[1][what] for row in rows) for sign in (1, -1))
        print(f"median time until ±{GOAL:g} ({what}): directed {directed:.1f} s, undirected {undirected:.1f} s")
        print(f"  sooner in {sooner}, later in {later} of {len(rows)} rooms")


if __name__ == "__main__":
    main()
