from dataclasses import replace

import numpy as np
import pytest
from moderngl import InvalidObject
from refused import refuse

from approach_scene import LEFT, RIGHT, frame
from deckline.cli.main import main
from deckline.config import Deck
from deckline.flight import Flight
from deckline.options import RunOptions
from deckline_lab.evaluation import integrity_score
from deckline_lab.evaluation.approaches import FlightsConfig, Sighting
from deckline_lab.evaluation.integrity_faults import FAULTS, Runs, inject
from deckline_lab.evaluation.integrity_films import film
from deckline_lab.evaluation.integrity_paint import PAINT_LEVEL, draw_boxes, erase, paint
from deckline_lab.evaluation.integrity_runs import RENDERED_AIDS
from deckline_lab.evaluation.integrity_score import FaultRun, fly_run, inject_run
from deckline_lab.evaluation.integrity_sensors import offset_line
from deckline_lab.rivals.catalog import flight_from_config
from deckline_sim.scene import gl

ONSET_S = 0.6  # between the third and the fourth frame
RENDERED = [name for name, fault in FAULTS.items() if Runs.RENDERED in fault.runs]
OPTIONS = RunOptions(dehazer="none", detector="classical", sea_state=0.0)
FLIGHTS = FlightsConfig(frames=6, range_m=(150.0, 60.0), options=OPTIONS)


def flight():
    """Six frames, a quarter of a second and 15 m apart, each with grain of its own."""
    rng = np.random.default_rng(0)
    frames = [frame(k, 150.0 - 15.0 * k) for k in range(6)]
    return [
        replace(at, image_rgb=rng.integers(0, 256, at.image_rgb.shape, np.uint8), sea_z_m=-2.0, depth_m=None)
        for at in frames
    ]


def injected(name, frames=None):
    sightings = map(Sighting, frames or flight())
    found = list(inject(sightings, FAULTS[name], ONSET_S, np.random.default_rng(3)))
    return [at.frame for at, _ in found], [faulty for _, faulty in found]


@pytest.mark.parametrize("name", RENDERED)
def test_every_fault_begins_when_it_should_and_leaves_its_frames_as_they_were(name):
    whole = flight()
    before = [at.image_rgb.copy() for at in whole]
    frames, faulty = injected(name, whole)
    onset = 3 if FAULTS[name].sudden else 0
    assert faulty == [False] * onset + [True] * (len(frames) - onset)
    assert all(at is known for at, known in zip(frames[:onset], whole, strict=False))
    assert all(np.array_equal(at.image_rgb, image) for at, image in zip(whole, before, strict=True))
    assert [at.time_s for at in frames] == sorted(at.time_s for at in frames)
    for at in frames:  # the truth stays
        true = whole[round(at.time_s / 0.25)].world_from_body
        np.testing.assert_allclose(at.true_world_from_body.translation, true.translation)


def test_pictures_and_poses_match_their_names():
    whole = flight()
    mirrored, _ = injected("mirrored picture")
    assert np.array_equal(mirrored[0].image_rgb, whole[0].image_rgb[:, ::-1])
    stalled, _ = injected("stalled picture")
    assert all(np.array_equal(at.image_rgb, whole[3].image_rgb) for at in stalled[3:])
    still = [at.world_from_body.translation[0] for at in injected("stalled picture and pose")[0]]
    np.testing.assert_allclose(still, [-150, -135, -120, -105, -105, -105])
    swapped = [at.world_from_body.translation[0] for at in injected("swapped poses")[0]]
    np.testing.assert_allclose(swapped, [-150, -135, -120, -90, -105])
    late = [at.world_from_body.translation[0] for at in injected("pose late by 0.2 s")[0]]
    np.testing.assert_allclose(late[3:], [-105, -102, -87])  # the first on time, then 0.2 s at 60 m/s behind -90, -75
    assert 3 <= len(injected("dropped frames")[0]) < 6


