"""Compiled kernels: numba, cached on disk where that is allowed, warmed before anyone waits.

@compiled
def kernel(...): ...

@warms
def _warm(): kernel(small arrays of the usual types)
"""

from __future__ import annotations

import getpass
import os
import tempfile
import threading
from collections.abc import Callable
from importlib import import_module
from pathlib import Path


def _cache_folder() -> str | None:
    """Where numba may write its cache, or None to leave that to numba (beside the source)."""
    if os.environ.get("NUMBA_CACHE_DIR") or os.access(Path(__file__).parent, os.W_OK):
        return None
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    for folder in (home / "trackerlib", Path(tempfile.gettempdir()) / f"trackerlib-{getpass.getuser()}"):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return str(folder)
    return None


# numba reads this when it is imported, so it stands before the import.
if _folder := _cache_folder():
    os.environ["NUMBA_CACHE_DIR"] = _folder

import numba  # noqa: E402

compiled = numba.njit(cache=True, nogil=True, error_model="numpy")

# Modules that hold kernels; importing one registers its warm-up.
KERNEL_MODULES: tuple[str, ...] = (
    "trackerlib.acoustics.rays",
    "trackerlib.beacon.uncertainty",
    "trackerlib.beacon.squared_range",
    "trackerlib.beacon.pairs",
)

_warm_ups: list[Callable[[], object]] = []


def warms(function: Callable[[], object]) -> Callable[[], object]:
    """Registers a function that calls a module's kernels once, on small arrays of the usual types."""
    _warm_ups.append(function)
    return function


def warm() -> None:
    """Compiles every kernel, or loads it from the cache on disk."""
    for module in KERNEL_MODULES:
        import_module(module)
    for function in _warm_ups:
        function()


def warm_in_background() -> threading.Thread:
    """Starts `warm` in a thread of its own and returns that thread."""
    thread = threading.Thread(target=warm, name="warm-kernels", daemon=True)
    thread.start()
    return thread
