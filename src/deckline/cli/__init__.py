"""The `deckline` command: thin files that read options and call the rest."""
