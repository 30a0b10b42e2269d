"""The methods that the accuracy benchmark measures: those of a preset, and what they are compared with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ospc.research.accuracy.charts import ChartSource
from ospc.research.accuracy.real_video import VideoSource
from ospc.research.method import Estimate, Method, Outcome
from ospc.research.own_methods import methods_of_preset, quadratic_on_known_pixels
from ospc.research.source import Source
from ospc.settings import as_dict, preset


@dataclass(frozen=True)
class PresetMethods:
    """The methods of a preset.

    Attributes
    ----------
    name
        Name of the preset.
    """

    name: str

    def describe(self) -> dict[str, Any]:
        """Return the settings."""
        return as_dict(preset(self.name))

    def make(self, source: Source) -> dict[str, Method]:
        """Return the methods; "paper" is run with every solver where the vignette can be known."""
        return methods_of_preset(self.name, solvers=source.group == "simulated")

    def references(self, source: Source) -> dict[str, Outcome]:
        """Return what else a real recording has to compare with.

        With "paper", that is its estimator on chart pixels that are known to correspond, since a chart has hardly any
        features; with "default", the laboratory calibration by the makers of the video.
        """
        if self.name == "paper" and isinstance(source, ChartSource):
            height, width = next(source.frames()).image.shape
            return {"paper, pixels known": quadratic_on_known_pixels(source.known_pixels(), (width, height))}
        if self.name == "default" and isinstance(source, VideoSource):
            return {"makers' laboratory": Estimate(source.truth().response)}
        return {}
