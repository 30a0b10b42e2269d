"""The user's choice of what to do about a lag of the exposures."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ospc.errors import SettingError, counted
from ospc.recording import Recording
from ospc.settings.lag import MOST_LAG_FRAMES

LagChoice = int | Literal["auto", "never", "estimated"]
"""What to do about a lag of the exposures: correct it if it is certain (``"auto"``), never, or by a fixed number of
frames. ``"estimated"`` is for exposures that were estimated from the images, which cannot disagree with them."""
_WITH_OWN_EXPOSURES = "exif_photos"
"""Kind of recording that stores exposures in the image files themselves."""


def lag_choice_for(recording: Recording, choice: LagChoice) -> LagChoice:
    """Return the choice for a recording: estimated exposures, and those stored in photographs, cannot lag."""
    if getattr(recording, "exposures_estimated", False):
        return "estimated"
    return 0 if choice == "auto" and recording.kind == _WITH_OWN_EXPOSURES else choice


def lag_choice(text: str) -> LagChoice:
    """Parse a choice; SettingError unless it is auto, never, or a number of frames."""
    match text.strip().lower():
        case "auto" | "never" as named:
            return named
        case number:
            try:
                frames = int(number)
            except ValueError:
                raise SettingError(
                    f"{text!r} is not a valid lag; give auto, never, or a number of frames such as 2 or -1"
                ) from None
            return checked_lag_choice(frames)


def checked_lag_choice(choice: LagChoice) -> LagChoice:
    """Return the choice, a number as int; SettingError if it is not a valid choice, or the lag is too large."""
    match choice:
        case "auto" | "never" | "estimated":
            return choice
        case int() | np.integer() if not isinstance(choice, bool):
            if abs(choice) > MOST_LAG_FRAMES:
                raise SettingError(
                    f"a lag of {abs(choice)} frames is too large; at most {MOST_LAG_FRAMES} can be corrected"
                )
            return int(choice)
    raise SettingError(
        f"correct_lag is {choice!r}; give 'auto', 'never', 'estimated' or a whole number of frames such as 2 or -1"
    )


def check_lag(choice: LagChoice, frames: int) -> None:
    """Raise a SettingError if a lag leaves fewer than two frames with an exposure of their own."""
    if isinstance(choice, int) and choice and not leaves_frames(choice, frames):
        raise SettingError(
            f"a lag of {counted(choice, 'frame')} is too large for {counted(frames, 'frame')}; give a smaller one"
        )


def leaves_frames(choice: LagChoice, frames: int) -> bool:
    """Return whether a lag leaves at least two frames with an exposure of their own."""
    return not isinstance(choice, int) or frames - abs(choice) >= 2


def lag_in_words(lag: int) -> str:
    """Return a lag as text, such as "2 frames late"."""
    return f"{counted(abs(lag), 'frame')} {'late' if lag > 0 else 'early'}"
