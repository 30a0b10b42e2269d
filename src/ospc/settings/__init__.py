"""Numeric settings of the methods: their meaning, unit and the reason for their value.

:mod:`ospc.settings.presets` contains the settings that a user may change, one dataclass for each method. The
constants are grouped by the steps of the default method: :mod:`~ospc.settings.preprocessing`,
:mod:`~ospc.settings.correspondence`, :mod:`~ospc.settings.exposures`, :mod:`~ospc.settings.estimation` and
:mod:`~ospc.settings.methods` (runs and change detection).
"""

from ospc.settings.presets import (
    DefaultSettings,
    FastSettings,
    PaperSettings,
    Settings,
    as_dict,
    check_names,
    preset,
    with_overrides,
)

__all__ = [
    "DefaultSettings",
    "FastSettings",
    "PaperSettings",
    "Settings",
    "as_dict",
    "check_names",
    "preset",
    "with_overrides",
]
