"""Recordings: AirSim-layout folders (read and write), image folders, video files and ROS bags."""

from deckline.recording.layouts import open_recording
from deckline.recording.selection import select_frames
from deckline.recording.source import BadFrame, FrameError, Recording, RecordingError, Source
from deckline.recording.writer import RecordingWriter

__all__ = [
    "BadFrame",
    "FrameError",
    "Recording",
    "RecordingError",
    "RecordingWriter",
    "Source",
    "open_recording",
    "select_frames",
]
