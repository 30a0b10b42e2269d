"""Stream of a run for the Rerun viewer: images, matches, exposures, curves and coverage over time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ospc.arrays import Image, size_of
from ospc.errors import FormatError, SettingError, counted, needs_extra, os_error_as
from ospc.photometry.calibration import PROFILE_RADII
from ospc.photometry.correction import Corrector
from ospc.photometry.geometry import pixels_of
from ospc.photometry.vignette import diagonal_profile
from ospc.report.examples import corrected_picture
from ospc.system.throttle import Throttle

if TYPE_CHECKING:
    from ospc.calibrator import OnlineCalibrator
    from ospc.methods.preview import Preview
    from ospc.recording import Frame, Recording

_REFRESH_S, _LARGEST_SHARE = 0.2, 0.2
"""Shortest time between two updates of the estimates, in seconds, and the largest share of the time spent on them."""

_JPEG = 75
_MOST_POINTS = 300
_GREEN, _GREY, _BLUE, _ORANGE = (0, 158, 115), (150, 150, 150), (0, 114, 178), (213, 94, 0)


class RerunStream:
    """Streams to the Rerun viewer; make one with :meth:`opened`.

    Only processed frames have images. The timelines ``frame`` and ``time`` have:

    - ``recorded/image``, ``recorded/matches``: a frame, and the motion of its scene points since an earlier frame;
    - ``corrected/image``: the frame without vignette, at the longest exposure so far, with the current estimate;
    - ``exposure/stated``, ``exposure/from_images``: log₂ of the exposure in milliseconds;
    - ``response``, ``vignette``: the curves, with ±2σ; ``spread/response``, ``spread/vignette``: their σ;
    - ``coverage``: grey level × exposure.
    """

    def __init__(self, rerun: Any, stream: Any) -> None:
        self._rr, self._stream = rerun, stream
        self._throttle = Throttle(_REFRESH_S, _LARGEST_SHARE)
        self._pairs = -1
        self._longest_ms = 0.0

    @classmethod
    @contextmanager
    def opened(cls, recording: Recording, file: Path | None, *, spawn: bool) -> Iterator[RerunStream]:
        """Open a stream to a file, to a newly started viewer, or both, and close it at the end."""
        with needs_extra("streaming to the Rerun viewer", "rerun"):
            import rerun as rr
            import rerun.blueprint as rrb
        stream = rr.RecordingStream("ospc")
        sinks: list[Any] = []
        if file is not None:
            # Rerun would report a file that cannot be written only much later, if ever.
            with os_error_as(FormatError, f"{file}: cannot be written", "name another file"):
                file.parent.mkdir(parents=True, exist_ok=True)
                file.open("ab").close()
            sinks.append(rr.FileSink(str(file)))
        if spawn:
            try:
                rr.spawn(connect=False)
            except RuntimeError as error:
                raise SettingError(
                    f"the Rerun viewer cannot be started ({error}); use --rerun-file FILE.rrd"
                ) from None
            sinks.append(rr.GrpcSink())
        stream.set_sinks(*sinks, default_blueprint=_blueprint(rrb))
        stream.log(
            "recording",
            rr.TextDocument(f"{recording.path}, {recording.kind}, {counted(len(recording), 'frame')}"),
            static=True,
        )
        for place, style in (
            ("exposure/stated", rr.SeriesLines(colors=_GREY, names="stated")),
            ("exposure/from_images", rr.SeriesPoints(colors=_GREEN, names="from the images")),
            ("spread/response", rr.SeriesLines(colors=_BLUE, names="g")),
            ("spread/vignette", rr.SeriesLines(colors=_ORANGE, names="V at the corner")),
        ):
            stream.log(place, style, static=True)
        try:
            yield cls(rr, stream)
        finally:
            stream.flush()
            stream.disconnect()

    def __call__(self, calibrator: OnlineCalibrator, frame: Frame) -> None:
        """Stream a frame and the current estimates."""
        self._stream.set_time("frame", sequence=frame.index)
        self._stream.set_time("time", timestamp=frame.stamp_s)
        self._stream.log("exposure/stated", self._rr.Scalars(np.log2(frame.exposure_ms)))
        pairs = calibrator.status.progress.pairs
        if pairs == self._pairs:
            return  # most frames are not even decoded
        self._pairs = pairs
        self._longest_ms = max(self._longest_ms, frame.exposure_ms)
        self._log_image("recorded/image", frame.image_8_bit)
        if self._throttle.due:
            with self._throttle.timed():
                preview = calibrator.preview()
                if preview is not None:
                    self._log_preview(preview, frame)

    def _log_preview(self, preview: Preview, frame: Frame) -> None:
        rr = self._rr
        self._log_matches(preview, frame)
        counts = np.log1p(preview.coverage.grey_exposure)
        self._log_image("coverage", np.rint(255 * counts / max(float(counts.max()), 1e-12)).astype(np.uint8)[::-1])
        response, vignette, sigma = preview.response, preview.vignette, preview.vignette_sigma
        if response is None or vignette is None or sigma is None:
            return
        grey = np.linspace(0, 1, 129)
        spread = np.zeros_like(grey)
        if response.inverse_sigma is not None:
            spread = np.interp(grey, response.levels, response.inverse_sigma)
            self._stream.log("spread/response", rr.Scalars(float(spread.max())))
        self._stream.log("spread/vignette", rr.Scalars(float(sigma[-1])))
        self._log_curve("response", response.inverse(grey), spread, _BLUE)
        self._log_curve("vignette", diagonal_profile(vignette, PROFILE_RADII), sigma, _ORANGE)
        corrector = Corrector(response, vignette, frame.max_grey)
        self._log_image("corrected/image", corrected_picture(corrector, frame, self._longest_ms))

    def _log_matches(self, preview: Preview, frame: Frame) -> None:
        rr, latest, fit = self._rr, preview.latest, preview.fit
        if latest is None or not len(latest) or latest.frame[1] != frame.index:
            self._stream.log("recorded/matches", rr.Clear(recursive=False))
            return
        moves = pixels_of(latest.position, size_of(frame.image)).reshape(-1, 2, 2)
        step = -(-len(moves) // _MOST_POINTS)
        self._stream.log("recorded/matches", rr.LineStrips2D(moves[::step], colors=_GREEN))
        if fit is not None:
            log_irradiance = fit.log_irradiance(latest)
            log_ratio = np.median(log_irradiance[::2] - log_irradiance[1::2])
            shown_ms = np.exp(latest.log_exposure[0] - log_ratio)
            self._stream.log("exposure/from_images", rr.Scalars(np.log2(shown_ms)))

    def _log_curve(self, name: str, value: Any, sigma: Any, colour: tuple[int, int, int]) -> None:
        across = np.linspace(0, 1, len(value))
        lines = [np.stack([across, 1 - y], axis=1) for y in (value, value - 2 * sigma, value + 2 * sigma)]
        self._stream.log(name, self._rr.LineStrips2D(lines, colors=[colour, _GREY, _GREY]))

    def _log_image(self, name: str, image: Image) -> None:
        picture = self._rr.Image(image, color_model="L")
        self._stream.log(name, picture if image.size < 4096 else picture.compress(jpeg_quality=_JPEG))


def _blueprint(rrb: Any) -> Any:
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial2DView(origin="recorded", name="recorded"),
                rrb.Spatial2DView(origin="corrected", name="corrected"),
            ),
            rrb.Horizontal(
                rrb.Spatial2DView(origin="response", name="response g over grey levels"),
                rrb.Spatial2DView(origin="vignette", name="vignette V from centre to corner"),
                rrb.Spatial2DView(origin="coverage", name="grey level × exposure"),
            ),
            rrb.Horizontal(
                rrb.TimeSeriesView(origin="exposure", name="log₂ of the exposure in ms"),
                rrb.TimeSeriesView(origin="spread", name="standard deviations"),
            ),
            row_shares=[3, 2, 2],
        ),
        collapse_panels=True,
    )
