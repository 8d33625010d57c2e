"""A course and glideslope indicator as pilots know it, and the numbers beside it.

The needles are fly-to: they show where the centre line and the glideslope are. An aircraft right of the line has its
vertical needle on the left; one above the glideslope has its horizontal needle below the middle. What is not known
shows a red flag, never a centred needle.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.report import draw
from deckline.report.draw import (
    Image,
    draw_box,
    draw_dot,
    draw_segment,
    draw_tag,
    draw_text,
    measure_text,
    shorten,
    wrap,
)
from deckline.report.status import STATUS_COLOURS
from deckline.types import DepthMode, Guidance, PoseSource, Status, TrackState, Value

METRES, WIDTHS = "m", "widths"
BAND = (1280, 248)  # width, height, px
LATERAL_DOT_M = 5.0  # sideways per dot: two dots, 10 m, lie outside the edge lines of a carrier's landing deck
LATERAL_DOT_WIDTHS = 0.25  # sideways per dot where metres are not known: two dots, half a width, are an edge line
LATERAL_DOTS = {METRES: LATERAL_DOT_M, WIDTHS: LATERAL_DOT_WIDTHS}
GLIDESLOPE_DOT_DEG = 0.35  # ICAO Annex 10: full scale is 0.7 degrees, two dots
FULL_SCALE_DOTS = 2.4  # where a needle rests against its stop
DOT_PX = 40
SIGMA_OPACITY = 0.28  # of the band around a needle
FACE = (16, 12, 224)  # left, top, side

TRACK_TAGS = {  # the state `coasting` is a status too
    TrackState.TRACKING: ("TRACKING", draw.GOOD, (8, 20, 16)),
    TrackState.LOST: ("NO TRACK", draw.EDGE, draw.INK),
}
MODES = {
    DepthMode.FINE: "fine: distances from the depth camera",
    DepthMode.COARSE: "coarse: distances from pose and deck height",
    DepthMode.WIDTH: "width: distances from the lines' spacing",
    DepthMode.NONE: "no distances",
}
IN_WIDTHS = "lengths in runway widths"


@dataclass(frozen=True, eq=False)
class Lengths:
    """The lengths that people see."""

    lateral: Value | None
    """Positive: right of the centre line."""
    height: Value | None
    """Above the deck."""
    distance: Value | None
    """To the ramp, along the centre line; positive: ahead."""
    unit: str
    """METRES, or WIDTHS of the runway where its width is not stated."""


def lengths_of(guidance: Guidance) -> Lengths:
    """The lengths of a guidance, in metres unless it has runway widths alone."""
    widths = guidance.in_widths
    if widths is not None:
        return Lengths(widths.lateral_deviation, widths.height_above_deck, widths.distance_to_ramp, WIDTHS)
    return Lengths(guidance.lateral_deviation_m, guidance.height_above_deck_m, guidance.distance_to_ramp_m, METRES)


def lateral_needle(guidance: Guidance) -> Value | None:
    """Deflection of the vertical needle, dots, right positive; None: flag."""
    lengths = lengths_of(guidance)
    return _needle(lengths.lateral, LATERAL_DOTS[lengths.unit])


def glideslope_needle(guidance: Guidance) -> Value | None:
    """Deflection of the horizontal needle, dots, up positive; None: flag."""
    return _needle(guidance.vertical_deviation_rad, float(np.deg2rad(GLIDESLOPE_DOT_DEG)))


def lateral_limits_dots(guidance: Guidance) -> tuple[float, float] | None:
    """Deflections of the vertical needle at the protection level, dots; None: not known, or off the scale."""
    deviation, protection = guidance.lateral_deviation_m, guidance.protection
    if deviation is None or protection is None:
        return None
    low, high = (-(deviation.value + side * protection.lateral_m) / LATERAL_DOT_M for side in (1, -1))
    return (low, high) if max(abs(low), abs(high)) <= FULL_SCALE_DOTS else None


def draw_instrument(guidance: Guidance) -> Image:
    """The band (248, 1280, 3) below the pictures: indicator, numbers, status."""
    image = draw.blank(*BAND)
    left, top, side = FACE
    image[top : top + side, left : left + side] = draw_indicator(guidance)
    for column, tile in enumerate(_tiles(guidance)):
        _draw_tile(image, column, *tile)
    _draw_status(image, guidance)
    _draw_legend(image, guidance)
    return image


def draw_indicator(guidance: Guidance) -> Image:
    """The indicator alone, (224, 224, 3)."""
    side = FACE[2]
    image = draw.blank(side, side)
    x, y = middle = np.array([side // 2, side // 2])
    draw_box(image, (0, 0), (side, side), draw.EDGE, 14)
    draw_box(image, (2, 2), (side - 4, side - 4), (10, 13, 17), 12)
    for step in (-2, -1, 1, 2):
        draw_dot(image, (x + step * DOT_PX, y), 4, draw.DIM, filled=False)
        draw_dot(image, (x, y + step * DOT_PX), 4, draw.DIM, filled=False)
    right, up, reach = np.array([DOT_PX, 0]), np.array([0, -DOT_PX]), side // 2 - 10
    lateral, glideslope = lateral_needle(guidance), glideslope_needle(guidance)
    needles = []
    for needle, across, along in ((glideslope, up, right), (lateral, right, up)):
        if needle is not None:
            centre, arm = middle + needle.value * across, reach / DOT_PX * along
            _brighten(image, centre, np.abs(needle.sigma * across + arm))
            needles.append([centre - arm, centre + arm])
    for limit in lateral_limits_dots(guidance) or ():
        draw_segment(image, [middle + limit * right + [0, end] for end in (-18, 18)], draw.CAUTION, 2)
    for ends in needles:
        draw_segment(image, ends, draw.NEEDLE, 3)
    # The aircraft: the fixed mark in the middle.
    draw_segment(image, [(x - 16, y), (x - 6, y)], draw.CENTRE, 2)
    draw_segment(image, [(x + 6, y), (x + 16, y)], draw.CENTRE, 2)
    draw_dot(image, (x, y), 3, draw.CENTRE)
    if lateral is None:
        draw_tag(image, "LOC", (12, 12), 15, draw.FLAG, draw.INK)
    if glideslope is None:
        draw_tag(image, "GS", (side - 48, 12), 15, draw.FLAG, draw.INK)
    if guidance.status is Status.NOT_SEEN:
        words = guidance.status.upper()
        draw_box(image, (x - 70, y - 21), (140, 42), draw.FLAG, 5)
        draw_text(image, words, (x - measure_text(words, 22, 700) / 2, y + 8), 22, draw.INK, 700)
    draw_text(image, f"dot {name_lateral_dot(guidance)}", (12, side - 12), 12, draw.DIM)
    draw_text(image, f"dot {GLIDESLOPE_DOT_DEG:g}°", (side - 62, side - 12), 12, draw.DIM)
    return image


def name_lateral_dot(guidance: Guidance) -> str:
    """What a dot of the vertical needle stands for."""
    unit = lengths_of(guidance).unit
    return f"{LATERAL_DOTS[unit]:g} {unit}"


def _needle(deviation: Value | None, dot: float) -> Value | None:
    """A needle points to where the line or the slope is: against the deviation."""
    if deviation is None:
        return None
    return Value(float(np.clip(-deviation.value / dot, -FULL_SCALE_DOTS, FULL_SCALE_DOTS)), deviation.sigma / dot)


def _brighten(image: Image, centre: NDArray[np.float64], half: NDArray[np.float64]) -> None:
    """Show what lies within 1-sigma of a needle, as far as the face reaches."""
    ends = np.clip([centre - half, centre + half], 10, FACE[2] - 10)
    (x0, y0), (x1, y1) = np.rint(ends).astype(int)
    part = image[y0:y1, x0:x1]
    part[:] = np.rint(part + SIGMA_OPACITY * (np.array(draw.NEEDLE) - part.astype(np.float64))).astype(np.uint8)


def _tiles(guidance: Guidance) -> list[tuple[str, Value | None, str, int, str]]:
    """Title, value, unit, decimals and meaning of each number."""
    lengths, heading, slope = lengths_of(guidance), guidance.heading_error_rad, guidance.vertical_deviation_m
    degrees = None if heading is None else Value(*np.rad2deg([heading.value, heading.sigma]).tolist())
    beside = _side(lengths.lateral, "right of the line", "left of the line")
    above = _seen_from_ramp(lengths)
    if slope is not None:
        above = f"{abs(slope.value):.1f} m {_side(slope, 'above', 'below')} slope"
    turned = _side(degrees, "nose to the right", "nose to the left")
    if guidance.protection is not None:
        beside += f"  ·  within {guidance.protection.lateral_m:.1f} m"
        above += f"  ·  within {guidance.protection.vertical_m:.1f} m"
        if guidance.protection.heading_rad is not None:
            turned += f"  ·  within {np.rad2deg(guidance.protection.heading_rad):.1f}°"
    rates = ((guidance.closing_m_s, "closing {:.0f} m/s"), (guidance.height_rate_m_s, "height {:+.1f} m/s"))
    ahead = ", ".join(words.format(rate.value) for rate, words in rates if rate is not None)
    # A width is many metres: one more digit; and a long word: it stands in the titles.
    words, unit, digits = ("", METRES, 0) if lengths.unit == METRES else (", WIDTHS", "", 1)
    return [
        (f"LATERAL DEVIATION{words}", lengths.lateral, unit, 1 + digits, beside),
        ("HEADING ERROR", degrees, "°", 1, turned),
        (f"HEIGHT ABOVE DECK{words}", lengths.height, unit, 1 + digits, above),
        (f"DISTANCE TO RAMP{words}", lengths.distance, unit, digits, ahead or "along the centre line"),
    ]


def _seen_from_ramp(lengths: Lengths) -> str:
    """Where the aircraft stands over the horizon of somebody at the ramp, which needs no scale."""
    height, distance = lengths.height, lengths.distance
    if height is None or distance is None or not distance.value > 0:
        return "of the aircraft"
    return f"{np.rad2deg(np.arctan2(height.value, distance.value)):.1f}° up, seen from the ramp"


def _side(value: Value | None, positive: str, negative: str) -> str:
    return "" if value is None else positive if value.value > 0 else negative


def _draw_tile(
    image: Image, column: int, title: str, value: Value | None, unit: str, digits: int, meaning: str
) -> None:
    left, top = FACE[0] + FACE[2] + 16 + column * 254, 12
    draw_box(image, (left, top), (245, 118), draw.PANEL, 10)
    draw_text(image, title, (left + 14, top + 24), 13, draw.DIM, 500)
    if value is None:
        draw_text(image, "- - -", (left + 14, top + 66), 34, draw.EDGE, 600)
        draw_text(image, "not known", (left + 14, top + 100), 14, draw.DIM)
        return
    sign = "+" if column < 2 else ""
    space = " " if unit == METRES else ""
    number = f"{value.value:{sign}.{digits}f}"
    used = draw_text(image, number, (left + 14, top + 66), 36, draw.INK, 600)
    used += draw_text(image, f"{space}{unit}", (left + 16 + used, top + 66), 20, draw.INK)
    # One more digit where a small 1-sigma would read as zero.
    decimals = digits if value.sigma >= 0.95 * 10**-digits else digits + 1
    draw_text(image, f"± {value.sigma:.{decimals}f}{space}{unit}", (left + 26 + used, top + 66), 16, draw.DIM)
    draw_text(image, meaning, (left + 14, top + 100), 14, draw.DIM)


def _draw_status(image: Image, guidance: Guidance) -> None:
    left, top = FACE[0] + FACE[2] + 16, 144
    left += draw_tag(image, guidance.status.upper(), (left, top), 18, *STATUS_COLOURS[guidance.status]) + 14
    if guidance.flags:
        left += draw_tag(image, "DO NOT FOLLOW", (left, top), 18, draw.FLAG, draw.INK) + 14
    elif guidance.track in TRACK_TAGS:
        words, colour, ink = TRACK_TAGS[guidance.track]
        left += draw_tag(image, words, (left, top), 18, colour, ink) + 14
    mode = MODES[guidance.mode] if guidance.in_widths is None else IN_WIDTHS
    if guidance.pose_source is PoseSource.PICTURE:
        left += draw_tag(image, "POSE: PICTURE", (left, top), 18, draw.EDGE, draw.INK) + 14
    left += draw_text(image, mode, (left, top + 22), 16, draw.INK) + 18
    for row, line in enumerate(wrap(guidance.reason, 14, BAND[0] - 16 - left, 2)):
        draw_text(image, line, (left, top + (21 if row == 0 else 41)), 14, draw.DIM)


def _draw_legend(image: Image, guidance: Guidance) -> None:
    left, y = FACE[0] + FACE[2] + 16, 222
    for name, colour in (("left line", draw.LEFT), ("right line", draw.RIGHT), ("centre line", draw.CENTRE)):
        draw_box(image, (left, y - 8), (22, 6), colour, 2)
        left += 30 + draw_text(image, name, (left + 30, y), 14, draw.DIM) + 22
    wanted = guidance.glideslope_rad
    slope = "" if wanted is None else f" off the {np.rad2deg(wanted):.3g}° slope"
    notes = (
        f"Fly to the needles.  Dot: {name_lateral_dot(guidance)}, {GLIDESLOPE_DOT_DEG:g}°{slope}.  "
        "±: 1-sigma; within: protection level."
    )
    draw_text(image, shorten(notes, 14, BAND[0] - left - 16), (left + 8, y), 14, draw.DIM)
