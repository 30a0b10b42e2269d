"""Simulated recordings in colour, for systems that read the colours of edges.

The green channel is the grey recording itself. In the others, every surface has another brightness and contrast, so
that neighbours differ in colour, and so do the parts of a texture. All channels share response, vignette and
exposure. Textures are mapped linearly: a pixel that sees two parts of one still has the mean of their colours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ospc.arrays import Float32Array
from ospc.recording.frame import Frame
from ospc.research.source import SimulatedSource
from ospc.simulation.motion import Motion
from ospc.simulation.rendering import radiance
from ospc.simulation.scene import Scene
from ospc.simulation.sensor import Sensor
from ospc.simulation.surface import Face
from ospc.simulation.truth import plan, view_at

_LOG_TINT = 0.5
"""Standard deviation of ln of a surface's brightness in red and blue over that in green."""

_LEAST_CONTRAST = 0.4
"""Least contrast of a texture in red and blue over that in green."""

_CHANNELS = (1, 0, 2)
"""Offsets of the seeds of the noise of blue, green and red: that of green is the grey recording's."""


@dataclass(frozen=True)
class ColourSource(SimulatedSource):
    """A simulated recording whose frames are in colour, shape (height, width, 3), blue, green, red."""

    def describe(self) -> dict[str, Any]:
        """Return the settings."""
        return super().describe() | {"kind": "simulation in colour"}

    def frames(self) -> Iterator[Frame]:
        """Give the frames."""
        scene = Scene.of(self.settings)
        known = plan(self.settings, scene)
        motion, shade = Motion.of(self.settings), known.vignette.image()
        scenes = [tinted(scene, self.settings.seed, channel) for channel in _CHANNELS]
        sensors = [
            Sensor(known.response, replace(self.settings, seed=self.settings.seed + channel)) for channel in _CHANNELS
        ]
        for index, stamp in enumerate(known.stamps_s.tolist()):
            view = view_at(self.settings, motion, stamp)
            light = shade * np.float32(known.exposures_ms[index] * known.light[index])
            gain = float(known.gains[index])
            planes = [
                sensor.expose(radiance(one, view, stamp) * light, frame=index, gain=gain)
                for one, sensor in zip(scenes, sensors, strict=True)
            ]
            image = np.stack(planes, axis=-1)
            grey = Frame.of_array(
                planes[1],
                float(known.metadata_exposures_ms[index]),
                index=index,
                stamp_s=stamp,
                max_grey=self.settings.max_grey,
            )
            yield replace(grey, load=partial(np.asarray, image), colour=True)


def tinted(scene: Scene, seed: int, channel: int) -> Scene:
    """Return a scene as another channel sees it; channel 0 is the scene itself."""
    if channel == 0:
        return scene
    random = np.random.default_rng([seed, 11, channel])

    def coloured(mips: tuple[Float32Array, ...]) -> tuple[Float32Array, ...]:
        tint, contrast = np.exp(_LOG_TINT * random.normal()), random.uniform(_LEAST_CONTRAST, 1)
        mean = mips[-1].mean()
        return tuple((tint * (contrast * level + (1 - contrast) * mean)).astype(np.float32) for level in mips)

    def faces(all_faces: tuple[Face, ...]) -> tuple[Face, ...]:
        return tuple(replace(face, mips=coloured(face.mips)) for face in all_faces)

    return replace(
        scene,
        walls=faces(scene.walls),
        pictures=faces(scene.pictures),
        solids=tuple(replace(solid, faces=faces(solid.faces)) for solid in scene.solids),
        patches=tuple(replace(patch, mips=coloured(patch.mips)) for patch in scene.patches),
    )
