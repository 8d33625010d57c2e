"""What computes a network: ONNX Runtime, on the processor or a GPU, or OpenVINO. Only this module imports OpenVINO."""

import math
import os
import platform
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from threading import Thread
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from deckline.config import Device, Engine, Precision
from deckline.extras import needs_extra

PROCESSOR = "CPUExecutionProvider"
PROVIDERS: dict[Device, str] = {"cuda": "CUDAExecutionProvider", "tensorrt": "TensorrtExecutionProvider"}
PACKAGES: dict[Device, str] = {"cuda": "onnxruntime-gpu", "tensorrt": "onnxruntime-gpu tensorrt"}
SINGLE = {"CUDAExecutionProvider": {"use_tf32": "0"}}  # else f32 is multiplied with 10 bits

MOST_BYTES = 4 << 30  # of all networks' values at a time, on the processor: pictures of 36 million pixels take 1 GB
LONGEST_S, WATCH_S = 120.0, 0.5  # of one computation; between two looks at those that run

CPUINFO = Path("/proc/cpuinfo")  # proc(5)
CPU_SHARE = Path("/sys/fs/cgroup/cpu.max")  # of the control group, in a container: quota and period, us
VNNI = ("avx512_vnni", "avx_vnni")  # products of 8-bit integers
FLAGS = ("avx2", "avx512f", *VNNI, "avx512_bf16", "amx_bf16", "amx_int8", "asimd", "bf16")  # that count here

Compute = Callable[[dict[str, NDArray[np.float32]]], Sequence[NDArray]]  # inputs by name -> outputs in their order


def list_precisions(device: Device) -> tuple[Precision, ...]:
    """The precisions that a device has on this machine.

    Raises:
        ValueError: ONNX Runtime has no such provider.
        ImportError: OpenVINO is not installed.
    """
    if device == "openvino":
        capabilities = _openvino_core().get_property("CPU", "OPTIMIZATION_CAPABILITIES")
        return ("f32", "bf16") if "BF16" in capabilities else ("f32",)
    if device in PROVIDERS:
        import onnxruntime

        if PROVIDERS[device] not in onnxruntime.get_available_providers():
            raise ValueError(
                f"ONNX Runtime has no {PROVIDERS[device]} here; for device {device} replace onnxruntime: "
                f"pip uninstall onnxruntime, then pip install {PACKAGES[device]}"
            )
    return ("f32",)


def describe_engines() -> dict[Device, str]:
    """What each device offers on this machine: its precisions, or what to install."""
    engines: dict[Device, str] = {}
    for device in get_args(Device):
        try:
            engines[device] = ", ".join(list_precisions(device))
        except (ValueError, ImportError) as error:
            engines[device] = str(error)
    return engines


def usable_cores() -> int:
    """Cores that this process may use: its affinity, and its control group's share of the processor's time."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota, _, period = (CPU_SHARE.read_text(encoding="utf-8") if CPU_SHARE.is_file() else "max").strip().partition(" ")
    return cores if quota == "max" else min(cores, max(math.ceil(int(quota) / int(period)), 1))


def describe_processor() -> str:
    """The processor's name, and which of its instructions decide how fast networks are."""
    facts = _read_cpuinfo()
    present = set(f"{facts.get('flags', '')} {facts.get('Features', '')}".split())
    name = facts.get("model name") or platform.machine()
    return f"{name} ({' '.join(flag for flag in FLAGS if flag in present) or 'no known flags'})"


def lacks_vnni() -> bool:
    """Whether this is an x86 processor, under Linux, that has no instructions for products of 8-bit integers."""
    flags = _read_cpuinfo().get("flags", "").split()  # ARM calls them Features
    return bool(flags) and not set(VNNI) & set(flags)


def _read_cpuinfo() -> dict[str, str]:
    """Of the last core; empty where the system has no such file."""
    lines = CPUINFO.read_text(encoding="utf-8").splitlines() if CPUINFO.is_file() else []
    return {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}


def check_engine(engine: Engine) -> None:
    """Refuse an engine that this machine has not.

    Raises:
        ValueError: no such provider or precision.
        ImportError: OpenVINO is not installed.
    """
    precisions = list_precisions(engine.device)
    if engine.precision not in precisions:
        raise ValueError(f"engine.precision: this processor has no {engine.precision}, only {', '.join(precisions)}")


