"""Which models run, on what they are computed, and how the stages use what they find."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from deckline.checks import check_choice, check_numbers

Mode = Literal["auto", "fine", "coarse"]
Picture = Literal["hazy", "dehazed"]
Device = Literal["cpu", "openvino", "cuda", "tensorrt"]
Precision = Literal["f32", "bf16"]


@dataclass(frozen=True)
class Models:
    """Which dehazer and detector run; a name of the shipped ones or the path of an ONNX file.

    Args:
        dehazer: of the pictures for people.
        strength: of the dehazing, 0 (the picture as it is) to 1.
        detector: of the lines.
        detect_in: the picture that the detector sees. `dehazed` is the published chain; the shipped detector was
            trained on haze and finds more in the hazy picture.
        join_frames: pictures of a flight averaged for a second view where one alone is not sure; 1: no such view.
        camera_height_m: above the water, of pictures without a pose or a height; with it their visibility is in metres.
        visibility: measure the visibility of every frame for its record; the chain then dehazes each frame, at 640 px.
    """

    dehazer: str = "coarse-t"
    detector: str = "hybrid"
    detect_in: Picture = "hazy"
    join_frames: int = 8
    strength: float = 1.0
    camera_height_m: float | None = None
    visibility: bool = False

    def __post_init__(self) -> None:
        check_choice("models.detect_in", self.detect_in, Picture)
        check_numbers(self, "models", "camera_height_m", above=0.0)
        check_numbers(self, "models", "strength", least=0.0, most=1.0)
        check_numbers(self, "models", "join_frames", least=1)


@dataclass(frozen=True)
class Engine:
    """What computes the networks. Nothing here is chosen by the machine, so that answers do not depend on it silently.

    Args:
        device: `cpu`: ONNX Runtime; `openvino`: OpenVINO on the processor; `cuda`, `tensorrt`: ONNX Runtime on a GPU.
        threads: of the processor; None: one for every core that this process may use.
        precision: of the arithmetic. `bf16` needs OpenVINO and a processor that has it; it is refused on another.
    """

    device: Device = "cpu"
    threads: int | None = None
    precision: Precision = "f32"

    def __post_init__(self) -> None:
        check_choice("engine.device", self.device, Device)
        check_choice("engine.precision", self.precision, Precision)
        check_numbers(self, "engine", "threads", least=1)
        if self.precision == "bf16" and self.device != "openvino":
            raise ValueError(f"engine.precision bf16 needs device openvino, got {self.device}")


CPU = Engine()


@dataclass(frozen=True)
class Localization:
    """How one frame's points become lines in the world.

    Args:
        mode: `fine` demands the depth camera, `coarse` the deck plane. `auto` uses both and calls the frame fine when
            most points have a depth.
    """

    mode: Mode = "auto"

    def __post_init__(self) -> None:
        check_choice("localization.mode", self.mode, Mode)


@dataclass(frozen=True)
class Tracking:
    """The filter over frames.

    Args:
        enabled: frames are one flight in their order; else every frame is for itself.
        coast_s: time without a line that the track survives, s.
        reacquire_s: time of contradicting lines after which the track begins again, s.
        gate_sigma: standard deviations beyond which a measurement is left out.
        search_s: while the track is sure, its place is viewed, and so often a whole picture is searched beside it,
            over the frames, s; 0: every picture is searched whole at once.
        first_at_once: the first picture, and one after a gap longer than `search_s`, is searched whole at once. In live
            flight it is not: its answer would be late.
        horizon_s: so often the horizon in the picture is compared with the attitude, s; 0: never.
        paint_s: so often the picture is searched for paint under the lines and for a centre line, s; 0: never.
    """

    enabled: bool = True
    coast_s: float = 2.0
    reacquire_s: float = 1.0
    gate_sigma: float = 5.0
    search_s: float = 1.0
    first_at_once: bool = True
    horizon_s: float = 1.0
    paint_s: float = 0.5

    def __post_init__(self) -> None:
        check_numbers(self, "tracking", "search_s", "horizon_s", "paint_s", least=0.0)
        check_numbers(self, "tracking", "coast_s", "reacquire_s", "gate_sigma", above=0.0)


@dataclass(frozen=True)
class PicturePose:
    """What is known of an aircraft whose pose the picture alone gives.

    Args:
        roll_sigma_deg: 1-sigma of its roll about level flight, where no horizon shows it, degrees.
    """

    roll_sigma_deg: float = 5.0

    def __post_init__(self) -> None:
        check_numbers(self, "picture", above=0.0, most=45.0)

    @property
    def roll_sigma_rad(self) -> float:
        return float(np.deg2rad(self.roll_sigma_deg))


@dataclass(frozen=True)
class Integrity:
    """When something is flagged, and what a protection level covers.

    Args:
        risk: that an error without a flag exceeds its protection level, per frame and direction.
        alarm_sigma: standard deviations of a test statistic from which there is a flag.
        missed_sigma: standard deviations more that a fault needs to be noticed for sure; 3.3: 1 in 2000 is missed.
        doubt_risk: significance of the global test of all estimated sensor errors, below which guidance is not `ok`.
        persist_s: a measurement that is left out for so long is a flag, s.
        window_s: over which residuals are judged, s.
        excess: mean squared normalised residual from which there is a flag.
        max_boresight_deg: the largest mounting error of the camera that is thought possible, about each axis, degrees.
        max_deck_z_m: the same of the reported deck height, m. 20: a carrier's deck that was stated as the sea's.
        max_depth_scale: the same of all depths, as a share.
        max_focal_fraction: the same of the focal length, as a share.
        max_delay_s: the same of a pose behind its picture, s.
        max_drift_m_s: the largest sideways speed of the lines that a ship is thought to have, m/s; 3.5: 30 knots along
            a ship whose lines are turned by 13 degrees.
        max_ship_m_s: the largest speed of a ship whose velocity is not stated, m/s; 15.4: 30 knots.
        max_yaw_deg: the largest yaw of a turned camera that a heading's protection level may cover, degrees. Where a
            larger one would not show, the heading has no level.
        mount_yaw_deg: the largest yaw that the mounting can have, as its builder states; None: the drift of the lines
            alone bounds it, and a hovering aircraft shows none.
        max_width_fraction: the largest possible error of the stated width, as a share of it; 4: a fifth is stated.
        max_line_m: the same of a line: another marking beside it, m. Foul lines lie up to 6 m outside the edge lines.
    """

    risk: float = 1e-7
    alarm_sigma: float = 5.0
    missed_sigma: float = 3.3
    doubt_risk: float = 1e-3
    persist_s: float = 0.4
    window_s: float = 1.5
    excess: float = 4.0
    max_boresight_deg: float = 1.0
    max_deck_z_m: float = 20.0
    max_depth_scale: float = 0.03
    max_focal_fraction: float = 0.005
    max_delay_s: float = 0.2
    max_drift_m_s: float = 3.5
    max_ship_m_s: float = 15.4
    max_yaw_deg: float = 10.0
    mount_yaw_deg: float | None = None
    max_width_fraction: float = 4.0
    max_line_m: float = 6.0

    def __post_init__(self) -> None:
        check_numbers(self, "integrity", above=0.0)
        check_numbers(self, "integrity", "risk", "doubt_risk", below=1.0)
