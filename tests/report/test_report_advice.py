import pytest

from deckline.report.advice import remedy_of
from deckline.types import Reason


@pytest.mark.parametrize(
    ("reason", "option"),
    [
        (Reason.NO_WIDTH, "--runway-width-m"),
        (Reason.NO_HORIZON, "horizon"),
        (Reason.NO_VANISHING_POINT, "lines"),
        (Reason.ASSUMED_CAMERA, "--fov-deg"),
    ],
)
def test_every_reason_of_a_pose_of_the_picture_has_its_remedy(reason, option):
    assert option in remedy_of(reason)
