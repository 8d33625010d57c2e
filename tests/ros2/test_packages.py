"""The ROS 2 packages: their manifests, their files, and what the launch file starts."""

import ast
import runpy
import sys

import pytest
import ros_stand_in
import setuptools
from catkin_pkg.package import parse_package
from ros_stand_in import ROS2

from deckline import __version__

NODE = ROS2 / "deckline_ros"
NO_ROS_PACKAGES = {"deckline", "deckline_ros"}  # of what the node imports


@pytest.mark.parametrize(("name", "build_type"), [("deckline_ros", "ament_python"), ("deckline_msgs", "ament_cmake")])
def test_the_manifest_is_valid(name, build_type):
    warnings = []
    package = parse_package(str(ROS2 / name / "package.xml"), warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == [] and package.package_format == 3
    assert (package.name, package.version, package.licenses) == (name, __version__, ["Apache-2.0"])
    assert package.get_build_type() == build_type


def test_messages_are_declared_as_interfaces():
    package = parse_package(str(ROS2 / "deckline_msgs" / "package.xml"))
    assert [group.name for group in package.member_of_groups] == ["rosidl_interface_packages"]
    listed = (ROS2 / "deckline_msgs" / "CMakeLists.txt").read_text()
    assert all(f'"msg/{path.name}"' in listed for path in (ROS2 / "deckline_msgs" / "msg").iterdir())


def test_every_import_is_a_dependency():
    found = set()
    for path in (*NODE.glob("deckline_ros/*.py"), *NODE.glob("launch/*.py")):
        for part in ast.walk(ast.parse(path.read_text())):
            if isinstance(part, ast.ImportFrom):
                found.add(part.module.split(".")[0])
            elif isinstance(part, ast.Import):
                found.update(name.name.split(".")[0] for name in part.names)
    needed = {name for name in found - set(sys.stdlib_module_names) - NO_ROS_PACKAGES if name not in ("scipy",)}
    package = parse_package(str(NODE / "package.xml"))
    assert needed == {depend.name for depend in package.exec_depends}


def test_setup_installs_what_is_there(monkeypatch):
    given = {}
    monkeypatch.setattr(setuptools, "setup", given.update)
    monkeypatch.chdir(NODE)
    runpy.run_path("setup.py")
    assert (given["name"], given["version"]) == ("deckline_ros", __version__)
    files = [NODE / file for _, group in given["data_files"] for file in group]
    assert all(path.is_file() for path in files) and {"package.xml", "deckline.launch.py"} <= {p.name for p in files}
    assert given["entry_points"]["console_scripts"] == ["deckline_node = deckline_ros.node:main"]


def test_the_launch_file_starts_the_node_with_its_parameters(monkeypatch):
    ros_stand_in.install(monkeypatch)
    import deckline_ros.node as node

    launched = runpy.run_path(str(NODE / "launch" / "deckline.launch.py"))
    *arguments, started, configured, configure = launched["generate_launch_description"]()
    assert (started.package, started.executable) == ("deckline_ros", "deckline_node")
    (stated,) = started.parameters
    kinds = {name: value.value_type for name, value in stated.items()}
    assert kinds == {name: ros_stand_in.PARAMETER_TYPES[kind] for name, (_, kind, _) in node.PARAMETERS.items()}
    declared = {argument.args[0] for argument in arguments}
    remapped = {name for name, _ in started.remappings}
    assert declared == set(stated) | remapped - {"image/compressed"}
    assert remapped == {"image", "image/compressed", "camera_info"}
    defaults = {argument.args[0]: argument.default_value for argument in arguments}
    assert defaults["pose"] == defaults["odom"] == ""  # `pose:=TOPIC` alone leaves odometry out
    assert configure.event.transition_id == 1
    handler = configured.args[0]
    assert (handler.start_state, handler.goal_state) == ("configuring", "inactive")
    assert handler.entities[0].event.transition_id == 3
