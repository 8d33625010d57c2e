"""Starts deckline's node with the topics and the deck of a flight, and takes it to active."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.parameter_descriptions import ParameterValue
from lifecycle_msgs.msg import Transition

TOPICS = {"image": "/camera/image_raw", "camera_info": "/camera/camera_info"}
PARAMETERS = {  # default and type
    "config": ("", str),
    "deck_z_m": (".nan", float),
    "sea_z_m": (".nan", float),
    "stale_s": ("0.2", float),
    "pose": ("", str),
    "odom": ("", str),
    "base_frame": ("base_link", str),
    "image_transport": ("raw", str),
    "publish_tf": ("false", bool),
}


def generate_launch_description():
    defaults = TOPICS | {name: default for name, (default, _) in PARAMETERS.items()}
    remappings = [(name, LaunchConfiguration(name)) for name in TOPICS]
    remappings.append(("image/compressed", [LaunchConfiguration("image"), "/compressed"]))
    stated = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, (_, kind) in PARAMETERS.items()
    }
    node = LifecycleNode(
        package="deckline_ros",
        executable="deckline_node",
        name="deckline",
        namespace="",
        parameters=[stated],
        remappings=remappings,
        output="screen",
    )

    def change(transition):
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))

    configured = OnStateTransition(
        target_lifecycle_node=node,
        start_state="configuring",
        goal_state="inactive",
        entities=[change(Transition.TRANSITION_ACTIVATE)],
    )
    arguments = [DeclareLaunchArgument(name, default_value=value) for name, value in defaults.items()]
    return LaunchDescription(
        [*arguments, node, RegisterEventHandler(configured), change(Transition.TRANSITION_CONFIGURE)]
    )
