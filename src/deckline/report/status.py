"""How a status appears wherever a person sees it: its word is the enum's value, its colours are these."""

from typing import NamedTuple

from deckline.report.draw import CAUTION, DIM, FLAG, GOOD, Colour
from deckline.report.records import SKIPPED
from deckline.types import Status

DARK: Colour = (20, 20, 8)
LIGHT: Colour = (255, 255, 255)


class StatusColours(NamedTuple):
    """Colours of one status."""

    fill: Colour
    ink: Colour  # of words on it

    @property
    def css(self) -> tuple[str, str]:
        """Both as CSS writes them."""
        fill, ink = (f"rgb({red}, {green}, {blue})" for red, green, blue in self)
        return fill, ink


STATUS_COLOURS: dict[str, StatusColours] = {
    Status.OK: StatusColours(GOOD, DARK),
    Status.UNVERIFIED: StatusColours(CAUTION, DARK),
    Status.ONE_LINE: StatusColours((242, 176, 52), DARK),
    Status.COASTING: StatusColours((226, 126, 46), DARK),
    Status.STALE: StatusColours((150, 30, 90), LIGHT),
    Status.NOT_SEEN: StatusColours(FLAG, LIGHT),
    SKIPPED: StatusColours(DIM, DARK),
}
STATUS_WORDS = tuple(map(str, STATUS_COLOURS))  # in the order in which people see them
