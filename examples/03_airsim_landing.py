"""Fly the paper's landing profile in AirSim, in fog, and let the simulator record it.

    python examples/03_airsim_landing.py [START_M] [PORT]

START_M is the distance to the ramp at the start, metres. It needs `pip install cosysairsim` and a simulator:
`deckline sim --serve`, or Unreal with Cosys-AirSim, where RAMP_M and COURSE_DEG are those of your ship. See
docs/airsim.md.
"""

import sys
import time

import cosysairsim as airsim
import numpy as np

RAMP_M = np.array([7.5, 27.1, 6.08])  # middle of the runway's near end: north, east, down
COURSE_DEG = 170.93  # direction of landing, from north over east: half way between the paper's two lines
PROFILE_M = np.array([(-70, 0), (800, 60), (4000, 300), (5000, 400)]).T  # distance to the ramp, height above the deck
SPEED_M_S, POSES_PER_S = 65.0, 5.0
FOG = 0.05  # on deckline's simulator a visibility of 1000 m and less


def main(start_m: float = 5000.0, port: int = 41451) -> None:
    client = airsim.VehicleClient(port=port)
    client.confirmConnection()
    client.simEnableWeather(True)
    client.simSetWeatherParameter(airsim.WeatherParameter.Fog, FOG)
    along = np.array([np.cos(np.deg2rad(COURSE_DEG)), np.sin(np.deg2rad(COURSE_DEG)), 0.0])
    for number, range_m in enumerate(np.arange(start_m, 0.0, -SPEED_M_S / POSES_PER_S)):
        height_m = np.interp(range_m, *PROFILE_M)
        place = RAMP_M - range_m * along - [0.0, 0.0, height_m]
        half_yaw, half_pitch = np.deg2rad(COURSE_DEG) / 2, -np.arctan2(height_m, range_m + 70.0) / 2  # to touchdown
        (s, c), (sp, cp) = ((np.sin(half), np.cos(half)) for half in (half_yaw, half_pitch))
        turn = airsim.Quaternionr(*map(float, (-s * sp, c * sp, s * cp, c * cp)))  # x, y, z, w
        client.simSetVehiclePose(airsim.Pose(airsim.Vector3r(*map(float, place)), turn), True)
        if number == 0:
            client.startRecording()
        time.sleep(1.0 / POSES_PER_S)
    client.stopRecording()


if __name__ == "__main__":
    main(*(kind(word) for kind, word in zip((float, int), sys.argv[1:], strict=False)))
