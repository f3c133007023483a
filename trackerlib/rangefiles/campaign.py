"""A campaign: which T-file holds which run of which vehicle on which day, with that day's profile and survey.

JSON or TOML, told by the file's name; paths are relative to it:

    {"name": "June", "arrays": "arrays.csv", "profiles": {"1": "VELOCITY1.DAT", "2": "VELOCITY2.DAT"},
     "runs": [{"day": "1", "run": "1", "tfile": "run1.dat", "mode": 7, "vehicle": "MK 30"}, ...]}

A run may name its own `arrays`, `profile` and `header_records`; the profile of its day serves otherwise. Whether
the files are there is seen when a run is taken: one that cannot be read does not stop the others.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from urllib.parse import quote

from trackerlib.rangefiles.tfile import HEADER_RECORDS
from trackerlib.textfiles import InputError, decode_lines, read_bytes, write_text

_KEYS = {"name", "arrays", "profiles", "runs"}
_RUN_KEYS = {"day", "run", "tfile", "mode", "vehicle", "arrays", "profile", "header_records"}


@dataclass(frozen=True)
class CampaignRun:
    """One vehicle's run and the files that belong to it."""

    day: str
    run: str
    tfile: Path
    mode: int
    arrays: Path
    profile: Path
    vehicle: str = ""
    header_records: int = HEADER_RECORDS

    @property
    def folder(self) -> str:
        """Name of a folder for what comes of this run; a day may be 6/20/85."""
        return f"day_{quote(self.day, safe=' ')}_run_{quote(self.run, safe=' ')}_mode_{self.mode}"

    def __str__(self) -> str:
        vehicle = f"{self.vehicle} (mode {self.mode})" if self.vehicle else f"mode {self.mode}"
        return f"day {self.day}, run {self.run}, {vehicle}"


@dataclass(frozen=True)
class Campaign:
    """Runs in the order of the file."""

    name: str
    runs: tuple[CampaignRun, ...]

    def select(self, days=None, runs=None, modes=None) -> Campaign:
        """The runs of some days, runs or modes only; None is all."""
        kept = tuple(
            one
            for one in self.runs
            if (days is None or one.day in days)
            and (runs is None or one.run in runs)
            and (modes is None or one.mode in modes)
        )
        return Campaign(self.name, kept)


def read_campaign(path: str | Path) -> Campaign:
    """The campaign of a file. Raises InputError with the key where it is not as wanted."""
    path = Path(path)
    return parse_campaign(read_bytes(path), path.name, path.parent)


def parse_campaign(content: bytes, name: str, folder: Path | None = None) -> Campaign:
    """The same from the bytes of a file (or upload) called `name`.

    folder : where the file lies; without it, files that are not named by their whole path are refused
    """
    text = "\n".join(decode_lines(content, name))
    try:
        entries = tomllib.loads(text) if name.lower().endswith(".toml") else json.loads(text)
    except (json.JSONDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(
            f"{name}: {error}; wanted a campaign in JSON, or in TOML if it ends in .toml"
        ) from None
    return _campaign(entries, name, folder)


def _campaign(content, name: str, folder: Path | None) -> Campaign:
    if not isinstance(content, dict):
        raise InputError(f"{name}: found {type(content).__name__}, wanted name, arrays, profiles and runs")
    _refuse_unknown(content, _KEYS, f"{name}, key ")
    entries = content.get("runs")
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{name}, key runs: found {entries!r}, wanted a list of one run or more")
    profiles = content.get("profiles", {})
    if not isinstance(profiles, dict):
        raise InputError(f"{name}, key profiles: found {profiles!r}, wanted a file for each day")
    runs = tuple(
        _run(entry, content.get("arrays"), profiles, folder, f"{name}, key runs[{n}]")
        for n, entry in enumerate(entries, 1)
    )
    seen: set[tuple] = set()
    for n, one in enumerate(runs, 1):
        key = (one.day, one.run, one.mode)
        if key in seen:
            raise InputError(f"{name}, key runs[{n}]: day {one.day}, run {one.run}, mode {one.mode} again")
        seen.add(key)
    return Campaign(str(content.get("name", Path(name).stem)), runs)


def write_campaign(path: str | Path, campaign: Campaign) -> None:
    """Writes a campaign as JSON that reads back as the same; files beside it by their names alone."""
    path = Path(path)

    def beside(file: Path) -> str:
        return str(file.relative_to(path.parent)) if file.is_relative_to(path.parent) else str(file)

    runs = [
        {key: beside(value) if isinstance(value, Path) else value for key, value in vars(one).items()}
        for one in campaign.runs
    ]
    write_text(path, json.dumps({"name": campaign.name, "runs": runs}, indent=1, ensure_ascii=False) + "\n")


def _run(entry, arrays, profiles: dict, folder: Path | None, where: str) -> CampaignRun:
    if not isinstance(entry, dict):
        raise InputError(f"{where}: found {entry!r}, wanted day, run, tfile and mode")
    _refuse_unknown(entry, _RUN_KEYS, f"{where}.")
    for key in ("day", "run", "tfile", "mode"):
        if key not in entry:
            raise InputError(f"{where}.{key}: is missing")
    day, run = (_name(entry[key], f"{where}.{key}") for key in ("day", "run"))
    header = entry.get("header_records", HEADER_RECORDS)
    for key, value in (("mode", entry["mode"]), ("header_records", header)):
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise InputError(f"{where}.{key}: found {value!r}, wanted a whole number")
    return CampaignRun(
        day=day,
        run=run,
        tfile=_file(entry["tfile"], folder, f"{where}.tfile"),
        mode=entry["mode"],
        arrays=_file(entry.get("arrays", arrays), folder, f"{where}.arrays"),
        profile=_file(entry.get("profile", profiles.get(day)), folder, f"{where}.profile"),
        vehicle=str(entry.get("vehicle", "")),
        header_records=header,
    )


def _refuse_unknown(entry: dict, keys: set[str], where: str) -> None:
    for key in sorted(entry.keys() - keys):
        raise InputError(f"{where}{key}: no such key; there are {', '.join(sorted(keys))}")


def _name(value, where: str) -> str:
    """A day or a run as text; TOML knows dates."""
    if isinstance(value, bool) or not isinstance(value, str | int | float | date) or not str(value).strip():
        raise InputError(f"{where}: found {value!r}, wanted a name or a number")
    return str(value).strip()


def _file(name, folder: Path | None, where: str) -> Path:
    if not isinstance(name, str) or not name:
        raise InputError(
            f"{where}: found {name!r}, wanted the name of a file, here or for the whole campaign"
        )
    if folder is None and not Path(name).is_absolute():
        raise InputError(
            f"{where}: {name} is beside the campaign file, and a dropped file does not say where it lies; type the "
            "campaign's own path under Open, such as /data/june/campaign.toml"
        )
    return Path(name) if folder is None else folder / name
