"""The faults of `deckline eval integrity`, by name, and how they are put into a flight."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Flag, auto

import numpy as np

from deckline_lab.evaluation import integrity_pictures as pictures
from deckline_lab.evaluation import integrity_sensors as sensors
from deckline_lab.evaluation.approaches import Sighting
from deckline_lab.evaluation.integrity_sensors import Begin

PITCH_DEG = 3.0  # of the camera mount, either way
YAW_DEG = (1.5, 5.0, 8.0, 12.0)
CX_PX = (15.0, 60.0)  # of the stated principal point, either way
CROPPED = (0.05, 0.15)  # share of the picture's columns, at its left
WIDTH_OFF = (0.07, 0.2, 0.75)  # of the stated width, as a share of the true one, either way
DECK_UP_M = 10.0


class Runs(Flag):
    """Flights that a fault is put into."""

    MODELLED = auto()  # detected points come from a noise model, and there is no picture
    RENDERED = auto()  # the detector finds the lines in rendered pictures
    BOTH = MODELLED | RENDERED


@dataclass(frozen=True)
class Fault:
    """One fault of a flight."""

    name: str
    """Of the tables and of `--fault`."""
    sudden: bool
    """It begins in flight; otherwise it is there from the first frame on."""
    runs: Runs
    """Flights that it is put into."""
    begin: Begin
    """Draws the size of the fault and returns what it does to each frame."""
    width_off: float = 0.0
    """Error of the stated width, as a share of the true one, either way; 0: none."""
    of_pose: bool = False
    """It is in the pose, or in the deck's height beside it; a flight without poses cannot have it."""


DECK_HEIGHTS = {  # told instead of the true z, m, by the end of the fault's name
    " -10 m": lambda frame, z_m: z_m - DECK_UP_M,
    " of the sea": lambda frame, z_m: frame.sea_z_m,
    ", wrong sign": lambda frame, z_m: -z_m,
}
FAULTS = {
    fault.name: fault
    for fault in (
        Fault("swapped lines", True, Runs.MODELLED, sensors.swap_lines),
        Fault("foul line", True, Runs.MODELLED, sensors.foul_line),
        Fault("catapult track", True, Runs.MODELLED, sensors.catapult_track),
        Fault("boresight 1 deg", False, Runs.MODELLED, sensors.turn_camera),
        Fault("depth bias 3 %", False, Runs.MODELLED, sensors.scale_depth),
        Fault("frozen camera", True, Runs.MODELLED, sensors.freeze_camera),
        Fault("mirrored picture", False, Runs.RENDERED, pictures.mirror),
        Fault("rolled picture", False, Runs.RENDERED, pictures.roll),
        Fault("stalled picture", True, Runs.RENDERED, sensors.stall_picture),
        Fault("stalled picture and pose", True, Runs.RENDERED, sensors.stall_all),
        Fault("dropped frames", True, Runs.RENDERED, sensors.drop_frames),
        Fault("pose late by 0.2 s", True, Runs.BOTH, sensors.delay_pose, of_pose=True),
        Fault("swapped poses", True, Runs.RENDERED, sensors.swap_poses, of_pose=True),
        Fault("deck height once", True, Runs.MODELLED, sensors.shift_deck_once, of_pose=True),
        Fault("deck height", False, Runs.MODELLED, sensors.shift_deck, of_pose=True),
        *(Fault(f"mount {deg:g} deg in yaw", False, Runs.BOTH, sensors.turn_mount("z", deg)) for deg in YAW_DEG),
        *(Fault(f"cx {px:g} px off", False, Runs.BOTH, sensors.move_principal_point(px)) for px in CX_PX),
        *(Fault(f"left {share:.0%} cropped", False, Runs.BOTH, sensors.crop_left(share)) for share in CROPPED),
        *(Fault(f"width {off:.0%} off", False, Runs.BOTH, sensors.change_nothing, off) for off in WIDTH_OFF),
        Fault("mount 3 deg in pitch", False, Runs.BOTH, sensors.turn_mount("y", PITCH_DEG)),
        *(
            Fault(f"deck height{name}", False, Runs.BOTH, sensors.set_deck(height), of_pose=True)
            for name, height in DECK_HEIGHTS.items()
        ),
        Fault("night gain", False, Runs.RENDERED, pictures.darken),
        Fault("glare", True, Runs.RENDERED, pictures.dazzle),
        Fault("extra line", False, Runs.RENDERED, pictures.extra_line),
        Fault("crossing line", False, Runs.RENDERED, pictures.crossing_line),
        Fault("second runway", True, Runs.RENDERED, pictures.second_runway),
        Fault("edge lost", False, Runs.RENDERED, pictures.lose_edge),
        Fault("edge moved by 9 m", False, Runs.RENDERED, pictures.move_edge),
        Fault("edges at 6 m", False, Runs.RENDERED, pictures.narrow),
        Fault("edges under rubber", False, Runs.RENDERED, pictures.blacken),
        Fault("aircraft on an edge", False, Runs.RENDERED, pictures.park),
        Fault("people on the edges", False, Runs.RENDERED, pictures.gather),
        Fault("rain", False, Runs.RENDERED, pictures.rain),
    )
}


def inject(
    sightings: Iterable[Sighting], fault: Fault | None, onset_s: float, rng: np.random.Generator
) -> Iterator[tuple[Sighting, bool]]:
    """Sightings, in order of time, and whether each has the fault; a sudden one comes at `onset_s`."""
    if fault is None:
        yield from ((sighting, False) for sighting in sightings)
        return
    step, flight = fault.begin(rng), []
    first = 0  # index of the first frame with the fault
    for sighting in sightings:
        flight.append(sighting)
        if fault.sudden and sighting.frame.time_s < onset_s:
            first = len(flight)
            yield sighting, False
        else:
            yield from ((changed, True) for changed in step(flight, first))
