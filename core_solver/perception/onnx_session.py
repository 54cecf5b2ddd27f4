"""Opening ONNX files: one place for threads and for words about damaged files."""

import os
from pathlib import Path

import onnxruntime

from core_solver.errors import ModelError

_MOST_THREADS = 4  # these small networks gain nothing from more


def open_session(path: Path) -> onnxruntime.InferenceSession:
    """A session on the processor.

    Raises:
        ModelError: the file is missing, damaged or uses operators that onnxruntime lacks.
    """
    options = onnxruntime.SessionOptions()
    # One core is left to BlazePose, which runs beside these networks.
    options.intra_op_num_threads = min(max((os.cpu_count() or 2) - 1, 1), _MOST_THREADS)
    # Waiting threads must not eat the core on which another network runs.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no public base class
        raise ModelError(f"{path} is no readable ONNX network: fetch it again or give another one") from error
