"""The runway lines of pictures in pixels: no camera file, no pose.

    python examples/10_pixel_lines.py PICTURES

PICTURES is a picture, a folder of pictures, or a video.
"""

import sys

from deckline import Flight, open_recording


def main(pictures: str) -> None:
    flight = Flight.from_config()
    for frame in open_recording(pictures):
        estimate = flight(frame).estimate
        print(frame.file, estimate.seen)
        for side, line in estimate.pixel_lines.items():
            (u_near, v_near), (u_far, v_far) = line.ends_px
            print(f"  {side}: ({u_near:.1f}, {v_near:.1f}) to ({u_far:.1f}, {v_far:.1f}), +- {line.sigma_px:.2f} px")


if __name__ == "__main__":
    main(sys.argv[1])
