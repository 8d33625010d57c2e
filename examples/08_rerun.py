"""A flight in the Rerun viewer: pictures, lines, guidance and the aircraft's way, on one time line.

    pip install "deckline[rerun]"
    rerun analytics disable       # the viewer sends usage figures unless told not to; this script starts none
    python examples/08_rerun.py demo-out/approach rerun-out
    rerun rerun-out/flight.rrd

A view watches every frame of `deckline run`; it costs what it draws.
"""

import sys
from pathlib import Path

import rerun as rr

from deckline import Flight, FrameResult, open_recording
from deckline.report.records import Record
from deckline.report.run import run

COLOURS = {"left": (86, 180, 233), "right": (240, 160, 20)}


def watch(result: FrameResult | None, record: Record) -> None:
    """Log one frame; a damaged one is left out."""
    if result is None:
        return
    frame, lines = result.frame, result.estimate.pixel_lines
    rr.set_time("flight", duration=frame.time_s)
    rr.log("camera", rr.Image(frame.image_rgb).compress(jpeg_quality=80))
    ends, colours = [line.ends_px for line in lines.values()], [COLOURS[side] for side in lines]
    rr.log("camera/lines", rr.LineStrips2D(ends, colors=colours, radii=1.0))
    rr.log("status", rr.TextLog(f"{record['status']}: {record['reason']}"))
    for name, value in record["guidance"].items():
        if value is not None:
            rr.log(f"guidance/{name}", rr.Scalars(value["value"]))
            rr.log(f"guidance/{name}/sigma", rr.Scalars(value["sigma"]))
    if frame.world_from_body is not None:
        rr.log("world/aircraft", rr.Points3D([frame.world_from_body.translation], radii=2.0))


def main(recording: str, out: str) -> int:
    rr.init("deckline")
    Path(out).mkdir(exist_ok=True)
    rr.save(Path(out) / "flight.rrd")
    rr.log("world", rr.ViewCoordinates.FRD, static=True)
    return run(open_recording(recording), Flight.from_config(), Path(out) / "results", views=(watch,)).exit_code


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
