"""Budget, learning rate and averaged weights, as functions of how much of a run is done."""

import math

import torch
from torch import Tensor, nn


def fraction_done(step: int, steps: int, seconds: float, minutes: float | None) -> float:
    """Share of the budget that is used, whichever of steps and training time is further; 1 is the end."""
    by_time = 0.0 if minutes is None else seconds / (60 * minutes)
    return min(1.0, max(step / steps, by_time))


def learning_rate(fraction: float, peak: float, end: float, warm_up: float) -> float:
    """Linear warm-up over the first `warm_up` of the run, then half a cosine from `peak` to `end`.

    A function of the fraction alone, so that budgets in minutes and resumed runs follow the same curve.
    """
    if fraction < warm_up:
        return peak * max(fraction / warm_up, 0.01)
    along = (fraction - warm_up) / (1 - warm_up)
    return end + (peak - end) * (1 + math.cos(math.pi * min(along, 1.0))) / 2


@torch.no_grad()
def averaged(ema: dict[str, Tensor], model: nn.Module, decay: float, step: int) -> None:
    """Move the averaged weights towards the model's, in place; early steps count more so that they start unbiased."""
    keep = min(decay, (1 + step) / (10 + step))
    for name, value in model.state_dict().items():
        if value.dtype.is_floating_point:
            ema[name].lerp_(value, 1 - keep)
        else:
            ema[name].copy_(value)
