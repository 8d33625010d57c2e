"""What one step of a dehazing recipe costs here, and what the recipe needs of a GPU at least.

    python benchmarks/training_step.py published [--batch 1] [--repeats 3]

Pictures are random. On a CUDA device the step is of the recipe's own batch, whatever --batch says.

Memory is that of the tensors that live at once in a step of the recipe's batch, counted without computing. The least
time is the larger of two: the multiplications of a forward and a backward pass (three times the forward ones) at the
published peak rate, and PASSES times the tensors that the forward pass leaves, at the published bandwidth.
"""

import platform
import resource
import statistics
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from deckline.geometry import Camera
from deckline.runtime import describe_processor
from deckline_lab.cli.recipe_flags import make_recipe
from deckline_lab.cli.train_dehaze import NO_FLAGS
from deckline_lab.rivals.dehazers import DEHAZERS
from deckline_lab.train.clear_views import ClearView
from deckline_lab.train.dehaze import NETWORKS, DehazeTrainConfig, dehaze_loss
from deckline_lab.train.dehaze_samples import make_batch
from deckline_lab.train.export import network_cost
from deckline_lab.train.loop import autocast, build_network, select_device
from deckline_lab.train.view_sets import Views

# Float32 TFLOP/s without tensor cores, GB/s and GB; NVIDIA's data sheets of the RTX 4090 and of the H100 (SXM).
GPUS = {"RTX 4090": (82.6, 1008.0, 24.0), "H100": (67.0, 3350.0, 80.0)}
# A tensor is written and read by the forward pass; the backward pass reads it, writes its gradient and reads that.
PASSES = 5
PICTURE_PX = (720, 1280)


class LiveTensors(TorchDispatchMode):
    """Bytes of the tensors made within the context that live, and the most of them."""

    def __init__(self) -> None:
        super().__init__()
        self.bytes = self.most_bytes = 0
        self._known: weakref.WeakSet[torch.UntypedStorage] = weakref.WeakSet()

    def __torch_dispatch__(
        self, function: Any, types: Any, args: Sequence[Any] = (), kwargs: Mapping[str, Any] | None = None
    ) -> Any:
        result = function(*args, **(kwargs or {}))
        for value in tree_leaves(result):
            if isinstance(value, torch.Tensor):
                self._add(value.untyped_storage())
        return result

    def _add(self, storage: torch.UntypedStorage) -> None:
        if storage not in self._known:
            self._known.add(storage)
            self.bytes += storage.nbytes()
            self.most_bytes = max(self.most_bytes, self.bytes)
            weakref.finalize(storage, self._drop, storage.nbytes())

    def _drop(self, count: int) -> None:
        self.bytes -= count


def main(recipe: tyro.conf.Positional[Path], batch: int = 1, repeats: int = 3) -> None:
    config = make_recipe(DehazeTrainConfig, recipe, NO_FLAGS)
    device, crop = select_device(config), (config.crop_height, config.crop_width)
    model = build_network(NETWORKS | DEHAZERS, config).to(device).to(memory_format=torch.channels_last)
    cost = network_cost(model, crop, (3, 6) if config.prior else (3,))
    size = config.batch if device.type == "cuda" else batch
    print(f"{describe_processor()}, {device}, {torch.get_num_threads()} threads, torch {torch.__version__},", end=" ")
    print(f"Python {platform.python_version()}, {date.today()}")
    print(f"{config.network}: {cost.parameters} parameters, {cost.macs / 1e9:.2f} G MACs forward, {crop[1]}x{crop[0]}")
    step_s, peak_gb = measure_step(config, model, device, size, repeats)
    print(f"a step of {size}: {step_s:.2f} s, {peak_gb:.2f} GB above the memory before it")
    print(f"a batch of {config.batch} is made in {measure_batch(config):.2f} s of one thread's time")
    left_gb, most_gb = count_tensors(config, config.batch)
    print(f"tensors of a step of {config.batch}: {left_gb:.1f} GB after the forward pass, {most_gb:.1f} GB at the most")
    for name, (tflops, gb_s, gb) in GPUS.items():
        compute_s, memory_s = 6 * cost.macs * config.batch / (1e12 * tflops), PASSES * left_gb / gb_s
        hours = max(compute_s, memory_s) * config.steps / 3600
        print(f"{name}, {gb:.0f} GB: {compute_s:.3f} s a step by arithmetic, {memory_s:.3f} s by memory,", end=" ")
        print(f"{config.steps} steps {hours:.0f} h at least")


def measure_step(
    config: DehazeTrainConfig, model: torch.nn.Module, device: torch.device, size: int, repeats: int
) -> tuple[float, float]:
    """Median time of a step, s, and its peak memory above what there was before, GB."""
    before_gb, times_s = peak_memory_gb(device), []
    step = make_step(config, model, device, size)
    for _ in range(repeats):
        start_s = time.perf_counter()
        step().item()  # waits for the device
        times_s.append(time.perf_counter() - start_s)
    return statistics.median(times_s), peak_memory_gb(device) - before_gb


def count_tensors(config: DehazeTrainConfig, size: int) -> tuple[float, float]:
    """Tensors that live after the forward pass of a step, and the most that do at once, GB; without weights."""
    device = torch.device("meta")
    model = build_network(NETWORKS | DEHAZERS, config).to(device)
    left: list[int] = []
    with LiveTensors() as live:
        make_step(config, model, device, size, lambda: left.append(live.bytes))()
    return left[0] / 1e9, live.most_bytes / 1e9


def make_step(
    config: DehazeTrainConfig,
    model: torch.nn.Module,
    device: torch.device,
    size: int,
    after_forward: Callable[[], None] = lambda: None,
) -> Callable[[], torch.Tensor]:
    """A step on `size` random crops, which returns its loss."""
    optimizer = torch.optim.AdamW(model.parameters(), config.lr, (0.9, 0.999), weight_decay=config.weight_decay)
    shape = (size, 3, config.crop_height, config.crop_width)
    hazy, clear = (torch.rand(shape, device=device).to(memory_format=torch.channels_last) for _ in range(2))
    t = torch.ones_like(clear[:, :1])

    def step() -> torch.Tensor:
        with autocast(config, device):
            restored = model(hazy, torch.cat([hazy, hazy], 1)) if config.prior else model(hazy)
            loss = dehaze_loss(restored.float(), clear, t, config.visible_share, config.best_psnr_db)
        after_forward()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        return loss.detach()

    return step


def peak_memory_gb(device: torch.device) -> float:
    """Of the CUDA device, or of this process."""
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device) / 1e9
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def measure_batch(config: DehazeTrainConfig, repeats: int = 5) -> float:
    """Processor time to make one batch of cached recorded views, s."""
    (height, width), rng = PICTURE_PX, np.random.default_rng(0)
    crop = (config.crop_height, config.crop_width)
    clear, hazy = rng.integers(0, 256, (2, height, width, 3), np.uint8)
    ranges = rng.uniform(60, 800, (height, width)).astype(np.float16)
    view = ClearView(clear, ranges, None, Camera.from_fov(width, height, np.pi / 2), hazy_rgb=hazy, visibility_m=900.0)
    path = Path("pairs")
    views, times_s = Views({path: (1, lambda index: view)}, [path], held_out=0.0, train=True), []
    for step in range(repeats):
        start_s = time.thread_time()
        make_batch(views, config.batch, crop, config.haze, [0, step], config.prior, sub_images=config.sub_images)
        times_s.append(time.thread_time() - start_s)
    return statistics.median(times_s)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
