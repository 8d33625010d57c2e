"""From one hazy frame to guidance, in ten lines.

    python examples/01_frame_to_guidance.py RECORDING [INDEX]

RECORDING is anything `deckline run` takes; `deckline demo` unpacks one into demo-out/approach.
"""

import sys

from deckline import Flight, open_recording


def main(recording: str, index: int = 0) -> None:
    frame = open_recording(recording).load(index)
    result = Flight.from_config()(frame)
    print(frame.file, result.guidance.status, result.guidance.mode, result.guidance.reason)
    for name in ("lateral_deviation_m", "heading_error_rad", "height_above_deck_m", "distance_to_ramp_m"):
        measured = getattr(result.guidance, name)
        print(f"{name:22}", "unknown" if measured is None else f"{measured.value:+.3f} +- {measured.sigma:.3f}")


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
