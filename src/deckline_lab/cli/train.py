"""`deckline train`: the trainings need the train extra and are imported when they are chosen."""

COMMANDS = {"dehaze": "deckline_lab.cli.train_dehaze:dehaze", "detect": "deckline_lab.cli.train_detect:detect"}
EXAMPLES = {
    "deckline train dehaze": (
        "deckline train dehaze data/train-* --out runs/dehaze --prior --minutes 60",
        "deckline train dehaze data/mine --out runs/mine --recipe runs/dehaze/recipe.toml --start-from runs/dehaze",
    ),
    "deckline train detect": (
        "deckline train detect data/train-* --out runs/detect --minutes 60",
        "deckline train detect data/train-* pictures --out runs/mine --start-from shipped --lr 2e-4",
    ),
}
