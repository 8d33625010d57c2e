"""The film of a landing: the pilot's view, the deck's, one from behind the aircraft, and the guidance below."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deckline.report import draw
from deckline.report.annotators import resize
from deckline.report.draw import Image, draw_tag, measure_text
from deckline.report.instrument import BAND, draw_instrument
from deckline.report.overlay import HEADER_PX, PANEL_PX, draw_panel
from deckline.report.video import VideoPiece
from deckline.types import DepthMode, Guidance, Status
from deckline_sim.landing.film_views import TakePicture, chase_view, deck_view, draw_outside, pilot_view
from deckline_sim.landing.landing import Landing, Sample
from deckline_sim.landing.recorded_sight import PilotPicture
from deckline_sim.landing.summary import describe_outcome
from deckline_sim.landing.surroundings import Surroundings, frame_name
from deckline_sim.landing.touchdown import Outcome

FILM_HZ = 10.0
HELD_S = 1.5  # that the last picture is shown for
ROW_PX = HEADER_PX + PANEL_PX[1]
FILM_PX = (2 * PANEL_PX[0], 2 * ROW_PX + BAND[1])  # width, height
TAG_PX = 20  # height of the outcome's letters
DARK = (8, 20, 16)  # ink on light tags
GOOD = {Outcome.WIRE: (draw.GOOD, DARK), Outcome.WAVE_OFF: (draw.CAUTION, DARK), Outcome.BOLTER: (draw.CAUTION, DARK)}
BAD = (draw.FLAG, draw.INK)
LATE_S = 1e-6  # times this much apart are the same


@dataclass(frozen=True, eq=False)
class FilmedLanding:
    """What a film shows."""

    scene: Surroundings
    """In which it was flown."""
    landing: Landing
    """How it went."""
    answers: Sequence[Guidance]
    """All answers of the picture, in order of time."""
    last_seen_s: float
    """When the last picture was taken, s."""
    pictures: Sequence[PilotPicture] = ()
    """The camera's, in order of time; empty: the pilot's view is rendered for the film."""


def write_film(filmed: FilmedLanding, take: TakePicture, path: Path) -> int:
    """Write the film, an MP4 file of `FILM_PX`; returns its number of pictures.

    Args:
        filmed: the landing.
        take: renders a view, as `ShipSimulator.flown_frame`; the pilot's view without haze is in its frame's truth.
        path: of the file, which is written anew.
    """
    count = 0
    with closing(VideoPiece(path, FILM_PX)) as piece:
        for image, time_s in draw_film(filmed, take):
            piece.add(image, time_s)
            count += 1
    return count


def draw_film(filmed: FilmedLanding, take: TakePicture) -> Iterator[tuple[Image, float]]:
    """Pictures (H, W, 3) and their times, s; the last one is repeated for `HELD_S`."""
    samples = film_samples(filmed.landing.samples)
    for sample in samples[:-1]:
        image = draw_moment(filmed, sample, take)
        if is_broken_off(filmed, sample.time_s):
            _draw_tag(image, f"Wave-off, {filmed.landing.wave_off}", *GOOD[Outcome.WAVE_OFF])
        yield image, sample.time_s
    image = draw_moment(filmed, samples[-1], take)
    _draw_outcome(image, filmed.landing)
    for held in range(round(HELD_S * FILM_HZ) + 1):
        yield image, samples[-1].time_s + held / FILM_HZ


def film_samples(samples: Sequence[Sample]) -> list[Sample]:
    """The samples at `FILM_HZ`, and the last one."""
    times = [sample.time_s for sample in samples]
    wanted = np.arange(times[0], times[-1] - 0.5 / FILM_HZ, 1 / FILM_HZ)
    return [*(samples[bisect_right(times, time_s + LATE_S) - 1] for time_s in wanted), samples[-1]]


def draw_moment(filmed: FilmedLanding, sample: Sample, take: TakePicture) -> Image:
    """The picture of one moment of the film, (H, W, 3)."""
    scene = filmed.scene
    deck, chase = (draw_outside(scene, sample, view(scene, sample), take) for view in (deck_view, chase_view))
    outside = (("DECK", "beside the touchdown point", deck), ("CHASE", "behind the aircraft", chase))
    image = draw.blank(*FILM_PX)
    for number, (title, words, picture) in enumerate((*_pilot_panels(filmed, sample, take), *outside)):
        row, column = divmod(number, 2)
        draw_panel(image, picture, (column * PANEL_PX[0], row * ROW_PX), title, words)
    image[2 * ROW_PX :] = draw_instrument(shown_answer(filmed, sample.time_s))
    return image


def _pilot_panels(filmed: FilmedLanding, sample: Sample, take: TakePicture) -> list[tuple[str, str, Image]]:
    """Title, words and picture of the two upper panels."""
    time = f"{sample.time_s:.1f} s"
    taken = [picture.time_s for picture in filmed.pictures]
    if taken:
        number = max(bisect_right(taken, sample.time_s + LATE_S) - 1, 0)
        hazy, marked = filmed.pictures[number].images()
        return [("HAZY", f"as the camera saw it  ·  {time}", hazy), ("DEHAZED", "with the lines found", marked)]
    frame = take(pilot_view(filmed.scene, sample), frame_name(filmed.scene.seed, sample.time_s))
    clear = frame.image_rgb if frame.truth is None or frame.truth.clear_rgb is None else frame.truth.clear_rgb
    return [
        ("HAZY", f"as the camera would see it  ·  {time}", resize(frame.image_rgb, PANEL_PX)),
        ("WITHOUT HAZE", "the same view", resize(clear, PANEL_PX)),
    ]


def shown_answer(filmed: FilmedLanding, time_s: float) -> Guidance:
    """The newest answer that has arrived; nothing seen before the first one, and after the pass was broken off."""
    arrived = [answer.time_s + filmed.scene.config.camera.latency_s for answer in filmed.answers]
    number = bisect_right(arrived, time_s + LATE_S) - 1
    if number < 0 or is_broken_off(filmed, time_s):
        return Guidance(time_s, Status.NOT_SEEN, DepthMode.NONE)
    return filmed.answers[number]


def is_broken_off(filmed: FilmedLanding, time_s: float) -> bool:
    """Whether the pass has been broken off: no picture is taken any more."""
    camera = filmed.scene.config.camera
    return filmed.landing.wave_off is not None and time_s > filmed.last_seen_s + 1 / camera.rate_hz


def _draw_outcome(image: Image, landing: Landing) -> None:
    colours = GOOD.get(landing.outcome, BAD)
    words = describe_outcome(landing)
    _draw_tag(image, words[0].upper() + words[1:], *colours)


def _draw_tag(image: Image, words: str, colour: draw.Colour, ink: draw.Colour) -> None:
    """A tag in the middle, below the views from outside."""
    left = (FILM_PX[0] - measure_text(words, TAG_PX, 600) - TAG_PX) // 2
    draw_tag(image, words, (left, 2 * ROW_PX - round(TAG_PX * 2.2)), TAG_PX, colour, ink)
