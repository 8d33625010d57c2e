import numpy as np
import pytest

from deckline.evaluation.detection_truth import Scene
from deckline.evaluation.frames import Rendered, rendered_sets
from deckline.sim import RendererError, SimConfig
from deckline.sim.deckless import CYCLE

SMALL = {"preset": "train", "trajectory": "deckless", "width": 96, "height": 54, "keep_clear": False}
SHOWN = {"open sea", "open land", "other ships", "coast", "past a ship", "past a runway", "bare deck"}


@pytest.fixture(scope="module")
def deckless():
    config = SimConfig(frames=5, visibility_m=(500.0, 3000.0), seed=1000, frames_per_ship=1, **SMALL)
    item = Rendered(config)
    try:
        item.load(0)
    except RendererError as error:
        pytest.skip(f"no OpenGL on this machine: {error}")
    yield item
    item.close()


def test_nothing_of_a_runway_is_in_the_image_and_each_kind_has_its_turn(deckless):
    samples = [deckless.load(index) for index in range(len(CYCLE))]
    assert [sample.expected.scene for sample in samples] == [Scene.EMPTY] * len(CYCLE)
    names = [sample.ship.removeprefix("no runway: ") for sample in samples]
    assert set(names) <= SHOWN
    assert names[0].startswith("open") and names[3].startswith("past") and names[4] == "bare deck"
    for sample in samples:
        assert sample.frame.image_rgb.std() > 0
        assert 500.0 <= sample.expected.visibility_m <= 3000.0


def test_the_same_index_gives_the_same_frame_whatever_came_before(deckless):
    first = deckless.load(1).frame.image_rgb
    deckless.load(4)
    np.testing.assert_array_equal(deckless.load(1).frame.image_rgb, first)


def test_other_presets_have_a_runway_in_every_view():
    with pytest.raises(ValueError, match="shows ships of preset train, got preset 'paper'"):
        SimConfig(preset="paper", trajectory="deckless")


def test_sets_of_the_command():
    sets = rendered_sets(7, 3, ("paper", "cvn", "paper"), 5, "200..900", (50.0, 60.0), 40.0)
    assert [(item.name, len(item)) for item in sets] == [
        ("rendered paper", 7),
        ("rendered cvn", 7),
        ("no runway", 3),
    ]
    assert sets[1].settings["visibility_m"] == [200.0, 900.0]
    assert sets[1].settings["fov_deg"] == 40.0
    assert rendered_sets(0, 3, ("paper",), 5, "clear", None, 40.0)[0].settings["visibility_m"] == ["inf", "inf"]
