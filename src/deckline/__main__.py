"""`python -m deckline`: the `deckline` command."""

from deckline.cli.main import main

raise SystemExit(main())
