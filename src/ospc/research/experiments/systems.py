"""The systems that the paper names and a few more: what each needs, what it recovers, and how to run it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ospc.arrays import ImageSize
from ospc.errors import SettingError
from ospc.photometry.response import Response
from ospc.report.style import BLUE, GREY, ORANGE, new_figure
from ospc.research.accuracy.charts import CHANNELS, ChartSource, chart_sources
from ospc.research.accuracy.charts import FOLDER as CHARTS
from ospc.research.accuracy.design import FILE as DATABASE
from ospc.research.accuracy.design import VIGNETTES, read_database, select
from ospc.research.accuracy.real_video import FOLDER as VIDEO
from ospc.research.accuracy.real_video import VideoSource
from ospc.research.experiments.sources import ColourSource, stand_ins
from ospc.research.measurement import METRICS, Measurement, groups_of, metrics, recordings_of, typical
from ospc.research.method import Method, OwnMethod, PaperVariants
from ospc.research.rivals import from_single_images as single
from ospc.research.rivals.bergmann import Bergmann
from ospc.research.rivals.camera_at_rest import CameraAtRest
from ospc.research.rivals.grundmann_2013 import Grundmann
from ospc.research.rivals.kim_frahm_pollefeys import KimFrahmPollefeys
from ospc.research.rivals.kim_pollefeys import KimPollefeys
from ospc.research.rivals.mo_2019 import Mo
from ospc.research.rivals.quenzel_2018 import Quenzel
from ospc.research.runner import Task
from ospc.research.source import Methods, SimulatedSource, Source, measuring_task
from ospc.research.tables import StudyReport, Table, measurements_csv
from ospc.settings import PaperSettings
from ospc.simulation.responses import RESPONSES, make_response
from ospc.unknown_exposures.single_image.edges import edge_colour_response, edge_histogram_response

_GREEN = CHANNELS.index("green")
_EXPOSURES, _UNKNOWN, _REST = "exposures", "moving camera", "exposures, camera at rest"
_BOTH, _ALL = "response, vignette", "response, vignette, exposures"

_SEED = 5000
"""Seed of the recordings; no weight of any rival was tuned on them."""


@dataclass(frozen=True)
class System(Methods):
    """A system with the authors and year of its publication, and what it needs and recovers.

    ``method`` creates the method, given the true response, from which it may use one point as published.
    ``with_point`` and ``without_point`` name its variants with and without that point; the first is empty if there is
    none. Some systems take frames in ``colour``.
    """

    authors: str
    year: int
    needs: str
    recovers: str
    method: Callable[[Response | None], Method] = field(repr=False)
    with_point: str
    without_point: str
    colour: bool = False

    def make(self, source: Source) -> dict[str, Method]:
        """Create the method for a recording."""
        return {self.without_point: self.method(source.truth().response)}

    def __str__(self) -> str:
        """Return name, authors and year."""
        return f"{self.name}: {self.authors} {self.year}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the system by name, because lambdas cannot be pickled."""
        return _named, (self.name,)


def _named(name: str) -> System:
    return SYSTEMS[name]


def _variants(name: str) -> tuple[str, str]:
    return f"{name}-with", f"{name}-without"


