"""A recording whose exposures are moved to the frames they belong to."""

from ospc.recording.derived import with_exposure_lag

__all__ = ["with_exposure_lag"]
