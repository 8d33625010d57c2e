"""Plain values of messages: those of deckline_msgs/Guidance, and names of frames."""

import math
from typing import Any

from deckline.adapters.ros.messages import Values
from deckline.report.records import Record
from deckline.types import Status

PROTECTION = {  # of a record's protection levels -> field
    "lateral_m": "lateral_protection_m",
    "vertical_m": "vertical_protection_m",
    "heading_deg": "heading_protection_deg",
    "distance_m": "distance_protection_m",
    "risk": "risk",
}
FRAMES = ("frame_id", "child_frame_id")
NOT_KNOWN = {"value": math.nan, "sigma": math.nan}


def guidance_values(record: Record, header: Values, codes: dict[Status, int]) -> Values:
    """Fields of a deckline_msgs/Guidance; NaN for what is not known.

    Args:
        record: a live one.
        header: of the message.
        codes: number of each status.
    """
    live, levels = record["live"], record["protection"] or {}
    return {
        "header": header,
        "status": codes[Status(record["status"])],
        "reason": record["reason"] or "",
        "flags": [flag["name"] for flag in record["flags"]],
        "pose_source": record["pose_source"] or "",
        "scale_sources": record["scale_sources"],
        "age_s": _number(live["age_s"]),
        **{name: estimate or NOT_KNOWN for name, estimate in record["guidance"].items()},
        **{field: _number(levels.get(name)) for name, field in PROTECTION.items()},
    }


def fill(message: Any, values: Values) -> Any:
    """Set fields of a message, nested ones too; returns it. AttributeError for a field that it does not have."""
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def rename_frames(values: Any, names: dict[str, str]) -> Any:
    """The same values with frames of these names renamed, wherever they stand."""
    if isinstance(values, list):
        return [rename_frames(value, names) for value in values]
    if not isinstance(values, dict):
        return values
    return {
        name: names.get(value, value) if name in FRAMES else rename_frames(value, names)
        for name, value in values.items()
    }


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