_ALL_SYSTEMS = (
    System("ours", "this project", 2026, _EXPOSURES, _BOTH, lambda _: OwnMethod(variant="ours"), "", "ours"),
    System("paper", "Haidar, Khalil, Asmar", 2024, _EXPOSURES, _BOTH,
        lambda _: PaperVariants({"paper": PaperSettings()}), "", "paper"),
    System("debevec-malik", "Debevec, Malik", 1997, _REST, "response",
        lambda _: CameraAtRest("debevec-malik"), "", "debevec-malik"),
    System("mitsunaga-nayar", "Mitsunaga, Nayar", 1999, _REST, "response",
        lambda _: CameraAtRest("mitsunaga-nayar"), "", "mitsunaga-nayar"),
    System("engel", "Engel, Usenko, Cremers", 2016, _REST, "response", lambda _: CameraAtRest("engel"), "", "engel"),
    System("lin-2004", "Lin, Gu, Yamazaki, Shum", 2004, "one colour image", "response",
        lambda _: single.from_edges("lin-2004-without", edge_colour_response), "", "lin-2004-without", colour=True),
    System("lin-zhang-2005", "Lin, Zhang", 2005, "one grey image", "response",
        lambda _: single.from_edges("lin-zhang-2005-without", edge_histogram_response), "", "lin-zhang-2005-without"),
    System("kim-frahm-pollefeys", "Kim, Frahm, Pollefeys", 2007, _UNKNOWN, "response, exposures",
        KimFrahmPollefeys, *_variants("kim-frahm-pollefeys")),
    System("kim-pollefeys", "Kim, Pollefeys", 2008, "aligned images", _ALL,
        lambda _: KimPollefeys(), "kim-pollefeys-known", "kim-pollefeys-assumed"),
    System("zheng-2008", "Zheng, Lin, Kambhamettu, Yu, Kang", 2008, "one image, its response", "vignette",
        single.zheng_2008, *_variants("zheng-2008")),
    System("zheng-segments", "Zheng, Lin, Kambhamettu, Yu, Kang", 2009, "one image, its response", "vignette",
        single.zheng_segments, *_variants("zheng-segments")),
    System("grundmann", "Grundmann, McClanahan, Kang, Essa", 2013, _UNKNOWN, "responses, exposures",
        Grundmann, *_variants("grundmann")),
    System("bergmann", "Bergmann, Wang, Cremers", 2018, _UNKNOWN, _ALL,
        lambda truth: Bergmann(truth, online=True), "joint-online-wgt", "joint-online-wogt"),
    System("quenzel", "Quenzel, Horn, Houben, Behnke", 2018, _UNKNOWN, _ALL, Quenzel, *_variants("quenzel")),
    System("mo", "Mo, Shi, Yeung, Matsushita", 2019, "images of one scene, in colour", "response",
        Mo, *_variants("mo"), colour=True),
    System("fallback", "this project, --fallback single-image", 2026, "one image", _BOTH,
        lambda _: single.fallback(), "", "fallback-without", colour=True),
)  # fmt: skip
SYSTEMS = {system.name: system for system in _ALL_SYSTEMS}
"""All systems by name: ours, the paper's, then the others by year."""


def chosen_systems(patterns: Sequence[str]) -> list[System]:
    """Return the systems whose names match one of the patterns; all without a pattern."""
    names = {system.name for pattern in patterns for system in select(SYSTEMS, pattern, "system")}
    return [system for name, system in SYSTEMS.items() if not patterns or name in names]


def system_sources(count: int, frames: int, size: ImageSize, data: Path | None) -> list[Source]:
    """Return simulated recordings and, from a folder of real data, the video and the green channels of the charts.

    At least one recording is required.
    """
    found: list[Source] = [*_own_cameras(count, frames, size, data)] if count else []
    if data is not None and (data / VIDEO).is_dir():
        found.append(VideoSource(VIDEO, data / VIDEO))
    if data is not None and (data / CHARTS).is_dir():
        found += [source for source in chart_sources(data / CHARTS) if source.channel == _GREEN]
    if not found:
        raise SettingError("there is no recording to measure; give --count, or --data with real ones")
    return found


def _own_cameras(count: int, frames: int, size: ImageSize, data: Path | None) -> list[SimulatedSource]:
    """Return stand-ins with different responses and vignettes, because a prior may suit one camera by chance."""
    random = np.random.default_rng(_SEED)
    if data is not None and (data / DATABASE).is_file():
        curves = {f"measured{number}": curve for number, curve in enumerate(read_database(data / DATABASE))}
    else:
        curves = {name: make_response(name) for name in RESPONSES}
    names = random.choice(list(curves), count, replace=len(curves) < count).tolist()
    recordings = stand_ins(count, frames, size, data, seed=_SEED)
    found = []
    for number, (source, name) in enumerate(zip(recordings, names, strict=True)):
        vignette = list(VIGNETTES)[number % len(VIGNETTES)]
        settings = replace(source.settings, response=curves[name], **VIGNETTES[vignette])
        found.append(replace(source, settings=settings, factors={"response": name, "vignette": vignette}))
    return found


def in_colour(source: Source) -> Source:
    """Return the same recording with frames in colour, if it has them."""
    if isinstance(source, SimulatedSource):
        return ColourSource(source.name, source.settings, group=source.group, factors=source.factors)
    return replace(source, colour=True) if isinstance(source, ChartSource) else source


def system_tasks(systems: Sequence[System], sources: Sequence[Source]) -> list[Task]:
    """Return one task for every system on every recording, ordered by recording."""
    pairs = [(in_colour(source) if system.colour else source, system) for source in sources for system in systems]
    return [measuring_task(source, system) for source, system in pairs]


