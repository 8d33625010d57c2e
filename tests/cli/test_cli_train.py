import pytest

from deckline.cli.main import main
from deckline.extras import needs_extra


@pytest.mark.parametrize("network", ["dehaze", "detect"])
def test_training_without_recordings_is_one_line(network, tmp_path, capsys):
    assert main(["train", network, "--out", str(tmp_path)]) == 2
    assert "deckline: error: no " in capsys.readouterr().err


@pytest.mark.parametrize("network", ["dehaze", "detect"])
def test_recipe_fields_are_flags(network, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["train", network, "--help"])
    assert ended.value.code == 0
    assert "--lr FLOAT" in capsys.readouterr().out


def test_a_missing_package_names_the_extra_that_brings_it():
    message = r'no_such_package is not installed; run: pip install "deckline\[train\]"'
    with pytest.raises(ImportError, match=message), needs_extra("train"):
        import no_such_package  # noqa: F401


def test_a_missing_module_of_our_own_stays_what_it_is():
    with pytest.raises(ModuleNotFoundError, match=r"deckline\.nothing"), needs_extra("train"):
        import deckline.nothing  # noqa: F401
