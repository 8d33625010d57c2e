"""Labelled runway lines: one type in memory, and the file formats that people label in."""

from deckline.labels.coco import read_coco, write_coco
from deckline.labels.lanes import read_culane, read_tusimple, write_culane, write_tusimple
from deckline.labels.lines import LABELS_FILE, LabelledImage, Labels, LabelSet, read_labels, write_labels

__all__ = [
    "LABELS_FILE",
    "LabelSet",
    "LabelledImage",
    "Labels",
    "read_coco",
    "read_culane",
    "read_labels",
    "read_tusimple",
    "write_coco",
    "write_culane",
    "write_labels",
    "write_tusimple",
]
