"""What both trackers share, the one of flights with a navigation unit and the one of pictures alone."""

from deckline.types import Diagnostic, Reason

NEW_FLIGHT_S = 2.0  # a time this far back is another flight, not a late frame
UNUSABLE = {Reason.FROZEN}  # flags of a frame whose lines may not update the track
# Frames so close together err alike, so that they count as one: points are off the same way, and a deck moves otherwise
# than as an oscillation. 30 full frames a second contradict a stated width in half of the nominal flights.
CORRELATION_TIME_S = 0.33
RAMP_CORRELATION_S = 1.0  # over which ramp positions share the same error of attitude and of the detector
OBSERVED_SHARE = 0.1  # of a prior's variance that must be gone before its estimate is tested
MAX_SPEED_SIGMA_M_S = 20.0  # of a velocity, above which no rate is given
YOUNG = Diagnostic(Reason.YOUNG_TRACK, "the track is too young to show contradictions")
