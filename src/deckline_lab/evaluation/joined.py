"""`deckline eval joined`: what one view of several frames sees of a runway in haze that one frame does not."""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import Engine
from deckline.detect import DETECTORS, SearchingDetector
from deckline.detect.crop import sample_crop
from deckline.detect.joined import FrameStack, view_joined
from deckline.detect.motion import DeckMotion
from deckline.detect.prior import project_prior
from deckline.detect.search import CropView
from deckline.haze import beta_from_visibility, blend_airlight, transmission
from deckline.types import SIDES, Frame, RunwayPrior
from deckline_lab.evaluation.metrics import distance_px
from deckline_lab.evaluation.tables import TO_TERMINAL, Figures, Output, Table, number, publish
from deckline_lab.evaluation.visible_distance import RIGHT_PX
from deckline_sim.config import DepthConfig, MotionConfig, SensorConfig, SimConfig

SPAN_M = 35.0  # flown from the first to the last frame of an approach
SIZE = (640, 360)  # of the pictures, px: the middle of 1280x720 px of 90 degrees
FOV_DEG = float(np.rad2deg(2 * np.arctan(0.5)))
SEED = 1000  # of the first approach
HAZED = 51  # random stream
BESIDE_M = (-200.0, -100.0, 100.0, 200.0)  # of boxes without a runway, right of it
# Sea state, pose noise in px; None: no pose.
CASES: dict[str, tuple[float, float | None]] = {
    "still": (0.0, 0.0),
    "1 px of jitter": (0.0, 1.0),
    "pitching deck": (5.0, 0.0),
    "still, no pose": (0.0, None),
    "pitching deck, no pose": (5.0, None),
}
BESIDE_CASES = ("still", "still, no pose")  # in which boxes beside the ship are viewed
NOTES = """\
told where the runway is. right: both lines within 3 px in the median. error: of both lines' points, the median of
right answers. beside: boxes 100 and 200 m left and right of the runway in which both lines are seen. joined: as a
flight takes it, in addition to the view of the newest frame. passes: processor time of a joined
view, in views of one frame. pitching deck: sea state 5."""


@dataclass(frozen=True, eq=False)
class Answer:
    """One approach's last frame."""

    errors_px: tuple[float | None, float | None]  # of one frame and of the joined ones; None: not seen
    false: tuple[int, int]  # boxes beside the ship
    passes: float  # processor time of the joined view, in views of one frame


def joined(
    approaches: int = 12,
    frames: int = 8,
    visibility: tuple[float, ...] = (3000.0, 2000.0, 1500.0, 1000.0),
    noise: float = 2.0,
    range_m: float = 1235.0,
    figure: Path | None = None,
    output: Output = TO_TERMINAL,
) -> int:
    """Measure what several frames joined show of a carrier, with still and moving deck and pose noise.

    Args:
        approaches: how many, each with its own light and sea.
        frames: of each, over 35 m.
        visibility: metres at 2 % contrast.
        noise: 1-sigma of the camera's noise, grey levels.
        range_m: of the ramp in the last frame, m.
        figure: write a picture of one frame, the joined ones and the view without haze, one row a visibility.
        output: files of the results.
    """
    if approaches < 1 or frames < 2:
        raise ValueError(f"--approaches must be 1 or more and --frames 2 or more, got {approaches} and {frames}")
    if not range_m > 0:
        raise ValueError(f"--range-m must be positive, got {range_m:g}")
    detector = DETECTORS["hybrid"](Engine(threads=1))
    assert isinstance(detector, SearchingDetector)
    rendered = {sea: [_render(SEED + k, frames, sea, range_m) for k in range(approaches)] for sea in (0.0, 5.0)}
    rows, figures = [], Figures()
    for metres in visibility:
        for case, (sea, jitter_px) in CASES.items():
            flights = [_hazed(clear, metres, noise, jitter_px, k) for k, clear in enumerate(rendered[sea])]
            answers = [_answer(detector, flight, case in BESIDE_CASES) for flight in flights]
            found = _summary(answers)
            figures |= {f"{metres:g}.{case}.{name}": value for name, value in found.items()}
            rows.append((f"{metres:g} m", case, *(number(value, _form(name)) for name, value in found.items())))
    columns = ("visibility", "", *found)
    flown = f"{frames} frames from {range_m + SPAN_M:g} to {range_m:g} m"
    title = f"preset cvn, {approaches} approaches, {flown}, noise {noise:g}"
    publish(title, [Table("one frame and several", columns, rows)], figures, output, [NOTES])
    if figure is not None:
        _draw(detector, [_hazed(rendered[0.0][0], metres, noise, 0.0, 0) for metres in visibility], figure)
    return 0