def test_the_deck_and_the_mount_are_reported_wrong():
    heights = {name: injected(name)[0][0].deck_z_m for name in RENDERED if name.startswith("deck")}
    assert heights == {"deck height -10 m": -30.0, "deck height of the sea": -2.0, "deck height, wrong sign": 20.0}
    mounts = {name: injected(name)[0][0].body_from_camera.rotation for name in RENDERED if name.startswith("mount")}
    turns = [(turn * frame().body_from_camera.rotation.inv()).as_rotvec(degrees=True) for turn in mounts.values()]
    expected = [[0, 0, 1.5], [0, 0, 5], [0, 0, 8], [0, 0, 12], [0, 3, 0]]
    np.testing.assert_allclose(np.abs(turns), expected, atol=1e-9)


def test_a_painted_line_lies_where_it_projects_and_fades_in_haze():
    at = replace(frame(0, 60.0), truth=replace(frame().truth, airlight_rgb=(90.0, 90.0, 90.0)))
    line = offset_line(RIGHT, 4.0, 0.0)
    ends = at.camera.project(at.world_from_camera.inv().apply([line.p0_m, line.p1_m]))
    u, v = np.rint(ends[0] + 0.05 * (ends[1] - ends[0])).astype(int)
    clear = paint(at, line).image_rgb
    assert clear[v, u, 0] == PAINT_LEVEL
    changed = np.argwhere(np.any(clear != at.image_rgb, axis=2))
    assert np.all(np.abs(changed[:, 0] - v) <= abs(ends[1, 1] - ends[0, 1]) + 3)
    assert len(changed) < 0.05 * at.image_rgb[..., 0].size
    hazy = paint(replace(at, truth=replace(at.truth, visibility_m=100.0)), line).image_rgb
    assert 90 < hazy[v, u, 0] < 120
    with pytest.raises(ValueError, match=r"frame_000\.png"):
        paint(replace(at, truth=None), LEFT)


def test_an_erased_line_is_gone_and_a_box_on_the_deck_hides_it():
    plain = replace(frame(0, 60.0), image_rgb=np.full_like(frame(0, 60.0).image_rgb, 90))
    painted = paint(plain, RIGHT)
    bare = erase(painted, RIGHT, 2.0, -2.5)
    lit, left_over = (np.count_nonzero(at.image_rgb > 100) for at in (painted, bare))
    assert left_over < 0.1 * lit  # far off, where a pixel is wider than the deck beside the line
    hidden = draw_boxes(painted, RIGHT, [(0.5, 0.0)], (12.0, 6.0, 4.0), 20.0)
    v, u = np.argwhere(hidden.image_rgb[..., 0] == 20).mean(axis=0)
    middle = plain.world_from_camera.inv().apply([(RIGHT.p0_m + RIGHT.p1_m) / 2 - [0.0, 0.0, 2.0]])
    np.testing.assert_allclose([u, v], plain.camera.project(middle)[0], atol=3.0)
    behind_the_camera = draw_boxes(painted, RIGHT, [(-2.0, 0.0)], (12.0, 6.0, 4.0), 20.0)
    np.testing.assert_array_equal(behind_the_camera.image_rgb, painted.image_rgb)
    two = draw_boxes(painted, RIGHT, [(0.5, 0.0), (0.5, -5.0)], (12.0, 4.0, 4.0), 20.0)
    assert np.argwhere(two.image_rgb[..., 0] == 20)[:, 1].mean() < u  # the second one is left of the first


def test_faults_of_the_paint_change_what_they_name():
    def lit(name):
        marked = [
            paint(paint(replace(at, image_rgb=np.full_like(at.image_rgb, 60)), LEFT), RIGHT) for at in flight()[-1:]
        ]
        return [np.count_nonzero(at.image_rgb[..., 0] > 150) for at in (marked[-1], injected(name, marked)[0][-1])]

    for name in ("extra line", "crossing line", "second runway", "glare"):
        assert np.greater(*reversed(lit(name))), name
    for name in ("edge lost", "edges under rubber", "aircraft on an edge", "people on the edges"):
        assert np.less(*reversed(lit(name))), name


