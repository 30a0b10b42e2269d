"""The findings about the recorded exposures: what they are, how they were corrected, and the verdict on them."""

from __future__ import annotations

from dataclasses import dataclass

from ospc.exposures.brightness_report import BrightnessReport
from ospc.exposures.evidence import ExposureEvidence
from ospc.exposures.lag_selection import LagEstimate
from ospc.exposures.wrong_exposures import in_words
from ospc.photometry.verdict import State, Verdict


@dataclass(frozen=True)
class ExposureFindings:
    """What is concluded about the exposures."""

    evidence: ExposureEvidence
    """What shows it."""
    lag: LagEstimate
    brightness: BrightnessReport | None
    """Those of the evidence, without doubts that a fit has settled."""
    verdict: Verdict
    """Whether exposures and images agree."""
    question: str
    """What is uncertain about the lag, as a note; empty if nothing is."""
    warnings: tuple[str, ...]
    """Why the exposures, as used, are unreliable; empty if they are reliable."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found and corrected, and what is uncertain."""
        ignored = in_words(self.evidence.wrong) if self.evidence.wrong else ""
        return tuple(filter(None, (ignored, self.evidence.correction_note, self.question)))

    @property
    def corrected_frames(self) -> int:
        """Number of frames by which the exposures lagged and that was corrected; 0 for none."""
        return self.evidence.corrected_frames

    def doubted(self, verdict: Verdict) -> Verdict:
        """Return a verdict on response or vignette, lowered to marginal if the exposures are unreliable."""
        misplaced = self.lag.frames is not None and self.lag.frames != self.corrected_frames
        if not self.warnings or not (verdict.known or misplaced):
            return verdict
        state: State = "marginal" if verdict.known else verdict.state
        return Verdict(state, "; ".join([verdict.reason, *self.warnings]), self.verdict.remedy)