def _render(seed: int, frames: int, sea_state: float, range_m: float) -> list[Frame]:
    """An approach with its clear pictures and the depth of every pixel, without noise."""
    from deckline_sim.simulate import ShipSimulator  # needs OpenGL

    config = SimConfig(
        preset="cvn",
        frames=frames,
        seed=seed,
        visibility_m=(3000.0, 3000.0),
        width=SIZE[0],
        height=SIZE[1],
        fov_deg=FOV_DEG,
        start_m=range_m + SPAN_M,
        end_m=range_m,
        motion=MotionConfig(sea_state),
        depth=DepthConfig(float("inf")),
        sensor=SensorConfig(noise=0.0, electrons=0),
    )
    with ShipSimulator(config) as simulator:
        return [simulator.frame(index) for index in range(frames)]


def _hazed(clear: list[Frame], visibility_m: float, noise: float, jitter_px: float | None, number: int) -> list[Frame]:
    """The frames in haze, with noise, and poses that err in pitch and yaw, or none; the truth has the exact ones."""
    found = []
    for index, frame in enumerate(clear):
        truth, pose = frame.truth, frame.world_from_body
        assert truth is not None and truth.clear_rgb is not None and frame.depth_m is not None and pose is not None
        rng = np.random.default_rng([SEED + number, index, int(visibility_m), HAZED])
        range_m = np.nan_to_num(frame.depth_m * frame.camera.ray_lengths(), nan=np.inf)
        t = transmission(range_m, beta_from_visibility(visibility_m))[..., None]
        hazy = blend_airlight(truth.clear_rgb.astype(np.float32), np.asarray(truth.airlight_rgb, np.float32), t)
        image = np.clip(np.rint(hazy + rng.normal(0.0, noise, hazy.shape)), 0, 255).astype(np.uint8)
        noisy = None
        if jitter_px is not None:
            turn = Rotation.from_rotvec(rng.normal(0.0, jitter_px / frame.camera.fx, 3) * [0.0, 1.0, 1.0])
            noisy = RigidTransform.from_components(pose.translation, pose.rotation * turn)
        known = replace(truth, world_from_body=pose)
        found.append(replace(frame, image_rgb=image, world_from_body=noisy, depth_m=None, truth=known))
    return found


def _answer(detector: SearchingDetector, flight: list[Frame], with_beside: bool) -> Answer:
    runway, newest, stack = _true_runway(flight[-1]), flight[-1], FrameStack(len(flight))
    for frame in flight:
        stack.add(frame, frame.image_rgb)
    one, several, passes = _look(detector, newest, stack, runway)
    beside = [_look(detector, newest, stack, _moved(runway, metres)) for metres in BESIDE_M if with_beside]
    false = tuple(sum(look[k] is not None for look in beside) for k in (0, 1))
    return Answer((_error_px(one, newest), _error_px(several, newest)), (false[0], false[1]), passes)


