"""Numeric settings of the methods: their meaning, unit and the reason for their value.

:mod:`ospc.settings.presets` contains the settings that a user may change, one dataclass for each method. The other
modules contain constants, grouped by step or task:

- correspondence: :mod:`~ospc.settings.registration`, :mod:`~ospc.settings.sampling`,
  :mod:`~ospc.settings.grey_values`;
- exposures: :mod:`~ospc.settings.brightness`, :mod:`~ospc.settings.lag`, :mod:`~ospc.settings.exposures`;
- estimation: :mod:`~ospc.settings.response`, :mod:`~ospc.settings.vignette`, :mod:`~ospc.settings.error_model`,
  :mod:`~ospc.settings.fit`, :mod:`~ospc.settings.effects`, :mod:`~ospc.settings.residuals`;
- runs and change detection: :mod:`~ospc.settings.methods`;
- unknown exposures: :mod:`~ospc.settings.unknown_exposures`;
- other tasks: :mod:`~ospc.settings.live`, :mod:`~ospc.settings.pooling`, :mod:`~ospc.settings.diagnosis`,
  :mod:`~ospc.settings.evaluation`.

Grey levels range from 0 to 1; those of constants whose names end in ``_8_BIT`` range from 0 to 255.
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