def test_rain_falls_anew_in_every_frame_its_drops_on_the_lens_stay_and_a_flight_has_one_context(monkeypatch):
    contexts, build = [], gl.open_context
    monkeypatch.setattr(gl, "open_context", lambda: contexts.append(build()) or contexts[-1])
    picture = np.full_like(flight()[0].image_rgb, 30)
    picture[: len(picture) // 2] = 220  # of the sky, whose light streaks throw into the camera
    rainy, _ = injected("rain", [replace(at, image_rgb=picture) for at in flight()])
    changed = [np.abs(at.image_rgb.astype(int) - picture).max(axis=2) > 2 for at in rainy]
    always, ever = np.logical_and.reduce(changed), np.logical_or.reduce(changed)
    assert 0 < always.sum() < 0.8 * ever.sum() and ever.mean() < 0.5
    (context,) = contexts
    assert isinstance(context.mglo, InvalidObject)  # released with the flight


def test_a_flight_has_width_and_depth_only_with_that_aid(monkeypatch):
    models = flight_from_config(OPTIONS.run_config())
    flown = []
    build = Flight.from_config

    def record(config, **loaded):
        inner = build(config, **loaded)
        return lambda at, **given: (flown.append((config.deck, at.depth_m is not None)), inner(at, **given))[1]

    monkeypatch.setattr(integrity_score.Flight, "from_config", record)
    deep = [Sighting(replace(at, depth_m=np.full(at.image_rgb.shape[:2], 50.0, np.float32))) for at in flight()]
    for aid in RENDERED_AIDS:
        states = fly_run(deep, FaultRun("mirrored picture", 0, aid), FLIGHTS, models)
        assert len(states) == 6 and all(state.faulty for state in states)
    seen = [(deck.width_m, depth) for deck, depth in flown[::6]]
    assert seen == [(None, False), (None, True), (pytest.approx(16.0), False), (pytest.approx(16.0), True)]
    assert flown[0][0] == Deck(sea_state=0.0)


def test_the_rendered_campaign_resumes_and_has_a_row_for_every_fault_and_aid(tmp_path, capsys, monkeypatch):
    rendered = []
    monkeypatch.setattr(
        "deckline_lab.evaluation.integrity_runs.fly", lambda _, number: rendered.append(number) or flight()
    )
    words = ["eval", "integrity", "--rendered", "--frames", "6", "--range-m", "150", "60", "--dehazer", "none"]
    words += ["--detector", "classical", "--runs", "1", "--nominal", "2", "--out", str(tmp_path), "--fault"]
    assert main([*words, "stalled picture", "--aid", "no aid", "depth, width"]) == 0
    printed = capsys.readouterr().out
    assert all(f"{name}; {aid}" in printed for name in ("stalled picture", "nominal") for aid in ("no aid", "depth"))
    assert rendered == [0, 1]
    films = tmp_path / "films"
    assert main([*words, "stalled picture", "--aid", "no aid", "--films", str(films)]) == 0
    assert (rendered, films.exists()) == ([0, 1], False)
    assert "'swapped lines'" in refuse(capsys, *words[1:], "swapped lines")


def test_a_film_shows_what_the_run_saw(tmp_path):
    run, sightings = FaultRun("dropped frames", 1, "no aid"), [Sighting(at) for at in flight()]
    folder = film(sightings, run, FLIGHTS, flight_from_config(OPTIONS.run_config()), tmp_path)
    assert folder == tmp_path / "dropped_frames,_no_aid_1"
    lines = (folder / "guidance.jsonl").read_text().splitlines()
    assert len(lines) == len(list(inject_run(sightings, run, FLIGHTS))) < 6
    assert (folder / "overlay.mp4").stat().st_size > 0
    assert "dropped frames; no aid, approach 1" in (folder / "report.html").read_text()
