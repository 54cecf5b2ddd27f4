"""Opening ONNX files: one place for threads, graph optimisation, devices and for words about damaged files."""

import logging
import os
from pathlib import Path

import onnxruntime

from core_solver.errors import ModelError

SMALL_NETWORKS_THREADS = 4  # the default networks gain nothing from more

_log = logging.getLogger(__name__)


def open_session(
    path: Path, device: str = "cpu", most_threads: int = SMALL_NETWORKS_THREADS
) -> onnxruntime.InferenceSession:
    """A session on the processor or on a CUDA device.

    Args:
        path: ONNX file.
        device: "cpu"; "cuda"; or "auto" for CUDA where onnxruntime has it. Without it, "cuda" gives a warning and a
            session on the processor.
        most_threads: on the processor; one core is left to others in any case.

    Raises:
        ModelError: the file is missing, damaged or uses operators that onnxruntime lacks.
    """
    options = onnxruntime.SessionOptions()
    # One core is left to BlazePose, which runs beside these networks.
    options.intra_op_num_threads = min(max((os.cpu_count() or 2) - 1, 1), most_threads)
    # Waiting threads must not eat the core on which another network runs.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    # Fuses operators and lays convolutions out for this processor: done once, at loading.
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
    options.log_severity_level = 4
    wanted = providers(device, path.name)
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=wanted)
    except Exception as error:  # onnxruntime's errors have no public base class
        raise ModelError(f"{path} is no readable ONNX network: fetch it again or give another one") from error
    if wanted[0] not in session.get_providers():
        _log.warning("CUDA could not be started, so %s runs on the processor: check the CUDA libraries", path.name)
    return session


def providers(device: str, name: str) -> list[str]:
    """What onnxruntime shall run on, first choice first, for a network of this name."""
    has_cuda = "CUDAExecutionProvider" in onnxruntime.get_available_providers()
    if device == "cuda" and not has_cuda:
        _log.warning(
            "onnxruntime has no CUDA here, so %s runs on the processor: install onnxruntime-gpu instead of "
            "onnxruntime to change that",
            name,
        )
    return (
        ["CUDAExecutionProvider", "CPUExecutionProvider"] if has_cuda and device != "cpu" else ["CPUExecutionProvider"]
    )
