"""Labelled runway lines: one type in memory, and the file formats that people label in."""

from deckline.labels.coco import read_coco, write_coco
from deckline.labels.culane import read_culane, write_culane
from deckline.labels.lines import LabelledImage, LabelSet
from deckline.labels.own import LABELS_FILE, Labels, read_labels, write_labels
from deckline.labels.tusimple import read_tusimple, write_tusimple

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
