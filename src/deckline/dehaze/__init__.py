"""Remove haze from an image. Every method is a callable; DEHAZERS names the shipped ones.

cv2 and onnxruntime are imported only when a method that needs them is built or called.
"""

from collections.abc import Callable

from deckline.config import CPU
from deckline.dehaze.base import Dehazer, DehazeResult, IdentityDehazer, restore
from deckline.dehaze.by_horizon import HorizonDehazer
from deckline.dehaze.by_pose import GeometryDehazer, downscale_frame
from deckline.dehaze.display import DISPLAY_PX, dehaze_for_display, dehaze_frame
from deckline.dehaze.onnx_dehazer import OnnxDehazer
from deckline.dehaze.veil import VeilDehazer
from deckline.runtime import shipped_weights

__all__ = [
    "DEHAZERS",
    "DISPLAY_PX",
    "NOT_DEHAZED",
    "DehazeResult",
    "Dehazer",
    "GeometryDehazer",
    "HorizonDehazer",
    "OnnxDehazer",
    "VeilDehazer",
    "dehaze_for_display",
    "dehaze_frame",
    "downscale_frame",
    "restore",
]

NOT_DEHAZED = IdentityDehazer.name

DEHAZERS: dict[str, Callable[..., Dehazer]] = {  # from the `Engine` that computes a network
    NOT_DEHAZED: lambda engine=CPU: IdentityDehazer(),
    "veil": lambda engine=CPU: VeilDehazer(),
    "horizon": lambda engine=CPU: HorizonDehazer(),
    "geometry": lambda engine=CPU: GeometryDehazer(),
    "coarse-t": lambda engine=CPU: OnnxDehazer(
        shipped_weights("coarse-t"), "coarse-t", engine, without_pose=HorizonDehazer()
    ),
}
