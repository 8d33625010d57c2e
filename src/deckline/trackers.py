"""What both trackers share, the one of flights with a navigation unit and the one of pictures alone."""

from deckline.types import Diagnostic, Reason

UNUSABLE = {Reason.FROZEN}  # flags of a frame whose lines may not update the track
# Frames so close together err alike, so that they count as one: points are off the same way, and a deck moves otherwise
# than as an oscillation. 30 full frames a second contradict a stated width in half of the nominal flights.
CORRELATION_TIME_S = 0.33
RAMP_CORRELATION_S = 1.0  # over which ramp positions share the same error of attitude and of the detector
OBSERVED_SHARE = 0.1  # of a prior's variance that must be gone before its estimate is tested
MAX_SPEED_SIGMA_M_S = 20.0  # of a velocity, above which no rate is given
YOUNG = Diagnostic(Reason.YOUNG_TRACK, "the track is too young to show contradictions")


def noise_inflation(step_s: float, since_s: float, frames: int) -> float:
    """By how much a measurement's covariance is inflated, as it is not independent of those before it.

    Single frames err alike over a correlation time T: T / step of them count as one. Lines from n joined frames, of
    which s were there at the last update, bring n - s new ones: in the next n updates every frame would count n times,
    so that each may count n / (n - s). n - s is since / step, at most n. A moving average of n frames keeps the noise's
    density at zero frequency, which is that of the frames; hence the larger of the two factors, not their product.

    Args:
        step_s: since the frame before, s; 0: there is none.
        since_s: since lines last updated the track, s; infinite: never.
        frames: n.

    Source: Bayley and Hammersley, "The effective number of independent observations", 1946.
    """
    correlated = CORRELATION_TIME_S / step_s if 0 < step_s < CORRELATION_TIME_S else 1.0
    return max(correlated, frames * step_s / since_s, 1.0)