def _look(
    detector: SearchingDetector, newest: Frame, stack: FrameStack, runway: RunwayPrior
) -> tuple[CropView | None, CropView | None, float]:
    """Both views of a place, of one frame and joined, and the processor time of the joined one in single ones."""
    box = project_prior(replace(newest, world_from_body=newest.true_world_from_body), runway)
    if box is None:
        return None, None, float("nan")
    motion = None if newest.world_from_body is None else DeckMotion(runway, np.zeros(2))
    search = detector.start_search(newest.image_rgb)
    one, start = search.search_prior(box), time.process_time()
    several, middle = view_joined(search, box, stack, motion), time.process_time()
    search.view_crop(search.crops[-1])
    return one, several, (middle - start) / (time.process_time() - middle)


def _true_runway(frame: Frame) -> RunwayPrior:
    assert frame.truth is not None and frame.truth.left is not None and frame.truth.right is not None
    left, right = (np.stack([line.p0_m, line.p1_m]) for line in (frame.truth.left, frame.truth.right))
    return RunwayPrior(left, right, 0.0, 0.0)


def _moved(runway: RunwayPrior, right_m: float) -> RunwayPrior:
    across = runway.right_m[0] - runway.left_m[0]
    step = right_m * across / np.linalg.norm(across)
    return replace(runway, left_m=runway.left_m + step, right_m=runway.right_m + step)


def _error_px(view: CropView | None, frame: Frame) -> float | None:
    """The larger of both lines' median errors."""
    pose = frame.true_world_from_camera
    if view is None or frame.truth is None or pose is None:
        return None
    medians = []
    for side in SIDES:
        line = getattr(frame.truth, side)
        along = line.p0_m + np.linspace(0.0, 1.0, 65)[:, None] * (line.p1_m - line.p0_m)
        true = frame.camera.project(pose.inv().apply(along))
        medians.append(float(np.median(distance_px(getattr(view.lines, side).points_px, true, frame.camera))))
    return max(medians)


def _summary(answers: list[Answer]) -> Figures:
    figures = Figures()
    for k, name in enumerate(("one", "joined")):
        right = [e for e in (answer.errors_px[k] for answer in answers) if e is not None and e <= RIGHT_PX]
        seen = sum(answer.errors_px[k] is not None for answer in answers)
        figures |= {f"{name}: right": float(len(right)), f"{name}: wrong": float(seen - len(right))}
        figures[f"{name}: error px"] = float(np.median(right)) if right else float("nan")
        figures[f"{name}: beside"] = float(sum(answer.false[k] for answer in answers))
    figures["joined: passes"] = float(np.median([answer.passes for answer in answers]))
    return figures


def _form(name: str) -> str:
    return ".2f" if name.endswith("px") else ".1f" if name.endswith("passes") else ".0f"


def _draw(detector: SearchingDetector, flights: list[list[Frame]], path: Path) -> None:
    """One frame, the joined ones and the clear view in the crop of the look, each stretched, a row a flight."""
    rows = []
    for flight in flights:
        newest, stack, runway = flight[-1], FrameStack(len(flight)), _true_runway(flight[-1])
        for frame in flight:
            stack.add(frame, frame.image_rgb)
        search, size = detector.start_search(newest.image_rgb), (512, 288)
        box = project_prior(newest, runway)
        assert box is not None and newest.truth is not None and newest.truth.clear_rgb is not None
        search.search_prior(box)
        several = stack.join(search.crops[-1], size, DeckMotion(runway, np.zeros(2)))
        one, clear = (
            sample_crop(image, search.crops[-1], size) for image in (newest.image_rgb, newest.truth.clear_rgb)
        )
        rows.append(np.hstack([_stretch(p) for p in (one, one if several is None else several.pixels, clear)]))
    cv2.imwrite(str(path), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])


def _stretch(pixels: NDArray[np.float32]) -> NDArray[np.uint8]:
    shown = np.nan_to_num(pixels - np.nanmean(pixels, axis=(0, 1)))  # as the network sees it: without airlight's colour
    low, high = np.percentile(shown, [0.5, 99.5])
    return np.clip(255 * (shown - low) / max(high - low, 1e-6), 0, 255).astype(np.uint8)
