"""Compiled kernels: numba, cached on disk where that is allowed, warmed before anyone waits.

@compiled
def kernel(...): ...

@warms
def _warm(): kernel(small arrays of the usual types)
"""

from __future__ import annotations

import getpass
import hashlib
import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib import import_module
from pathlib import Path

import llvmlite.binding
import numba
from numba.core import config


def _cache_folder() -> Path | None:
    """Where numba may keep compiled kernels, or None to leave that to numba (beside the source).

    Named after the sources of all kernels: numba renews a cached kernel when its own file changes, not when a
    file changes whose kernels it calls.
    """
    package = Path(__file__).parent
    sources = [path.read_bytes() for path in sorted(package.rglob("*.py"))]
    kernels = b"".join(text for text in sources if b"numba" in text or b"@compiled" in text)
    name = hashlib.sha256(kernels).hexdigest()[:12]
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    for folder in (
        package / "__pycache__" / "kernels",
        home / "trackerlib",
        Path(tempfile.gettempdir()) / f"trackerlib-{getpass.getuser()}",
    ):
        try:
            (folder / name).mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder / name, os.W_OK):
            for other in folder.iterdir():
                if other.name != name:
                    shutil.rmtree(other, ignore_errors=True)
            return folder / name
    return None


# numba asks for this whenever it meets a kernel, so it holds for kernels compiled from here on, whoever imported numba.
if not os.environ.get("NUMBA_CACHE_DIR") and (_folder := _cache_folder()):
    config.CACHE_DIR = str(_folder)  # type: ignore[attr-defined]

# LLVM keeps to half the width of AVX-512, as the first of these processors slowed down at all of it.
if config.CPU_FEATURES is None:  # type: ignore[attr-defined]
    _features = llvmlite.binding.get_host_cpu_features().flatten()
    config.CPU_FEATURES = f"{_features},-prefer-256-bit"  # type: ignore[attr-defined]

compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


def compiled_with(*liberties: str) -> Callable:
    """A `compiled` that may take these liberties with sums, in LLVM's words."""
    return numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=set(liberties))


# Modules that hold kernels; importing one registers its warm-up.
KERNEL_MODULES: tuple[str, ...] = (
    "trackerlib.acoustics.rays",
    "trackerlib.beacon.uncertainty",
    "trackerlib.beacon.squared_range",
    "trackerlib.beacon.pairs",
    "trackerlib.beacon.live_sums",
    "trackerlib.timing.variance_components",
    "trackerlib.timing.correlated_noise",
    "trackerlib.receiver.report_receiver",
    "trackerlib.receiver.demodulation",
    "trackerlib.receiver.chains",
    "trackerlib.rangefiles.record_scan",
    "trackerlib.crossover.gate_scan",
    "trackerlib.crossover.repeats",
)

_warm_ups: list[Callable[[], object]] = []


def in_threads(work: Callable, jobs: Sequence[tuple]) -> list:
    """Results of `work(*job)` for every job, in order; kernels hold no GIL and run side by side."""
    threads = min(len(jobs), os.cpu_count() or 1)
    if threads < 2:
        return [work(*job) for job in jobs]
    with ThreadPoolExecutor(threads, thread_name_prefix="kernels") as pool:
        return list(pool.map(lambda job: work(*job), jobs))


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


@cache
def warm_in_background() -> threading.Thread:
    """Starts `warm` in a thread of its own, once a process, and returns that thread; it keeps nothing from ending."""
    thread = threading.Thread(target=warm, name="warm-kernels", daemon=True)
    thread.start()
    return thread
