"""Draw the animation that README begins with from the film of `deckline demo`.

deckline demo
python scripts/draw_animation.py demo-out/overlay.mp4 docs/figures/approach.webp
"""

import argparse
from pathlib import Path

import av
from PIL import Image

WIDTH_PX, QUALITY = 800, 60
HOLD = 12  # times as long the last picture is shown


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("film", type=Path)
    parser.add_argument("animation", type=Path)
    given = parser.parse_args()
    with av.open(str(given.film)) as film:
        rate = film.streams.video[0].average_rate
        pictures = [frame.to_image() for frame in film.decode(video=0)]
    height_px = round(pictures[0].height * WIDTH_PX / pictures[0].width)
    small = [picture.resize((WIDTH_PX, height_px), Image.Resampling.LANCZOS) for picture in pictures]
    step_ms = round(1000 / float(rate))
    steps = [step_ms] * (len(small) - 1) + [HOLD * step_ms]
    small[0].save(
        given.animation, save_all=True, append_images=small[1:], duration=steps, loop=0, quality=QUALITY, method=6
    )
    print(f"{given.animation}: {len(small)} pictures, {given.animation.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
