"""Starts `ros2_node.py` with the topics and the deck of a flight; see there."""

import sys
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

TOPICS = {"image": "/camera/image_raw", "camera_info": "/camera/camera_info", "pose": "/pose", "odom": "/odom"}
PARAMETERS = {"config": "''", "deck_z_m": ".nan", "sea_z_m": ".nan"}


def generate_launch_description():
    arguments = [DeclareLaunchArgument(name, default_value=value) for name, value in (TOPICS | PARAMETERS).items()]
    remapped = [part for name in TOPICS for part in ("-r", [f"{name}:=", LaunchConfiguration(name)])]
    remapped += ["-r", ["image/compressed:=", LaunchConfiguration("image"), "/compressed"]]
    stated = [part for name in PARAMETERS for part in ("-p", [f"{name}:=", LaunchConfiguration(name)])]
    node = [sys.executable, str(Path(__file__).with_name("ros2_node.py")), "--ros-args", *remapped, *stated]
    return LaunchDescription([*arguments, ExecuteProcess(cmd=node, output="screen")])
