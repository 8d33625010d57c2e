"""`deckline reproduce`."""

from deckline_lab.reproduce.command import reproduce

COMMANDS = {"reproduce": reproduce}
EXAMPLES = {
    "deckline reproduce": (
        "deckline reproduce table6",
        "deckline reproduce table4 --runs runs --minutes 7",
    ),
}
