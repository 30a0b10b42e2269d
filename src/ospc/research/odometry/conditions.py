"""The conditions that odometry is run under: one column each of the paper's table.

The paper (section 4.2) runs DSO with the full ground truth, with its own calibration (I), with the calibration of
Bergmann et al. 2018 aligned by one point of the true response (II) and without that point ("II modified"), always
with the exposures of the metadata; and without any photometric calibration, "including the affine brightness
correction", with all exposures set to one (III). The last is mode 2 of DSO, which fixes the affine brightness
transfer at identity; mode 1, which leaves it free, is a further condition here.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ospc.errors import SettingError

Mode = Literal[0, 1, 2]
"""DSO's mode: 0 with calibration files, 1 with a free affine transfer of brightness instead, 2 with neither."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}")


@dataclass(frozen=True)
class Condition:
    """What odometry is given: its name in commands and results, the heading of its column, and DSO's mode."""

    name: str
    title: str
    mode: Mode = 0

    @property
    def calibrated(self) -> bool:
        """Whether it needs a response and a vignette."""
        return self.mode == 0

    @property
    def metadata_exposures(self) -> bool:
        """Whether exposures are those of the recording; otherwise all are one."""
        return self.mode != 2


STANDARD: tuple[Condition, ...] = (
    Condition("truth", "Full truth"),
    Condition("paper", "The paper's (I)"),
    Condition("ours", "Ours"),
    Condition("joint-wgt", "Joint, one true point (II)"),
    Condition("joint-wogt", "Joint, no truth (II modified)"),
    Condition("none", "None (III)", 2),
)
"""The columns of the paper's table with its modified experiment II, and that of the method here."""

AFFINE = Condition("affine", "None, affine transfer free", 1)
"""Not in the paper: what DSO is meant to be run with where there is no calibration."""

_KNOWN = {condition.name: condition for condition in (*STANDARD, AFFINE)}


def external(name: str) -> Condition:
    """Return a condition for calibration files of another program, under a name that is not taken."""
    if not _NAME.fullmatch(name) or name in _KNOWN:
        raise SettingError(
            f"'{name}' cannot name a further calibration; choose another word of letters, digits and _ . + -"
        )
    return Condition(name, name)


def chosen(names: Sequence[str]) -> tuple[Condition, ...]:
    """Return standard conditions by their names, in the order of the paper's table."""
    unknown = [name for name in names if name not in _KNOWN]
    if unknown:
        raise SettingError(f"no condition is called '{unknown[0]}'; known: {', '.join(_KNOWN)}")
    return tuple(condition for name, condition in _KNOWN.items() if name in names)
