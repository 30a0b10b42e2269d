"""What the user wants to be done about a lag of the exposures."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ospc.errors import SettingError, counted

LagChoice = int | Literal["auto", "never", "trusted"]
"""What to do about a lag of the exposures: correct it where it is certain, never, or by so many frames. ``"trusted"``
is for exposures that were estimated from the images, which cannot disagree with them."""

_WITH_OWN_EXPOSURES = "exif_photos"
"""Kind of recording whose exposures stand in the image files themselves."""


def lag_choice_for(kind: str, choice: LagChoice) -> LagChoice:
    """Return the choice for a kind of recording: photographs hold their own exposures, so that none can be late."""
    return 0 if choice == "auto" and kind == _WITH_OWN_EXPOSURES else choice


def lag_choice(text: str) -> LagChoice:
    """Return the choice that a text states; SettingError unless that is auto, never, or a number of frames."""
    match text.strip().lower():
        case "auto" | "never" as named:
            return named
        case number:
            try:
                return int(number)
            except ValueError:
                raise SettingError(
                    f"{text!r} is neither auto nor never nor a number of frames such as 2 or -1"
                ) from None


def checked_lag_choice(choice: LagChoice) -> LagChoice:
    """Return the choice, with a number of frames as int; SettingError if it is not a :data:`LagChoice`."""
    match choice:
        case "auto" | "never" | "trusted":
            return choice
        case int() | np.integer() if not isinstance(choice, bool):
            return int(choice)
    raise SettingError(
        f"correct_lag is {choice!r}; give 'auto', 'never', 'trusted' or a whole number of frames such as 2 or -1"
    )


def check_lag(choice: LagChoice, frames: int) -> None:
    """Raise a SettingError if a lag leaves fewer than two frames with an exposure of their own."""
    if isinstance(choice, int) and not leaves_frames(choice, frames):
        raise SettingError(
            f"a lag of {counted(choice, 'frame')} leaves nothing of {counted(frames, 'frame')}; give a smaller one"
        )


def leaves_frames(choice: LagChoice, frames: int) -> bool:
    """Whether a lag leaves at least two of the frames with an exposure of their own."""
    return not isinstance(choice, int) or frames - abs(choice) >= 2


def lag_in_words(lag: int) -> str:
    """Return a lag as words, such as "2 frames late"."""
    return f"{counted(abs(lag), 'frame')} {'late' if lag > 0 else 'early'}"