_PANELS = metrics("response_shape_rmse", "vignette_rmse")
_MARKERS = {"simulated": "o", "given": "o", "video": "*", "charts": "^"}
"""Plot markers of the groups of recordings."""

_COVERAGE = tuple(metric for metric in METRICS if metric.kind == "share")


def systems_report(systems: Sequence[System], rows: Sequence[Measurement], frames: Mapping[str, int]) -> StudyReport:
    """Return the report, with ``measurements.csv``, ``table.md`` and ``systems.png``.

    There is a table for each group of recordings, with one line per system, and one for the coverage of the bands.
    ``frames`` is the number of frames by recording.
    """
    tables = [_table(group, systems, members, frames) for group, members in groups_of(rows).items()]
    covered = [row for row in rows if any(metric.figure in row.figures for metric in _COVERAGE)]
    if covered:
        tables.append(_coverage_table(covered))
    texts = {
        "measurements.csv": measurements_csv(rows),
        "table.md": "\n".join(table.as_markdown() for table in tables),
    }
    return StudyReport(tables, texts, {"systems.png": partial(_draw, systems, rows)})


def _table(group: str, systems: Sequence[System], rows: Sequence[Measurement], frames: Mapping[str, int]) -> Table:
    lines = []
    for system in systems:
        variants = (system.with_point, system.without_point)
        own = [[row for row in rows if row.method == name] for name in variants]
        mine = [row for part in own for row in part]
        if not mine:
            continue
        # Failures are counted in a column of their own.
        cells = [metric.text(typical(part, metric)) for metric in _PANELS for part in own]
        times = [1000 * row.seconds / frames[row.recording] for row in mine if row.seconds is not None]
        time = f"{np.median(times):.2f}" if times else "–"
        # Judged by curves, because a vignette may be found although the true one is unknown.
        solved = {row.recording for row in mine if row.curves}
        count = len(recordings_of(mine))
        about = (system.name, f"{system.authors} {system.year}", system.needs, system.recovers)
        lines.append((*about, *cells, time, f"{count - len(solved)}/{count}"))
    title = f"Medians over {len(recordings_of(rows))} recordings, {group}"
    header = (
        "system", "publication", "needs", "recovers", "response, with its known point", "without",
        "vignette, with", "without", "ms per frame", "no result",
    )  # fmt: skip
    return Table(title, header, tuple(lines), names=4)


def _coverage_table(rows: Sequence[Measurement]) -> Table:
    """Return how often the truth is within the confidence bands of the methods that state some."""
    lines = []
    for group, name in dict.fromkeys((row.group, row.method) for row in rows):
        mine = [row for row in rows if (row.group, row.method) == (group, name)]
        lines.append((name, group, *(metric.text(typical(mine, metric)) for metric in _COVERAGE)))
    header = ("method", "recordings", *(metric.label for metric in _COVERAGE))
    return Table("Coverage of the bands", header, tuple(lines), names=2)


def _draw(systems: Sequence[System], rows: Sequence[Measurement]) -> Any:
    """Draw the errors of every system with and without its known point, and their medians by group."""
    figure = new_figure(13.0, 1.6 + 0.36 * len(systems))
    panels = figure.subplots(1, len(_PANELS), sharey=True)
    for axes, metric in zip(panels, _PANELS, strict=True):
        for place, system in enumerate(systems):
            for name, colour, shift in ((system.with_point, BLUE, -0.17), (system.without_point, ORANGE, 0.17)):
                own = [row for row in rows if row.method == name and metric.figure in row.figures]
                _draw_errors(axes, own, metric.figure, place + shift, colour)
        axes.set(xscale="log", xlabel=metric.label, ylim=(len(systems) - 0.5, -0.5))
        axes.set_yticks(range(len(systems)), [f"{system.name} ({system.year})" for system in systems])
    for label, colour in (("with its known point", BLUE), ("without, or needs none", ORANGE)):
        panels[0].plot([], [], "o", color=colour, label=label)
    for group in groups_of(rows):
        panels[0].plot([], [], _MARKERS.get(group, "s"), color=GREY, label=f"median, {group}")
    figure.legend(loc="outside lower center", ncols=5)
    return figure


def _draw_errors(axes: Any, rows: Sequence[Measurement], figure: str, place: float, colour: str) -> None:
    for group, members in groups_of(rows).items():
        values = [row.figures[figure] for row in members]
        axes.plot(values, np.full(len(values), place), ".", color=colour, ms=3, alpha=0.35)
        axes.plot(np.median(values), place, _MARKERS.get(group, "s"), color=colour, ms=7)
