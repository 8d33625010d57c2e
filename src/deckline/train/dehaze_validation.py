"""What follows the training of a dehazer: figures on held-out views, and the ONNX file."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from deckline.dehaze.network import image_to_tensor, tensor_to_image
from deckline.evaluation.metrics import psnr_db, ssim
from deckline.haze import add_haze, beta_from_visibility
from deckline.train.dehaze_samples import geometry_prior, random_airlight
from deckline.train.dehaze_views import ClearView
from deckline.train.export import export_onnx, network_cost
from deckline.train.views import Views

VALIDATION_VISIBILITY_M = (500.0, 3000.0)  # uniform; the range that the project's mark is set for
VALIDATION_VIEWS = 120  # at most, spread over the held-out ones
HORIZON_SHARE = 1.0  # of the airlights: haze by day has the colour of the sky at the horizon
BEST_PSNR_DB = 60.0  # stands in means for the infinite PSNR of a view that comes out untouched


@torch.no_grad()
def validate(model: nn.Module, views: Views[ClearView], seed: int, prior: bool = False) -> dict[str, float]:
    """PSNR (dB) and SSIM on whole held-out views, hazy as they come and dehazed; PSNR without the sky; PSNR on
    haze-free views. A network that takes a prior is measured without one; its PSNR also with one.

    Haze depends on `seed` and the view alone, so that runs can be compared.
    """
    was_training = model.training
    model.eval()
    rows = []
    for index in views.spread(VALIDATION_VIEWS):
        view = views.get_usable(index)
        if view is not None:
            rows.append(_figures(model, view, np.random.default_rng([seed, index]), prior))
    model.train(was_training)
    if not rows:
        raise ValueError(f"no held-out frame can be used: {views.skipped}")
    means = {name: float(np.mean([min(row[name], BEST_PSNR_DB) for row in rows])) for name in rows[0]}
    return {**means, "views": float(len(rows))}


def _figures(model: nn.Module, view: ClearView, rng: np.random.Generator, prior: bool) -> dict[str, float]:
    """Figures of one view."""
    clear = view.clear_rgb
    airlight = random_airlight(view.horizon_rgb, HORIZON_SHARE, rng)
    hazy = add_haze(clear, view.range_m, beta_from_visibility(rng.uniform(*VALIDATION_VISIBILITY_M)), airlight)
    surface = np.isfinite(view.range_m)  # sea and ship

    def surface_psnr_db(image: NDArray[np.uint8]) -> float:
        return psnr_db(image[surface][None], clear[surface][None])

    dehazed = _dehaze(model, hazy, hazy if prior else None)
    figures = {
        "psnr_db_hazy.mean": psnr_db(hazy, clear),
        "psnr_db.mean": psnr_db(dehazed, clear),
        "psnr_db_clear_air.mean": psnr_db(_dehaze(model, clear, clear if prior else None), clear),
        "psnr_db_surface_hazy.mean": surface_psnr_db(hazy),
        "psnr_db_surface.mean": surface_psnr_db(dehazed),
        "ssim_hazy.mean": ssim(hazy, clear),
        "ssim.mean": ssim(dehazed, clear),
    }
    if prior:
        with_prior = _dehaze(model, hazy, geometry_prior(view, hazy, rng))
        figures["psnr_db_with_prior.mean"] = psnr_db(with_prior, clear)
        figures["psnr_db_surface_with_prior.mean"] = surface_psnr_db(with_prior)
    return figures


def export_dehaze(
    model: nn.Module, path: Path, network: dict[str, Any], working_long_side_px: int, recipe: dict[str, Any], step: int
) -> Path:
    """Write the network as ONNX with dynamic height and width; recipe and network config go into the metadata.

    Args:
        model: takes an image (1, 3, H, W), and a working image where `network` has an `unshuffle` above 1, of six
            channels where it has a `prior`.
        path: of the file.
        network: what the model was built from; its `unshuffle` is 1 for every network at full resolution.
        working_long_side_px: the size of images that it was trained on.
        recipe: of the training.
        step: how many were trained.

    A coarse network's file takes a working image whose sides are multiples of `unshuffle`, and an image larger by a
    whole factor; OnnxDehazer pads images to that. A full-resolution network's file takes any size.
    """
    coarse, prior = network["unshuffle"] > 1, network.get("prior", False)
    device = next(model.parameters()).device
    dynamic = {"image": {2: "height", 3: "width"}, "clear": {2: "height", 3: "width"}}
    args = [torch.rand(1, 3, 128, 192, device=device)]
    if coarse:
        dynamic["working"] = {2: "working_height", 3: "working_width"}
        args.append(torch.rand(1, 6 if prior else 3, 64, 96, device=device))
    cost = network_cost(model, channels=(3, 6) if prior else (3,))
    metadata = {
        "kind": "dehaze",
        "network": network,
        "parameters": cost.parameters,
        "macs_256": cost.macs,
        "working_long_side_px": working_long_side_px,
        "recipe": recipe,
        "step": step,
    }
    names = ["image", "working"] if coarse else ["image"]
    return export_onnx(model, tuple(args), path, names, ["clear"], dynamic, metadata)


def _dehaze(model: nn.Module, image_rgb: NDArray[np.uint8], prior_rgb: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    """An image through the network; `prior_rgb` for one that takes a prior."""
    device = next(model.parameters()).device
    hazy = torch.from_numpy(image_to_tensor(image_rgb)).to(device)
    if prior_rgb is None:
        restored = model(hazy)
    else:
        prior = torch.from_numpy(image_to_tensor(prior_rgb)).to(device)
        restored = model(prior, torch.cat([hazy, prior], 1))
    return tensor_to_image(restored.float().cpu().numpy())