def open_onnxruntime(path: Path, engine: Engine, optimised: bool = True) -> Any:
    """ONNX Runtime's session; without `optimised` it loads faster, and runs slower.

    Raises:
        ValueError: no ONNX model, or a provider that cannot be loaded.
    """
    import onnxruntime
    from onnxruntime.capi import onnxruntime_pybind11_state as errors

    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4  # errors are raised, and need not be printed too
    if not optimised:
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    options.intra_op_num_threads = engine.threads or usable_cores()
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # decoding, films, outputs need the cores
    _limit_memory()
    options.add_session_config_entry("session.use_env_allocators", "1")
    provider = PROVIDERS.get(engine.device, PROCESSOR)
    providers = [(name, SINGLE.get(name, {})) for name in dict.fromkeys((provider, PROCESSOR))]
    refused = (errors.Fail, errors.InvalidArgument, errors.InvalidGraph, errors.InvalidProtobuf)
    unsupported = (errors.NotImplemented, errors.RuntimeException)
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=providers)
    except (*refused, *unsupported) as error:
        raise ValueError(f"{path} is not a usable ONNX model: {get_line(error)}") from error
    if provider not in session.get_providers():  # it falls back by itself
        raise ValueError(f"device {engine.device}: {provider} cannot be loaded; install its driver and libraries")
    return session


@cache
def _limit_memory() -> None:
    """Make the allocator of a bounded size that this process's networks share."""
    import onnxruntime

    kind, memory = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, onnxruntime.OrtMemType.DEFAULT
    limits = onnxruntime.OrtArenaCfg({"max_mem": MOST_BYTES})
    onnxruntime.create_and_register_allocator(onnxruntime.OrtMemoryInfo("Cpu", kind, 0, memory), limits)


def compute_onnxruntime(session: Any, inputs: dict[str, NDArray[np.float32]]) -> Sequence[NDArray]:
    """ONNX Runtime's answer; a RuntimeError where it takes longer than `LONGEST_S`, noticed between two operators."""
    import onnxruntime

    options = onnxruntime.RunOptions()
    options.log_severity_level = 4  # as of the session
    watched = _watched_runs()
    watched[id(options)] = time.monotonic(), options
    try:
        outputs: Sequence[NDArray] = session.run(None, inputs, options)
    except Exception as error:
        if options.terminate:
            raise RuntimeError(f"it takes longer than {LONGEST_S:g} s") from error
        raise
    finally:
        del watched[id(options)]
    return outputs


@cache
def _watched_runs() -> dict[int, tuple[float, Any]]:
    """Beginning and options of every run of this process; one thread ends those that take too long."""
    runs: dict[int, tuple[float, Any]] = {}

    def watch() -> None:
        while True:
            time.sleep(WATCH_S)
            for begun, options in tuple(runs.values()):
                if time.monotonic() - begun > LONGEST_S:
                    options.terminate = True

    Thread(target=watch, daemon=True).start()
    return runs


@cache
def _openvino_core() -> Any:
    """This process's one `Core`, without telemetry, which begins at the import: where that package is missing, without.

    One for good, since each Core lays the signals of the thread that makes it on a stack of its own and takes that away
    when it goes: with two of them the next signal, such as Ctrl-C, finds a stack that is gone, and ends the process.
    """
    sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]
    with needs_extra("openvino"):
        import openvino
    return openvino.Core()


def compile_openvino(path: Path, engine: Engine, output_names: Sequence[str]) -> Compute:
    """OpenVINO's answer for an ONNX file, in the precision that was asked for and no other.

    Raises:
        ValueError: a model that OpenVINO cannot compute.
    """
    core = _openvino_core()
    settings: dict[str, str | int] = {"INFERENCE_PRECISION_HINT": engine.precision, "PERFORMANCE_HINT": "LATENCY"}
    settings["INFERENCE_NUM_THREADS"] = engine.threads or usable_cores()
    try:
        compiled = core.compile_model(path, "CPU", settings)
    except RuntimeError as error:
        raise ValueError(f"{path}: OpenVINO cannot compute this model: {get_line(error)}") from error

    requests = threading.local()  # one for each thread: threads may call at a time

    def compute(inputs: dict[str, NDArray[np.float32]]) -> Sequence[NDArray]:
        if not hasattr(requests, "own"):
            requests.own = compiled.create_infer_request()
        outputs = requests.own.infer(inputs, share_inputs=True)
        return [outputs[name] for name in output_names]

    return compute


def get_line(error: Exception) -> str:
    """The line of an error that has its cause: ONNX Runtime's first, OpenVINO's last."""
    lines = [line for line in str(error).splitlines() if line.strip()] or [type(error).__name__]
    return lines[-1] if lines[0].startswith("Exception from") else lines[0]
