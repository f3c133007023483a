"""Every run of a campaign, one after the other: one that is no use is told, and the others still run."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from trackerlib.rangefiles.campaign import Campaign, CampaignRun, read_campaign
from trackerlib.textfiles import InputError

Answer = TypeVar("Answer")
RUN_KEYS = ("day", "run", "mode")  # by which a run is known


def chosen_runs(path: Path, day: str | None, run: str | None, mode: int | None) -> Campaign:
    """The campaign of a file, only its runs of a day, name or mode where one is told. Raises InputError for none."""
    campaign = read_campaign(path)
    told = {"day": day, "run": run, "mode": mode}
    chosen = campaign.select(**{f"{what}s": None if name is None else {name} for what, name in told.items()})
    if not chosen.runs:
        wanted = ", ".join(f"{what} {name}" for what, name in told.items() if name is not None)
        raise InputError(
            f"{path.name}: no run is of {wanted}; there are {'; '.join(map(str, campaign.runs))}"
        )
    return chosen


def each_run(
    command: str, campaign: Campaign, work: Callable[[CampaignRun], Answer]
) -> tuple[list[tuple[CampaignRun, Answer]], list[dict]]:
    """What `work` makes of every run, and as documents the runs whose files are no use, each with the reason.

    Raises InputError where none is of use.
    """
    done, failed = [], []
    for one in campaign.runs:
        try:
            done.append((one, work(one)))
        except InputError as error:
            print(f"{command}: {one}: {error}; the other runs go on", file=sys.stderr)
            failed.append({**{key: getattr(one, key) for key in RUN_KEYS}, "why": str(error)})
    if not done:
        raise InputError(
            f"campaign {campaign.name}: no run is of use; {campaign.runs[0]}: {failed[0]['why']}"
        )
    return done, failed


def failures_report(failed: list[dict]) -> list[str]:
    """The runs that are no use, a line each."""
    return [f"{run_words(one)} is no use: {one['why']}" for one in failed]


def run_words(one: dict) -> str:
    """Which run an answer is of."""
    return "day {day}, run {run}, mode {mode}".format(**one)
