"""How much memory a process has taken."""

import sys
from pathlib import Path


def peak_mb() -> float:
    """Highest resident memory of this process so far, in 10^6 bytes.

    Linux hands a new program the highest memory of the process that started it as its own `ru_maxrss`; only VmHWM
    begins anew.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) * 1024 / 1e6
    if sys.platform == "win32":
        return 0.0  # not known without another library
    import resource  # noqa: PLC0415 - not on Windows

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
