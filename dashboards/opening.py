"""Files opened into a session: uploads of any kind the tabs know, files by their path, runs of a campaign."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from dashboards.file_kinds import kind_of
from dashboards.session_file import restore_session
from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.beacon.navigation import Receptions
from trackerlib.crossover.edits import PointEdits, parse_edits
from trackerlib.crossover.gating import ready_sets
from trackerlib.live.navigation_file import read_navigation_file
from trackerlib.rangefiles.arrays import parse_arrays, read_arrays
from trackerlib.rangefiles.campaign import Campaign, CampaignRun, parse_campaign, read_campaign
from trackerlib.rangefiles.crossover_file import parse_crossover
from trackerlib.rangefiles.offsets_file import parse_offsets
from trackerlib.rangefiles.tfile import TFileReading, parse_tfile
from trackerlib.rangefiles.velocity_file import parse_velocity, read_velocity
from trackerlib.surveyfiles.pings_csv import SeveralTransponders
from trackerlib.surveyfiles.profile_csv import SIMULATED, parse_profile_csv
from trackerlib.surveyfiles.stream_csv import Arrivals, read_arrivals
from trackerlib.surveyfiles.survey import parse_survey
from trackerlib.textfiles import InputError, decode_lines, map_bytes, read_bytes

if TYPE_CHECKING:
    from dashboards.session import Session

DATA = Path(__file__).resolve().parents[1] / "data"
UPLOAD_LIMIT_MB = 200
HEAD_BYTES = 65_536  # of a file, which tell what it is
LARGE_BYTES = 5_000_000  # from here on a T-file is read off the event loop


@dataclass(frozen=True)
class SoundFile:
    """A file too large to be held: its name for people, and where it lies."""

    name: str
    path: Path


class Opening:
    """Opens files into one session; every method raises InputError for what none of the readers reads."""

    def __init__(self, session: Session):
        self._session = session
        self._folder: tempfile.TemporaryDirectory | None = None
        self._several: tuple[bytes, str] = b"", ""  # the survey whose transponder can be chosen, and its name
        self._edits: dict[Path, PointEdits] = {}  # of the T-files of a campaign
        self._arrivals: tuple[Arrivals, str] | None = None  # that positions are wanted for, and their name
        self._positions: SoundFile | None = None  # the ship's
        self._openers = {
            "session": lambda content, name: restore_session(session, content, name),
            "survey": self._survey,
            "arrivals": self._open_arrivals,
            "profile": self._profile,
            "arrays": self._arrays,
            "tfile": self._tfile,
            "velocity": self._velocity,
            "crossover": self._crossover,
            "offsets": self._offsets,
            "edits": self._point_edits,
            "navigation": self._navigation,
            "campaign": lambda content, name: self._campaign(parse_campaign(content, name)),
        }

    def upload(self, name: str, content: bytes) -> None:
        """Opens the bytes of a file that was dropped or chosen."""
        if len(content) > UPLOAD_LIMIT_MB * 1_000_000:
            raise InputError(
                f"{name}: found {len(content) / 1e6:.0f} MB; wanted at most {UPLOAD_LIMIT_MB} MB "
                "(type the path of a larger file that lies on this machine)"
            )
        kind = binary_kind(content)
        if kind is None:
            self._text(name, content)
        else:
            self._sound(kind, SoundFile(name, self._kept(name, content)))

    def path(self, text: str) -> None:
        """Opens a file of the machine that the program runs on, of any size; a campaign with all that it names."""
        path = Path(text.strip().strip("\"'")).expanduser()
        head = map_bytes(path)[:HEAD_BYTES]
        kind = binary_kind(head)
        if kind is not None:
            self._sound(kind, SoundFile(path.name, path))
        elif kind_of(decode_lines(head, path.name)) == "campaign":
            self._campaign(read_campaign(path))
        else:
            self._text(path.name, read_bytes(path))

    def beacon_demo(self) -> None:
        """Opens the simulated beacon survey that comes with the program."""
        folder = DATA / "beacon-demo"
        for name in ("soundspeed.csv", "survey.csv"):
            self.upload(name, read_bytes(folder / name))
        self._session.truth = json.loads((folder / "truth.json").read_text())

    def range_demo(self) -> None:
        """Opens the simulated range run that comes with the program."""
        folder = DATA / "range-demo"
        for name in ("arrays.csv", "tfile.dat"):
            self.upload(name, read_bytes(folder / name))

    def close(self) -> None:
        """Lets go of what is kept on disk."""
        if self._folder is not None:
            self._folder.cleanup()

    # -- sound ---------------------------------------------------------------------------------

    def _sound(self, kind: str, kept: SoundFile) -> None:
        self._arrivals = None  # positions opened from here on are for this
        self._session.say(f"{kept.name}: open in the tab Wet-paper chart")
        self._session.param.update(**{kind: kept})

    def _navigation(self, content: bytes, name: str) -> None:
        self._positions = SoundFile(name, self._kept(name, content))
        if self._arrivals is not None:
            self._place_arrivals()
            return
        self._session.say(f"{name}: the ship's positions, for the tab Wet-paper chart")
        self._session.navigation_file = self._positions

    def _kept(self, name: str, content: bytes) -> Path:
        """The upload as a file in a folder that goes with the session."""
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="workbench-")
        many = len(os.listdir(self._folder.name))
        path = Path(self._folder.name) / f"{self._session.opened}-{many}{Path(name).suffix}"
        try:
            path.write_bytes(content)
        except OSError as error:
            raise InputError(f"{name}: cannot be kept while it is open ({error.strerror})") from None
        return path

    # -- text ----------------------------------------------------------------------------------

    def _text(self, name: str, content: bytes) -> None:
        self._openers[kind_of(decode_lines(content[:HEAD_BYTES], name))](content, name)

    def transponder(self, which: str) -> None:
        """Opens the pings of another transponder of the survey that is open."""
        self._survey(*self._several, which)

    def _survey(self, content: bytes, name: str, transponder: str | None = None) -> None:
        session = self._session
        settings, names = session.fix_settings, session.transponders
        lines, depth_m = decode_lines(content, name), settings.hydrophone_depth_m
        try:
            reading = parse_survey(lines, name, transponder=transponder, hydrophone_depth_m=depth_m)
        except SeveralTransponders as several:
            names, transponder = several.names, several.names[0]
            reading = parse_survey(lines, name, transponder=transponder, hydrophone_depth_m=depth_m)
        self._arrivals, self._several = None, (content, name)
        profile = self._water(reading.pings.simulated)
        settings = replace(settings, profile=profile, left_out=frozenset(), start=None)
        session.begin_hunt(fix_settings=settings, pings=reading.pings, heard=len(reading.pings), listening="")
        what = f"{len(reading.pings)} pings ({reading.layout})"
        if transponder is not None:
            session.param.update(transponders=names, transponder=transponder)
            what += f" of {transponder}; another of its {len(names)} transponders can be chosen in the page's head"
        self._told(name, what, reading.bad_records, reading.notes)

    def _water(self, simulated: bool) -> SoundSpeedProfile | None:
        """The profile that is open; the demo's water is not that of a real survey."""
        profile = self._session.fix_settings.profile
        return None if profile is not None and SIMULATED in profile.notes and not simulated else profile

    def _open_arrivals(self, content: bytes, name: str) -> None:
        """Instants of arrival, which become pings once the ship's positions are open beside them."""
        self._arrivals = read_arrivals(decode_lines(content, name), name), name
        if self._positions is not None:
            self._place_arrivals()
            return
        self._session.say(
            f"{name}: {len(self._arrivals[0].arrival_s)} arrivals; now open the ship's positions by the same clock "
            "(CSV with time_s or utc, lat_deg, lon_deg, or NMEA 0183)"
        )

    def _place_arrivals(self) -> None:
        """Begins a hunt with the arrivals and the positions beside them."""
        session = self._session
        (arrivals, name), file = self._arrivals, self._positions
        positions = read_navigation_file(decode_lines(read_bytes(file.path), file.name), file.name, 0.0)
        receptions = Receptions(
            arrivals.number, arrivals.arrival_s, positions.fixes, source=name,
            simulated=arrivals.simulated or positions.simulated,
        )  # fmt: skip
        words = f"{name}: {len(arrivals.arrival_s)} arrivals, {len(positions.fixes.time_s)} positions"
        if bad := (*arrivals.bad_records, *positions.bad_records):
            words += f"; {len(bad)} bad lines, the first is line {bad[0].line}: {bad[0].why}"
        if session.fix_settings.interval_s is None:
            words += "; tell the interval of the pinger, under Times: arrivals are known up to whole intervals only"
        session.fix_settings = replace(session.fix_settings, profile=self._water(receptions.simulated))
        session.take_receptions(receptions, words)

    def _profile(self, content: bytes, name: str) -> None:
        session = self._session
        profile = parse_profile_csv(decode_lines(content, name), name)
        session.fix_settings = replace(session.fix_settings, profile=profile)
        notes = [note for note in profile.notes if note != SIMULATED]
        self._told(name, "sound-speed profile of the beacon hunt", (), notes)

    def _arrays(self, content: bytes, name: str) -> None:
        reading = parse_arrays(content, name)
        self._session.survey = reading.survey
        self._told(name, f"{len(reading.survey.number)} arrays", reading.bad_records, reading.notes)
        self._session.gate()

    def _tfile(self, content: bytes, name: str) -> None:
        def done(tfile: TFileReading) -> None:
            session = self._session
            session.tfile_content = content
            own, before = tfile.profile(), session.profile
            notes = () if own is None else own.notes
            if own is not None and before is not None and before.name != own.name:
                notes = (*notes, f"the profile in its head takes the place of {before.name}")
            session.param.update(
                tfile=tfile, profile=own or session.profile, keep_lines=(), campaign=None, campaign_run=None
            )
            self._told_reports(tfile, name, notes)
            session.gate()

        self._read_tfile(content, name, None, done)

    def _read_tfile(
        self, content: bytes, name: str, header: int | None, done: Callable[[TFileReading], None]
    ) -> None:
        """Reads a T-file, off the event loop if it is large, and hands it on."""

        def read(progress=None) -> TFileReading:
            return parse_tfile(content, name, header_records=header)

        if len(content) < LARGE_BYTES:
            done(read())
        else:
            self._session.jobs.start(f"Opening {name}", read, done)

    def _velocity(self, content: bytes, name: str) -> None:
        try:
            reading = parse_velocity(content, name)
        except InputError as error:
            if "metres" not in str(error):
                raise
            raise InputError(f"{error}. The tab Timing, Profile, opens one in metres") from None
        self._session.edit(profile=reading.profile)
        profile = reading.profile
        self._told(name, f"sound speed of {len(profile.depth)} layers", reading.bad_records, profile.notes)

    def _crossover(self, content: bytes, name: str) -> None:
        session = self._session
        reading = parse_crossover(content, name, session.survey)
        opened = session.gating.sets if session.gating is not None and session.tfile is None else ()
        sets = (*(one for one in opened if one.source != name), reading.set)
        session.param.update(
            tfile=None, gating=ready_sets(sets), correction=None, crossover=reading.set, campaign=None,
            campaign_run=None,
        )  # fmt: skip
        self._told(name, f"{reading.set.points} point counts", reading.bad_records, reading.notes)

    def _offsets(self, content: bytes, name: str) -> None:
        table, bad = parse_offsets(decode_lines(content, name), name)
        self._session.offsets = table
        self._told(name, f"{len(table)} timing offsets", bad, ())

    def _point_edits(self, content: bytes, name: str) -> None:
        edits, bad = parse_edits(decode_lines(content, name), name)
        self._session.edit(edits=edits)
        self._told(name, f"{len(edits.reasons)} points left out", bad, ())

    # -- a campaign ----------------------------------------------------------------------------

    def _campaign(self, campaign: Campaign) -> None:
        """Makes a campaign the one whose runs can be chosen, and opens the first whose files are of use."""
        self._session.param.update(campaign=campaign, campaign_run=None)
        self._edits.clear()
        failed = None
        for one in campaign.runs:
            try:
                self.run(one)
                return
            except InputError as error:
                failed = failed or error
        raise InputError(f"{campaign.name}: no run is of use; {failed}")

    def run(self, one: CampaignRun) -> None:
        """Opens the files of one run of the campaign, with the points left out of it before."""
        session = self._session
        try:
            arrays, velocity = read_arrays(one.arrays), read_velocity(one.profile)
            content = read_bytes(one.tfile)
        except InputError as error:
            raise InputError(f"{one}: {error}") from None

        def done(tfile: TFileReading) -> None:
            before = session.campaign_run
            if before is not None:
                self._edits[before.tfile] = session.edits
            session.forget_edits()
            session.tfile_content = content
            session.param.update(
                campaign_run=one, survey=arrays.survey, profile=velocity.profile, mode=one.mode, tfile=tfile,
                keep_lines=(), edits=self._edits.get(one.tfile, PointEdits()),
            )  # fmt: skip
            odd = [(one.arrays, bad) for bad in arrays.bad_records]
            odd += [(one.profile, bad) for bad in velocity.bad_records]
            lines = [f"{path.name}, line {bad.line}: {bad.why}" for path, bad in odd]
            self._told_reports(tfile, str(one), (*arrays.notes, *velocity.profile.notes, *lines))
            session.gate()

        self._read_tfile(content, one.tfile.name, one.header_records, done)

    # -- words ---------------------------------------------------------------------------------

    def _told_reports(self, tfile: TFileReading, name: str, notes=()) -> None:
        what = f"{len(tfile.reports)} position reports"
        self._told(name, what, tfile.reports.bad_records, (*tfile.doubts, *notes))

    def _told(self, name: str, what: str, bad_records, notes) -> None:
        parts = [f"{name}: {what}"]
        if bad_records:
            first = bad_records[0]
            parts.append(f"{len(bad_records)} bad lines, the first is line {first.line}: {first.why}")
        self._session.say("; ".join([*parts, *notes]))


def binary_kind(content: bytes) -> str | None:
    """The parameter that a sound or database is kept in, by its first bytes; None for anything else."""
    if content[:4] in (b"RIFF", b"RF64", b"fLaC", b"FORM", b"OggS"):
        return "recording"
    return "hunt_file" if content.startswith(b"SQLite format 3") else None
