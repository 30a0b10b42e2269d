"""The folder that a calibration is written to: files for programs, a report and pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ospc.arrays import FloatArray
from ospc.errors import ExposureError, FormatError, OspcError, SettingError, one_line, os_error_as
from ospc.folders import check_usable
from ospc.formats.dso import CAVEAT, parameter_files, write_times
from ospc.formats.files import json_object, write_bytes
from ospc.formats.opening import Photometry
from ospc.photometry.calibration import Calibration
from ospc.photometry.vignette import RasterVignette
from ospc.recording import Recording
from ospc.report.charts import Findings
from ospc.report.drawing import Drawn
from ospc.report.examples import NOTHING_TRIED, examples_of, exposures_beside
from ospc.report.page import write_page
from ospc.report.pdf import write_pdf
from ospc.report.pictures import PICTURES, pictures_as_png
from ospc.state.container import STATE_NAME

_SCHEMA_BEGINNING = "ospc-calibration/"
_MAP = "calibration.vignette.npz"
_DATA = ("calibration.json", _MAP, "pcalib.txt", "pcalib_16bit.txt", "vignette.png", "times.txt", CAVEAT)
REPORTS = ("report.html", "report.pdf")
OWN_NAMES = (*_DATA, *PICTURES, *REPORTS)
"""Every file that is ever written into such a folder; no other file in it is touched."""


@dataclass(frozen=True)
class Written:
    """What was written, in the order of writing, what was left out on purpose, and what could not be written."""

    files: tuple[Path, ...] = ()
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()

    def __add__(self, other: Written) -> Written:
        """Return both together."""
        return Written(self.files + other.files, self.notes + other.notes, self.problems + other.problems)


class Times(Protocol):
    """What times.txt is made of: a recording, or what a camera has filmed."""

    @property
    def exposures_ms(self) -> FloatArray:
        """Exposure in milliseconds of every frame, shape (frames,)."""

    @property
    def stamps_s(self) -> FloatArray:
        """Time stamp in seconds of every frame, shape (frames,)."""


@dataclass(frozen=True)
class OutputFolder:
    """A folder that may be written to, but need not exist yet; make one with :meth:`at`."""

    path: Path

    @classmethod
    def at(cls, path: str | Path, *, recording: Path | None = None, force: bool = False) -> OutputFolder:
        """Return a folder after checking that it may be written to.

        SettingError unless it is new, empty, or the output of an earlier run, which is replaced. With ``force``, it
        may hold something else; files of other names stay. The ``recording`` is never overwritten: its times.txt and
        vignette.png have the same names.
        """
        place = Path(path)
        check_usable(place, recording, lambda place: _check_content(place, force))
        return cls(place)

    def write(self, calibration: Calibration, times: Times | None = None) -> Written:
        """Write the files for programs, times.txt if there are any, and remove all files of an earlier run.

        Every file is written whole or not at all. calibration.json comes first: if it cannot be written, which is a
        FormatError, an earlier output stays as it was. A problem with a later file does not keep the others from
        being written.
        """
        with os_error_as(FormatError, f"{self.path}: the folder cannot be created"):
            self.path.mkdir(parents=True, exist_ok=True)
        first = [calibration.save(self.path / "calibration.json")]
        if isinstance(calibration.vignette, RasterVignette):
            first.append(self.path / _MAP)
        written = Written(tuple(first)) + self._remove_earlier(keep=first)
        response, vignette, caveat = calibration.response, calibration.vignette, calibration.caveat
        writers = [*parameter_files(response, vignette, calibration.max_grey, caveat)]
        if times is not None:
            ids, stamps_s, exposures_ms = range(len(times.stamps_s)), times.stamps_s, times.exposures_ms
            writers.append(("times.txt", lambda place: write_times(place, ids, stamps_s, exposures_ms)))
        for name, write in writers:
            try:
                written += Written((write(self.path / name),))
            except ExposureError as error:
                written += Written(notes=(f"times.txt was not written: {error}",))
            except OspcError as error:
                written += Written(problems=(str(error),))
        return written

    def findings(
        self, calibration: Calibration, recording: Recording | None = None, truth: Photometry | None = None
    ) -> Findings:
        """Return what to draw: with the exposures of a recording, or else of times.txt, and with a reference."""
        exposures_ms = exposures_beside(self.path) if recording is None else recording.exposures_ms
        return Findings(calibration, exposures_ms, truth)

    def draw(
        self, findings: Findings, stop: Callable[[], bool] = lambda: False, drawn: Drawn | None = None
    ) -> Written:
        """Write the pictures until ``stop``, asked before each, is true; ``drawn`` draws them elsewhere."""

        def pictures() -> Iterator[Written]:
            content = pictures_as_png(findings) if drawn is None else drawn().result().pictures
            for name, picture in content.items():
                if stop():
                    yield Written(notes=("interrupted before all pictures were written",))
                    return
                yield Written((write_bytes(self.path / name, picture),))

        return _collected(pictures(), f"{self.path}: the pictures cannot be drawn")

    def report(
        self,
        findings: Findings,
        recording: Recording | None = None,
        *,
        pdf: bool = False,
        drawn: Drawn | None = None,
    ) -> Written:
        """Write report.html, and report.pdf if asked for.

        Pictures and points to track are from the recording; without it, there are none. They are tried while
        ``drawn`` draws the charts elsewhere.
        """

        def reports() -> Iterator[Written]:
            drawing = None if drawn is None else drawn()
            examples = NOTHING_TRIED if recording is None else examples_of(findings.calibration, recording)
            charts = None if drawing is None else drawing.result().charts
            yield Written((write_page(findings, self.path / "report.html", examples, charts),))
            if pdf:
                yield Written((write_pdf(findings, self.path / "report.pdf", examples),))

        return _collected(reports(), f"{self.path}: the report cannot be written")

    def _remove_earlier(self, keep: list[Path]) -> Written:
        problems = []
        for place in (self.path / name for name in OWN_NAMES):
            if place not in keep:
                try:
                    place.unlink(missing_ok=True)
                except OSError as error:
                    problems.append(f"{place}: left by an earlier run, and cannot be removed ({error.strerror})")
        return Written(problems=tuple(problems))


def _collected(parts: Iterator[Written], failure: str) -> Written:
    """Return what is written part by part until one fails; that must not cost the files that follow."""
    written = Written()
    try:
        for part in parts:
            written += part
    except OspcError as error:
        written += Written(problems=(str(error),))
    except Exception as error:
        written += Written(problems=(f"{failure}: {one_line(error)}",))
    return written


def _check_content(place: Path, force: bool) -> None:
    for name in OWN_NAMES:
        if (place / name).is_dir():
            raise SettingError(f"{place / name}: is a folder, but a file is to be written there; remove it")
    if any(place.iterdir()) and not force and not _is_earlier_output(place):
        raise SettingError(
            f"{place}: holds files that are not an earlier calibration; choose another folder, or add --force to "
            "write into it"
        )


def _is_earlier_output(place: Path) -> bool:
    # A run that was killed before its end leaves only its state.
    if all(entry.name == STATE_NAME for entry in place.iterdir()):
        return True
    return str(json_object(place / "calibration.json").get("schema")).startswith(_SCHEMA_BEGINNING)
