"""Checks of configurations and of what flows: a `ValueError` that names the field and its value."""

from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray


def check_numbers(
    config: Any,
    section: str,
    *names: str,
    least: float | None = None,
    above: float | None = None,
    most: float | None = None,
    below: float | None = None,
) -> None:
    """Refuse numbers that are not finite or out of range, in fields of a dataclass; None and text pass.

    Args:
        section: what its fields are called in errors, `section.field`; empty: the field alone.
        names: the fields; without any, all of them.
        least, above, most, below: the range; `above` and `below` leave the limit itself out.

    Raises:
        ValueError: a number out of range; the message names field, range and value.
    """
    for name in names or vars(config):
        value = getattr(config, name)
        label = f"{section}.{name}" if section else name
        for number in value if isinstance(value, tuple | list) else (value,):
            if isinstance(number, bool) or not isinstance(number, int | float | np.number):
                continue
            if not np.isfinite(number):
                raise ValueError(f"{label} must be finite, got {number}")
            if least is not None and number < least:
                raise ValueError(f"{label} must be at least {least:g}, got {number}")
            if above is not None and number <= above:
                raise ValueError(f"{label} must be greater than {above:g}, got {number}")
            if most is not None and number > most:
                raise ValueError(f"{label} must be at most {most:g}, got {number}")
            if below is not None and number >= below:
                raise ValueError(f"{label} must be less than {below:g}, got {number}")


def check_choice(name: str, value: str, choices: Any) -> None:
    """Refuse a value that a Literal type does not list.

    Raises:
        ValueError: the message names field, choices and value.
    """
    if value not in get_args(choices):
        raise ValueError(f"{name} must be one of {', '.join(get_args(choices))}, got {value!r}")


def check_image(image_rgb: NDArray[np.uint8]) -> None:
    """Raise ValueError unless this is an image (H, W, 3) of uint8 with at least one pixel."""
    if image_rgb.ndim != 3 or image_rgb.shape[2] != 3 or image_rgb.size == 0 or image_rgb.dtype != np.uint8:
        raise ValueError(f"expected an image (H, W, 3) of uint8, got {image_rgb.shape} of {image_rgb.dtype}")


def check_shapes(owner: Any, **shapes: tuple[int, ...]) -> None:
    """Refuse arrays of another shape, in fields of a dataclass.

    Raises:
        ValueError: an array of another shape; the message names class, field, and both shapes.
    """
    for name, shape in shapes.items():
        if np.shape(getattr(owner, name)) != shape:
            raise ValueError(
                f"{type(owner).__name__}.{name} must have shape {shape}, got {np.shape(getattr(owner, name))}"
            )
