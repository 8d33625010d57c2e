"""Write a recording as a 30 Hz film with poses.csv and camera.toml, as a camera on board would deliver it.

    python benchmarks/film.py RECORDING FOLDER

Frames follow at 1/30 s whatever their times were. Depth is left out.
"""

import csv
import sys
from fractions import Fraction
from pathlib import Path

import av

from deckline import open_recording
from deckline.recording.camera_file import format_camera

RATE = 30


def main(source: str, out: Path) -> None:
    out.mkdir(parents=True)
    with av.open(str(out / "approach.mp4"), "w") as film, (out / "poses.csv").open("w", newline="") as poses:
        rows = csv.writer(poses)
        rows.writerow(["time_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"])
        stream = film.add_stream("libx264", rate=RATE, options={"preset": "veryfast", "crf": "16", "bf": "0"})
        stream.gop_size = RATE
        for number, frame in enumerate(open_recording(source)):
            if number == 0:
                stream.width, stream.height = frame.camera.width, frame.camera.height
            picture = av.VideoFrame.from_ndarray(frame.image_rgb, format="rgb24")
            picture.pts, picture.time_base = number, Fraction(1, RATE)
            film.mux(stream.encode(picture))
            pose = frame.world_from_body
            if pose is None:
                raise SystemExit(f"{source}: {frame.file} has no pose")
            rows.writerow([number / RATE, *pose.translation, *pose.rotation.as_quat(scalar_first=True)])
        film.mux(stream.encode(None))
    known = {"deck_z_m": frame.deck_z_m, "sea_z_m": frame.sea_z_m}
    heights = "".join(f"{name} = {value}\n" for name, value in known.items() if value is not None)
    (out / "camera.toml").write_text(heights + format_camera(frame.camera, frame.body_from_camera), encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit("usage: python benchmarks/film.py RECORDING FOLDER")
    main(sys.argv[1], Path(sys.argv[2]))
