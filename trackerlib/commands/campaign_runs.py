"""Every run of a campaign, one after the other: one that is no use is told, and the others still run."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from trackerlib.rangefiles.campaign import Campaign, CampaignRun, read_campaign
from trackerlib.textfiles import InputError

Answer = TypeVar("Answer")


def chosen_runs(path: Path, day: str | None, run: str | None) -> Campaign:
    """The campaign of a file, only its runs of a day or of a name where one is told. Raises InputError for none."""
    campaign = read_campaign(path)
    chosen = campaign.select(days=None if day is None else {day}, runs=None if run is None else {run})
    if not chosen.runs:
        wanted = ", ".join(
            f"{what} {name}" for what, name in (("day", day), ("run", run)) if name is not None
        )
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
            failed.append({"day": one.day, "run": one.run, "mode": one.mode, "why": str(error)})
    if not done:
        raise InputError(
            f"campaign {campaign.name}: no run is of use; {campaign.runs[0]}: {failed[0]['why']}"
        )
    return done, failed


def failures_report(failed: list[dict]) -> list[str]:
    """The runs that are no use, a line each."""
    return ["day {day}, run {run}, mode {mode} is no use: {why}".format(**one) for one in failed]
