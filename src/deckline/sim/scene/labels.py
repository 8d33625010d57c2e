"""What the renderer tells apart."""

from enum import IntEnum


class Label(IntEnum):
    """What a pixel shows."""

    SKY = 0
    SURFACE = 1  # water, or the ground around a runway on land
    DECK = 2
    STRUCTURE = 3  # all else of the ship: hull, island, aircraft on deck
    BACKGROUND = 4  # other ships, coast
