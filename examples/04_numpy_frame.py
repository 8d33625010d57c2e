"""Guidance from a picture of your own: a numpy array, a camera and a pose.

deckline demo
python examples/04_numpy_frame.py demo-out/approach/images/img_deckline_0_0_6000000000.jpg
"""

import sys

import numpy as np
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

from deckline import Camera, Flight, Frame


def guide(image_rgb):  # (height, width, 3) uint8
    height, width = image_rgb.shape[:2]
    camera = Camera.from_fov(width, height, np.deg2rad(90.0))
    attitude = Rotation.from_euler("ZYX", [170.4, -3.5, -0.8], degrees=True)  # yaw, pitch, roll
    world_from_body = RigidTransform.from_components([224.5, -8.9, -11.4], attitude)  # north, east, down, m
    frame = Frame("mine", 0.0, image_rgb, camera, world_from_body=world_from_body, deck_z_m=6.08)
    return Flight.from_config()(frame).guidance


if __name__ == "__main__":
    found = guide(np.array(Image.open(sys.argv[1])))
    print(found.status, found.lateral_deviation_m, found.height_above_deck_m)
