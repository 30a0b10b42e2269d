"""Every number of the methods: what it is, its unit, and why it has this value.

:mod:`ospc.settings.presets` holds what a user may change, one dataclass for each method. The constants are in one
module for each step of the default method: :mod:`~ospc.settings.correspondence`, :mod:`~ospc.settings.exposures`,
:mod:`~ospc.settings.estimation` and :mod:`~ospc.settings.methods`, which has those of the run and of the detection of
changes.
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
