"""What the benchmark is made of: cases that are run, and the figures that come out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, Protocol, TypeAlias

Group = Literal["simulated", "static", "video", "charts"]

OnProgress: TypeAlias = Callable[[float], None]
"""Called now and then with the share that is done."""


@dataclass(frozen=True)
class Figures:
    """The metrics of one calibration; None where it states nothing, or the truth is not known.

    Attributes
    ----------
    response_rmse, response_shape_rmse, log_ratio_error, vignette_rmse, vignette_pixel_rmse
        The metrics of these names in :mod:`ospc.evaluation.metrics`.
    ratio_median_abs, ratio_bias
        Error of ln k over pairs that were not used in fitting.
    factor_error_percent
        Median error of predicted exposure factors, in percent, where a case asks for certain factors.
    response_within_1_sigma, response_within_2_sigma
        Share of the grey levels 5 to 250 at which g is within its standard deviation, and twice that, of the truth.
    vignette_within_1_sigma, vignette_within_2_sigma
        The same for the radial profile at R > 0.1.
    """

    response_rmse: float | None = None
    response_shape_rmse: float | None = None
    log_ratio_error: float | None = None
    vignette_rmse: float | None = None
    vignette_pixel_rmse: float | None = None
    ratio_median_abs: float | None = None
    ratio_bias: float | None = None
    factor_error_percent: float | None = None
    response_within_1_sigma: float | None = None
    response_within_2_sigma: float | None = None
    vignette_within_1_sigma: float | None = None
    vignette_within_2_sigma: float | None = None


FIGURES = tuple(f.name for f in fields(Figures))
"""Names of all figures, in the order of the tables."""


@dataclass(frozen=True)
class Row:
    """How one method did on one case.

    Attributes
    ----------
    method
        "default", "paper/l2", "paper/l1", "paper/m-estimator", or what a case compares with.
    figures
        Its metrics.
    states, reasons
        Verdict on "response" and "vignette", and why.
    failure
        The error that ended the run instead of a calibration; empty where there was none.
    limits
        What limits the comparison itself: how sure the truth is, how wrong the stated exposures are.
    curves
        "response" and "vignette", each with "estimate", "sigma" (or None) and "truth", for pictures.
    """

    method: str
    figures: Figures = Figures()
    states: dict[str, str] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    failure: str = ""
    limits: dict[str, float] = field(default_factory=dict)
    curves: dict[str, dict[str, list[float] | None]] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON-compatible values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Row:
        """Return the row that :meth:`as_dict` described.

        Raises
        ------
        KeyError, TypeError
            If it is no such description.
        """
        return cls(**{**content, "figures": Figures(**content["figures"])})


class Case(Protocol):
    """One recording of the benchmark with what is true of it."""

    @property
    def name(self) -> str:
        """Its name, unique in the benchmark."""
        ...

    @property
    def group(self) -> Group:
        """The table it belongs to."""
        ...

    @property
    def factors(self) -> dict[str, str]:
        """What varies between the cases of its group, and its own level of each."""
        ...

    def describe(self) -> dict[str, Any]:
        """Return what identifies the recording, as JSON-compatible values: a result is valid for this only."""
        ...

    def rows(self, preset: str, progress: OnProgress) -> list[Row]:
        """Run every method of a preset and compare with the truth."""
        ...
