"""Land AirSim's vehicle on the deck with deckline in the loop: pictures in, guidance, velocity commands out.

    python examples/09_airsim_closed_loop.py [PORT]

It needs `pip install cosysairsim`, `deckline sim --serve` and a deck at rest. It steers on `ok` and
`unverified` guidance alone, and waves off after a time without it. Two things are better than in flight: the simulator
is paused while deckline computes, so that there is no latency, and the deck's height is the true one of the touchdown
point at the start. See docs/airsim.md.
"""

import math
import sys

import cosysairsim as airsim

from deckline import Flight, Guidance
from deckline.adapters.airsim.source import AirSimSource
from deckline.types import Status

STEP_S = 0.4  # of flight from picture to picture
PATIENCE = 10  # pictures without guidance until it waves off
FAST_M_S, SLOW_M_S, PER_S = 20.0, 3.0, 0.2  # speed along the deck: most, least, per metre to go
CLOSE_PER_S = 0.3  # speed across and down per metre of deviation
RAMP_M = 15.0  # about where the ramp leaves the picture; nearer, the distance follows from the way flown
LOW_M, OVER_M = 3.0, 2.0  # least height, at which both lines are in view; distance at which it goes straight down


def steer(client: airsim.MultirotorClient, guidance: Guidance, to_go_m: float) -> None:
    """Fly towards the centre line and the glideslope, nose along the deck."""
    along, slope = min(max(PER_S * to_go_m, SLOW_M_S), FAST_M_S), math.tan(guidance.glideslope_rad)
    right = -CLOSE_PER_S * guidance.lateral_deviation_m.value
    down = along * slope + CLOSE_PER_S * (guidance.height_above_deck_m.value - max(to_go_m * slope, LOW_M))
    turn = guidance.heading_error_rad.value
    forward, across = along * math.cos(turn) + right * math.sin(turn), right * math.cos(turn) - along * math.sin(turn)
    yaw = airsim.YawMode(True, -math.degrees(turn) / 2)
    client.moveByVelocityBodyFrameAsync(forward, across, down, 2 * STEP_S, yaw_mode=yaw)


def main(port: int = 41451) -> None:
    client = airsim.MultirotorClient(port=port)
    client.confirmConnection()
    client.enableApiControl(True)
    client.armDisarm(True)
    deck_z_m = client.simGetObjectPose("Touchdown").position.z_val
    client.simPause(True)
    flight, lost, known, is_past = Flight.from_config(), 0, None, False
    for frame in AirSimSource(f"airsim://127.0.0.1:{port}", "front_center", rate_hz=1000.0, deck_z_m=deck_z_m):
        guidance, place = flight(frame).guidance, frame.world_from_body.translation
        usable = guidance.status in (Status.OK, Status.UNVERIFIED) and guidance.distance_to_touchdown_m is not None
        lost = 0 if usable else lost + 1
        if usable and not is_past:
            known = guidance.distance_to_touchdown_m.value, place
            is_past = guidance.distance_to_ramp_m.value < RAMP_M
        to_go_m = math.nan if known is None else known[0] - math.dist(place, known[1])
        print(f"{guidance.status}: {to_go_m:.1f} m to go")
        if lost > PATIENCE or to_go_m < OVER_M:
            break
        if usable:
            steer(client, guidance, to_go_m)
        client.simContinueForTime(STEP_S)
    client.simPause(False)
    if lost:
        client.moveByVelocityAsync(0, 0, -5, 10).join()
        sys.exit(f"waved off: {guidance.reason}")
    client.landAsync().join()
    offset = client.simGetVehiclePose().position - client.simGetObjectPose("Touchdown").position
    where, off_m = client.simGetCollisionInfo().object_name, math.hypot(offset.x_val, offset.y_val)
    print(f"on {where}, {off_m:.2f} m from the touchdown point")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
