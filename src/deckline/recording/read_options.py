"""How to read what a recording does not state itself: the caller's camera, heights and depth format."""

from dataclasses import dataclass

from deckline.checks import check_choice, check_numbers
from deckline.recording.camera_file import MountedCamera
from deckline.recording.images import FAR_DEPTH_M, PfmRows

FOV_RANGE_DEG = (1.0, 170.0)  # of a stated pinhole; narrower and wider ones are typing errors


@dataclass(frozen=True, eq=False)
class ReadOptions:
    """How to read what a recording does not state itself."""

    fov_deg: float | None = None
    """Horizontal field of view, degrees, of a recording without a camera; None: of AirSim's recordings 90."""
    camera: MountedCamera | None = None
    """Given by the user; it goes before the files'."""
    deck_z_m: float | None = None
    """World z (down) of the deck plane, m; None: as the recording states."""
    sea_z_m: float | None = None
    """World z (down) of the water, m; None: as the recording states."""
    pfm_rows: PfmRows = "top-to-bottom"
    """Order of the rows in depth files; the default is AirSim's."""
    far_m: float = FAR_DEPTH_M
    """Stored depths from here on mean that nothing was seen, m."""

    def __post_init__(self) -> None:
        check_numbers(self, "", "fov_deg", least=FOV_RANGE_DEG[0], most=FOV_RANGE_DEG[1])
        check_numbers(self, "", "deck_z_m", "sea_z_m")
        check_choice("pfm_rows", self.pfm_rows, PfmRows)
        if not self.far_m > 0:
            raise ValueError(f"far_m must be > 0 m, got {self.far_m}")
