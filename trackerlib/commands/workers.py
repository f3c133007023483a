"""Who does the work of many trials: threads of this machine, or a Dask cluster."""

from __future__ import annotations

import argparse

import numba

from trackerlib.textfiles import InputError


def add_workers(parser: argparse.ArgumentParser) -> None:
    """The options `--workers` and `--scheduler`, of which one may be told."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="W", help="threads (default: all cores)")
    where.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers do it")


def add_trials(parser: argparse.ArgumentParser, words: str) -> None:
    """The options `--trials`, in words, and `--seed`."""
    parser.add_argument("--trials", type=int, required=True, metavar="M", help=words)
    parser.add_argument(
        "--seed", type=_seed, required=True, metavar="S", help="the same seed gives the same trials"
    )


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"found {text!r}; wanted a whole number of 0 or more")
    return int(text)


def use_workers(count: int | None) -> None:
    """Lets kernels run on this many threads.

    Raises InputError for a count that this machine does not have.
    """
    if count is None:
        return
    most = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if not 1 <= count <= most:
        raise InputError(f"--workers is {count}; wanted 1 to {most}")
    numba.set_num_threads(count)


def dask_client(scheduler: str):
    """A `distributed.Client` of the cluster at an address. Raises InputError where none answers."""
    from distributed import Client  # a second to import, for those who have a cluster

    try:
        return Client(scheduler, timeout="5s")
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {scheduler}: no Dask scheduler answers there ({error})") from None
