"""The output folder of a calibration: files for programs, a report and a picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ospc.arrays import FloatArray
from ospc.errors import ExposureError, FormatError, OspcError, one_line, os_error_as
from ospc.exposures.used import used_exposures, with_used_exposures, without_gaps
from ospc.formats.dso import PARAMETER_FILES, parameter_files, write_times
from ospc.formats.files import json_object, schema_of, write_bytes, write_text
from ospc.formats.opening import Photometry
from ospc.photometry.calibration import Calibration
from ospc.photometry.vignette import RasterVignette
from ospc.recording import Recording
from ospc.recording.exposure_lists import read_times
from ospc.report.charts import ReportFindings
from ospc.report.examples import NOTHING_TRIED, examples_of
from ospc.report.page import page
from ospc.report.pictures import PICTURE, Drawings, picture_as_png
from ospc.state.container import STATE_NAME
from ospc.system.folders import Content, check_usable

if TYPE_CHECKING:
    from ospc.engine.state import Epoch
    from ospc.live.capture import Capture

Times: TypeAlias = "Recording | Capture"
"""The source of time stamps and exposures of all frames."""
_MAP = "calibration.vignette.npz"
_CALIBRATION = "calibration.json"
_DATA = (_CALIBRATION, _MAP, *PARAMETER_FILES, "times.txt")
REPORT = "report.html"
OWN_NAMES = (*_DATA, PICTURE, REPORT)
"""All files that are ever written to an output folder; no other files in it are touched."""

_PARTIAL = "partial"
"""Folder inside an output folder for a partial result, if a complete one must be kept."""
_EPOCHS = "frames_*-*"
"""Folders inside an output folder for the calibrations of frames before a change of the camera."""


@dataclass(frozen=True)
class Written:
    """The files written, in order, notes on files left out on purpose, and problems with others."""

    files: tuple[Path, ...] = ()
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()

    def __add__(self, other: Written) -> Written:
        """Return the two combined."""
        return Written(self.files + other.files, self.notes + other.notes, self.problems + other.problems)


_USED_EXPOSURES = (
    "times.txt has the exposures that the calibration used: corrected, at their frames, and without gaps"
)


@dataclass(frozen=True)
class OutputFolder:
    """A folder checked by :meth:`at` to be writable; it need not exist yet.

    ``kept`` is the folder with a complete result instead of which a partial one is written here; None otherwise.
    """

    path: Path
    kept: Path | None = None

    @classmethod
    def at(cls, path: str | Path, *, recording: Path | None = None, force: bool = False) -> OutputFolder:
        """Return an output folder after checking that it can be written to.

        The folder may be new, empty, or the output of an earlier run, which is replaced. With ``force``, it may also
        contain other files, which stay. The folder of the ``recording`` is always refused, because its times.txt and
        vignette.png would be overwritten.

        Raises
        ------
        SettingError
            If the folder cannot be used.
        """
        place = Path(path)
        check_usable(place, recording, _content, force=force)
        return cls(place)

    @property
    def for_partial_results(self) -> OutputFolder:
        """The folder for the state and the result of an unfinished run, which never replace a complete result."""
        complete = json_object(self.path / _CALIBRATION).get("partial") is False
        return OutputFolder(self.path / _PARTIAL, kept=self.path) if complete else self

    def remove_partial(self) -> None:
        """Remove the state and the result of an unfinished run, which a complete result replaces."""
        OutputFolder(self.path / _PARTIAL).remove()

    def remove(self) -> None:
        """Remove state and result of an earlier run, and the folder if it is then empty; leave links alone."""
        if self.path.is_dir() and not self.path.is_symlink() and _is_earlier_output(self.path):
            self._remove_earlier()
            with suppress(OSError):
                (self.path / STATE_NAME).unlink(missing_ok=True)
                self.path.rmdir()

    def create(self) -> None:
        """Create the folder if it does not exist; FormatError if that fails."""
        with os_error_as(FormatError, f"{self.path}: the folder cannot be created"):
            self.path.mkdir(parents=True, exist_ok=True)

    def write(self, calibration: Calibration, times: Times | None = None, ended: Sequence[Epoch] = ()) -> Written:
        """Write the files for programs, and times.txt if ``times`` are given, and remove all files of an earlier run.

        times.txt has the exposures that the calibration used: corrected, and each at the frame that it belongs to.
        The calibrations of epochs that ``ended`` with a change of the camera are written to folders of their own.

        Every file is written atomically. If a file after calibration.json cannot be written, the others still are.

        Raises
        ------
        FormatError
            If calibration.json, which comes first, cannot be written. An earlier output is then unchanged.
        """
        self.create()
        first = [calibration.save(self.path / _CALIBRATION)]
        if isinstance(calibration.vignette, RasterVignette):
            first.append(self.path / _MAP)
        written = Written(tuple(first)) + self._remove_earlier(keep=first)
        if self.kept is not None:
            written += Written(notes=(f"{self.kept} keeps its complete result; the partial one is in {self.path}",))
        response, vignette, caveat = calibration.response, calibration.vignette, calibration.caveat
        writers = [*parameter_files(response, vignette, calibration.max_grey, caveat)]
        if times is not None:
            ids, stamps_s = range(len(times.stamps_s)), times.stamps_s
            exposures_ms = without_gaps(used_exposures(calibration, times.exposures_ms))
            if exposures_ms is not times.exposures_ms:
                written += Written(notes=(_USED_EXPOSURES,))
            writers.append(("times.txt", lambda place: write_times(place, ids, stamps_s, exposures_ms)))
        for name, write in writers:
            try:
                written += Written((write(self.path / name),))
            except ExposureError as error:
                written += Written(notes=(f"times.txt was not written: {error}",))
            except OspcError as error:
                written += Written(problems=(str(error),))
        for epoch in ended:
            if epoch.calibration is not None:
                inner = OutputFolder(self.path / f"frames_{epoch.first_frame}-{epoch.last_frame}")
                written += _attempted(partial(inner.write, epoch.calibration), f"{inner.path}: cannot be written")
        return written

    def findings(
        self, calibration: Calibration, recording: Recording | None = None, truth: Photometry | None = None
    ) -> ReportFindings:
        """Return the findings to draw, with a reference and the exposures of times.txt, else those of a recording."""
        exposures_ms: FloatArray | None = None
        try:
            exposures_ms = read_times(self.path / "times.txt").exposures_ms
        except OspcError:
            if recording is not None and not calibration.exponent_sigma:
                exposures_ms = with_used_exposures(recording, calibration).exposures_ms
        return ReportFindings(calibration, exposures_ms, truth)

    def draw(
        self,
        findings: ReportFindings,
        stop: Callable[[], bool] = lambda: False,
        drawing: Future[Drawings] | None = None,
    ) -> Written:
        """Write the picture unless ``stop`` returns true; by default, it is drawn now."""

        def picture() -> Written:
            content = picture_as_png(findings) if drawing is None else drawing.result().picture
            if stop():
                return Written(notes=("interrupted before the picture was written",))
            return Written((write_bytes(self.path / PICTURE, content),))

        return _attempted(picture, f"{self.path}: the picture cannot be drawn")

    def report(
        self,
        findings: ReportFindings,
        recording: Recording | None = None,
        *,
        drawing: Future[Drawings] | None = None,
        about: str = "",
    ) -> Written:
        """Write report.html; by default, its charts are drawn now.

        Example images and tracks come from the recording, and are left out without it.
        """

        def written() -> Written:
            examples = NOTHING_TRIED if recording is None else examples_of(findings.calibration, recording, about)
            charts = None if drawing is None else drawing.result().charts
            return Written((write_text(self.path / REPORT, page(findings, examples, charts)),))

        return _attempted(written, f"{self.path}: the report cannot be written")

    def _remove_earlier(self, keep: Sequence[Path] = ()) -> Written:
        problems = []
        for place in (self.path / name for name in OWN_NAMES):
            if place not in keep:
                try:
                    place.unlink(missing_ok=True)
                except OSError as error:
                    problems.append(f"{place}: left from an earlier run and cannot be removed ({error.strerror})")
        for inner in self.path.glob(_EPOCHS):
            OutputFolder(inner).remove()
        return Written(problems=tuple(problems))


def _attempted(write: Callable[[], Written], failure: str) -> Written:
    """Return the file written, or the error as a problem, so that later files are still written."""
    try:
        return write()
    except OspcError as error:
        return Written(problems=(str(error),))
    except Exception as error:
        return Written(problems=(f"{failure}: {one_line(error)}",))


def _content(place: Path) -> Content:
    for name in OWN_NAMES:
        if (place / name).is_dir():
            return Content(f"{name} is a folder, but a file must be written there", "never")
    inner = place / _PARTIAL
    if inner.exists() and not (inner.is_dir() and _is_earlier_output(inner)):
        return Content(f"{_PARTIAL} in it is not from an earlier calibration", "never")
    if _is_earlier_output(place):
        return Content("contains an earlier calibration", "always")
    return Content("contains files that are not from an earlier calibration", "with force")


def _is_earlier_output(place: Path) -> bool:
    # A killed run leaves only its state.
    if all(entry.name == STATE_NAME for entry in place.iterdir()):
        return True
    return schema_of(place / _CALIBRATION) == "ospc-calibration"
