"""Labelled runway lines: one type in memory, and the file formats that people label in."""

from deckline_lab.labels.lines import LABELS_FILE, LabelledImage, Labels, read_labels, write_labels

__all__ = ["LABELS_FILE", "LabelledImage", "Labels", "read_labels", "write_labels"]
