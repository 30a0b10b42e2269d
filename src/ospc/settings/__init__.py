"""Every number of the methods: what it is, its unit, and why it has this value.

:mod:`ospc.settings.presets` holds what a user may change, one dataclass for each method.
:mod:`ospc.settings.estimation` holds the constants of the default method's fit, and :mod:`ospc.settings.exposures`
those of the assessment of exposures.
"""

from ospc.settings.presets import (
    DefaultSettings,
    FastSettings,
    PaperSettings,
    Settings,
    as_dict,
    preset,
    with_overrides,
)

__all__ = ["DefaultSettings", "FastSettings", "PaperSettings", "Settings", "as_dict", "preset", "with_overrides"]
