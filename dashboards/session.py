"""What the tabs of one browser page share. Two pages never share a Session."""

from __future__ import annotations

import json
import logging
import os
import tempfile
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import param

from dashboards.file_kinds import kind_of
from dashboards.jobs import Jobs
from dashboards.live import PingQueue
from trackerlib import __version__
from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.live_survey import LiveSurvey
from trackerlib.beacon.pings import PingLog, Pings
from trackerlib.beacon.result import BeaconFix, blank_fix
from trackerlib.beacon.settings import FixSettings
from trackerlib.crossover.edits import PointEdits, edits_csv, parse_edits
from trackerlib.crossover.gating import GatingResult, gate_reports, ready_sets
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.arrays import parse_arrays
from trackerlib.rangefiles.crossover_file import parse_crossover
from trackerlib.rangefiles.offsets_file import parse_offsets
from trackerlib.rangefiles.tfile import TFileReading, parse_tfile
from trackerlib.rangefiles.velocity_file import parse_velocity
from trackerlib.surveyfiles.profile_csv import SIMULATED, parse_profile_csv
from trackerlib.surveyfiles.survey import parse_survey
from trackerlib.textfiles import InputError, decode_lines, read_bytes
from trackerlib.timing.correction import fit_timing
from trackerlib.timing.offsets import OffsetTable

log = logging.getLogger("workbench")

DATA = Path(__file__).resolve().parents[1] / "data"
UPLOAD_LIMIT_MB = 200
HEAD_BYTES = 65_536  # of a file, which tell what it is
LARGE_BYTES, LARGE_REPORTS = (
    5_000_000,
    100_000,
)  # from here on a T-file is read, and gated, off the event loop
SPEEDS = (1, 5, 20, 100, 1000)
MODE_NAMES = {2: "ship", 7: "torpedo"}


@dataclass(frozen=True)
class SoundFile:
    """A file too large to be held: its name for people, and where it lies."""

    name: str
    path: Path


class Session(param.Parameterized):
    """State that tabs read, watch and write back; every value is one of trackerlib's frozen types."""

    # The range
    tfile = param.ClassSelector(class_=TFileReading, allow_None=True)
    survey = param.ClassSelector(class_=ArraySurvey, allow_None=True)
    profile = param.ClassSelector(class_=SoundSpeedProfile, allow_None=True, doc="of the range, feet")
    mode = param.Integer(default=7, doc="which vehicle's reports are gated")
    max_slant_range_ft = param.Number(default=4700.0, bounds=(100, 100_000))
    gap_counts = param.Integer(default=30, bounds=(1, 100_000))
    gating = param.ClassSelector(class_=GatingResult, allow_None=True)
    keep_lines = param.ClassSelector(class_=tuple, default=(), doc="lines kept of repeated reports, by hand")
    crossover = param.ClassSelector(class_=CrossoverSet, allow_None=True, doc="the set chosen in any tab")
    correction = param.Parameter(default=None, doc="timing correction of that set")
    edits = param.ClassSelector(class_=PointEdits, default=PointEdits(), doc="points left out by hand")
    timing_options = param.Dict(default={"method": "report", "outliers": "out"}, doc="of `estimate_timing`")
    fits = param.Parameter(
        default=(), doc="timing correction of every set, None where there is none; () before"
    )
    offsets = param.ClassSelector(
        class_=OffsetTable, allow_None=True, doc="of an OFFSETS.csv that was opened"
    )

    # The beacon hunt
    pings = param.ClassSelector(class_=Pings, allow_None=True)
    fix_settings = param.ClassSelector(class_=FixSettings, default=FixSettings())
    fix = param.ClassSelector(class_=BeaconFix, allow_None=True, doc="of the pings heard so far")
    truth = param.Dict(default=None, allow_None=True, doc="known or published place of the beacon, if any")
    reasons = param.Dict(default={}, doc="why pings were left out by hand, by their number")
    opened = param.Integer(default=0, doc="raised by one for every survey opened or hunt begun")
    bearing_lines = param.ClassSelector(
        class_=tuple, default=(), doc="closest approaches read off the chart, for the map"
    )

    # The chart
    fold_s = param.Number(default=2.0, bounds=(0.01, 600), doc="interval at which the paper is folded [s]")
    chart_marks = param.ClassSelector(class_=tuple, default=(), doc="(line, folded time) marked on a trace")
    recording = param.ClassSelector(class_=SoundFile, allow_None=True, doc="sound opened for the chart")
    hunt_file = param.ClassSelector(class_=SoundFile, allow_None=True, doc="stored session of a receiver")
    navigation_file = param.ClassSelector(
        class_=SoundFile, allow_None=True, doc="positions beside a recording"
    )
    pointed = param.ClassSelector(class_=tuple, allow_None=True, doc="(lat, lon) of the line pointed at")

    # Pings one at a time: of a replay, or as they come from a line
    live = param.Boolean(default=False, doc="the live estimator, not the batch")
    listening = param.String(default="", doc="where live pings come from, empty when from nowhere")

    # Replay of a survey: how many pings have been heard
    heard = param.Integer(default=0, bounds=(0, None))
    playing = param.Boolean(default=False)
    speed = param.Selector(default=100, objects=list(SPEEDS), doc="times real time")

    # The page
    message = param.String(default="")
    failed = param.Boolean(default=False, doc="the message tells of an error")
    work = param.String(default="", doc="what is running, empty when idle")
    progress = param.Number(default=0.0, bounds=(0, 1))

    def __init__(self, **params):
        super().__init__(**params)
        self.jobs = Jobs(self._job_state, self.report)
        self.tfile_content = b""  # as it was opened, for corrected copies
        self._past: list[dict] = []
        self._future: list[dict] = []
        self._folder: tempfile.TemporaryDirectory | None = None
        self._clock = 0.0  # seconds of survey time since its first ping
        self._queue, self._log = PingQueue(), PingLog()
        self._live_survey: LiveSurvey | None = None
        self._live_of: tuple = ()  # what the live estimator was begun for

    # -- messages ------------------------------------------------------------------------------

    def say(self, text: str) -> None:
        """Shows a sentence in the status line."""
        self.param.update(message=text, failed=False)

    def report(self, error: Exception) -> None:
        """Shows an error in words; what is no mistake of the user's is logged with its traceback."""
        if isinstance(error, InputError):
            log.warning("%s", error)
            words = str(error)
        else:
            log.error("unexpected", exc_info=error)
            words = f"Something went wrong that is not your doing: {type(error).__name__}: {error}"
        self.param.update(message=words, failed=True)

    def _job_state(self, purpose: str, share: float, text: str) -> None:
        self.param.update(work=f"{purpose} {text}".strip() if purpose else "", progress=min(max(share, 0), 1))
        if text and not purpose:
            self.say(text)

    # -- edits ---------------------------------------------------------------------------------

    def edit(self, **changes) -> None:
        """Changes parameters so that Undo takes it back."""
        before = {name: getattr(self, name) for name in changes}
        self._past.append({"before": before, "after": changes})
        self._future.clear()
        self.param.update(**changes)

    def undo(self) -> None:
        """Takes back the last edit."""
        if not self._past:
            self.say("Nothing to undo")
            return
        self._future.append(self._past.pop())
        self.param.update(**self._future[-1]["before"])

    def redo(self) -> None:
        """Makes the last edit taken back again."""
        if not self._future:
            self.say("Nothing to redo")
            return
        self._past.append(self._future.pop())
        self.param.update(**self._past[-1]["after"])

    # -- opening -------------------------------------------------------------------------------

    def open_file(self, name: str, content: bytes) -> None:
        """Opens an upload of any kind the tabs know; raises InputError for what none of them reads."""
        if len(content) > UPLOAD_LIMIT_MB * 1_000_000:
            raise InputError(
                f"{name}: found {len(content) / 1e6:.0f} MB; wanted at most {UPLOAD_LIMIT_MB} MB "
                "(larger files: python -m trackerlib reads them from disk)"
            )
        kind = binary_kind(content)
        if kind is not None:
            kept = SoundFile(name, self._kept(name, content))
            self.say(f"{name}: open in the tab Wet-paper chart")
            self.param.update(**{kind: kept})
            return
        openers = {
            "session": self._open_session,
            "survey": self._open_survey,
            "profile": self._open_profile,
            "arrays": self._open_arrays,
            "tfile": self._open_tfile,
            "velocity": self._open_velocity,
            "crossover": self._open_crossover,
            "offsets": self._open_offsets,
            "edits": self._open_edits,
            "navigation": self._open_navigation,
        }
        openers[kind_of(decode_lines(content[:HEAD_BYTES], name))](content, name)

    def _open_navigation(self, content, name) -> None:
        self.say(f"{name}: the ship's positions, for the tab Wet-paper chart")
        self.navigation_file = SoundFile(name, self._kept(name, content))

    def _kept(self, name: str, content: bytes) -> Path:
        """The upload as a file in a folder that goes with the session."""
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="workbench-")
        path = (
            Path(self._folder.name) / f"{self.opened}-{len(os.listdir(self._folder.name))}{Path(name).suffix}"
        )
        try:
            path.write_bytes(content)
        except OSError as error:
            raise InputError(f"{name}: cannot be kept while it is open ({error.strerror})") from None
        return path

    def close(self) -> None:
        """Lets go of what the session keeps on disk."""
        if self._folder is not None:
            self._folder.cleanup()

    def open_beacon_demo(self) -> None:
        """Opens the simulated beacon survey that comes with the program."""
        folder = DATA / "beacon-demo"
        for name in ("soundspeed.csv", "survey.csv"):
            self.open_file(name, read_bytes(folder / name))
        self.truth = json.loads((folder / "truth.json").read_text())

    def open_range_demo(self) -> None:
        """Opens the simulated range run that comes with the program."""
        folder = DATA / "range-demo"
        for name in ("arrays.csv", "tfile.dat"):
            self.open_file(name, read_bytes(folder / name))

    def _open_survey(self, content, name) -> None:
        reading = parse_survey(
            decode_lines(content, name), name, hydrophone_depth_m=self.fix_settings.hydrophone_depth_m
        )
        profile = self.fix_settings.profile
        if profile is not None and SIMULATED in profile.notes and not reading.pings.simulated:
            profile = None  # the demo's water is not that of a real survey
        settings = replace(self.fix_settings, profile=profile, left_out=frozenset(), start=None)
        self._begin_hunt(fix_settings=settings, pings=reading.pings, heard=len(reading.pings), listening="")
        self._told(name, f"{len(reading.pings)} pings ({reading.layout})", reading.bad_records, reading.notes)

    def _open_profile(self, content, name) -> None:
        self.fix_settings = replace(
            self.fix_settings, profile=parse_profile_csv(decode_lines(content, name), name)
        )
        self._told(name, "sound-speed profile of the beacon hunt", (), ())

    def _open_arrays(self, content, name) -> None:
        reading = parse_arrays(content, name)
        self.survey = reading.survey
        self._told(name, f"{len(reading.survey.number)} arrays", reading.bad_records, reading.notes)
        self.gate()

    def _open_tfile(self, content, name) -> None:
        def done(tfile) -> None:
            self.tfile_content = content
            self.param.update(tfile=tfile, profile=tfile.profile() or self.profile, keep_lines=())
            self._told(
                name, f"{len(tfile.reports)} position reports", tfile.reports.bad_records, tfile.warnings
            )
            self.gate()

        def read(progress=None):
            return parse_tfile(content, name, header_records=None)

        if len(content) < LARGE_BYTES:
            done(read())
        else:
            self.jobs.start(f"Opening {name}", read, done)

    def _open_velocity(self, content, name) -> None:
        reading = parse_velocity(content, name)
        self.edit(profile=reading.profile)
        self._told(name, f"sound speed of {len(reading.profile.depth)} layers", reading.bad_records, ())

    def _open_crossover(self, content, name) -> None:
        reading = parse_crossover(content, name, self.survey)
        opened = self.gating.sets if self.gating is not None and self.tfile is None else ()
        sets = (*(one for one in opened if one.source != name), reading.set)
        self.param.update(tfile=None, gating=ready_sets(sets), correction=None, crossover=reading.set)
        self._told(name, f"{reading.set.points} point counts", reading.bad_records, reading.notes)

    def _open_offsets(self, content, name) -> None:
        table, bad = parse_offsets(decode_lines(content, name), name)
        self.offsets = table
        self._told(name, f"{len(table)} timing offsets", bad, ())

    def _open_edits(self, content, name) -> None:
        edits, bad = parse_edits(decode_lines(content, name), name)
        self.edit(edits=edits)
        self._told(name, f"{len(edits.reasons)} points left out", bad, ())

    def _told(self, name, what, bad_records, notes) -> None:
        parts = [f"{name}: {what}"]
        if bad_records:
            first = bad_records[0]
            parts.append(f"{len(bad_records)} bad lines, the first is line {first.line}: {first.why}")
        self.say("; ".join([*parts, *notes]))

    @param.depends("mode", "max_slant_range_ft", "gap_counts", "keep_lines", watch=True)
    def gate(self) -> None:
        """Gates the reports of the chosen vehicle and keeps the chosen set if it is still there."""
        if self.tfile is None or self.survey is None:
            return
        tfile = self.tfile
        settings = (self.survey, self.mode, self.max_slant_range_ft, self.gap_counts, tfile.run_date)

        def work(progress=None):
            return gate_reports(tfile.reports, *settings, keep_lines=self.keep_lines)

        if len(tfile.reports) < LARGE_REPORTS:
            self._gated(work())
        else:
            self.jobs.start("Gating", work, self._gated)

    def _gated(self, result: GatingResult) -> None:
        chosen = next((one for one in result.sets if same_set(one, self.crossover)), None)
        if chosen is None and result.sets:
            chosen = max(result.sets, key=lambda one: one.points)
        self.param.update(gating=result, correction=None, crossover=chosen)

    # -- timing of the sets --------------------------------------------------------------------

    @property
    def kept_sets(self) -> tuple[CrossoverSet, ...]:
        """Every set of the vehicle without the points left out by hand."""
        if self.gating is None:
            return ()
        return tuple(self.edits.kept(one, self.gating.mode) for one in self.gating.sets)

    def left_out(self, crossover: CrossoverSet) -> np.ndarray:
        """Which points (T,) of a set are left out by hand."""
        mode = self.mode if self.gating is None else self.gating.mode
        return self.edits.excluded(crossover, mode)

    @param.depends("gating", "survey", "profile", "edits", "timing_options", watch=True)
    def _forget_fits(self) -> None:
        self.fits = ()

    def fit_every_set(self) -> None:
        """Fits every set of the vehicle, off the event loop; the answer is `fits`."""
        if self.gating is None or self.survey is None or self.profile is None:
            self.say("Open a T-file and its array table first")
            return
        gating, sets, survey, profile = self.gating, self.gating.sets, self.survey, self.profile
        left_out, options = [self.left_out(one) for one in sets], self.timing_options

        def work(progress):
            fits = []
            for k, one in enumerate(sets):
                progress(k / max(len(sets), 1), f"set {k + 1} of {len(sets)}")
                try:
                    fits.append(fit_timing(one, survey, profile, left_out=left_out[k], **options))
                except InputError:  # an array that the table lacks
                    fits.append(None)
            return tuple(fits)

        def done(fits) -> None:
            if self.gating is gating:  # another vehicle may have been chosen meanwhile
                self.fits = fits

        self.jobs.start("Fit every set", work, done)

    def _begin_hunt(self, **state) -> None:
        self._past.clear()
        self._future.clear()
        self.param.update(
            playing=False, truth=None, fix=None, reasons={}, bearing_lines=(), opened=self.opened + 1, **state
        )

    def take_pings(self, pings: Pings, words: str, truth: dict | None = None) -> None:
        """Begins a hunt with pings that another tab found."""
        settings = replace(self.fix_settings, left_out=frozenset(), start=None)
        lines = self.bearing_lines
        self._begin_hunt(fix_settings=settings, pings=pings, heard=len(pings), listening="")
        self.param.update(truth=truth, bearing_lines=lines)
        self.say(words)

    # -- live pings ----------------------------------------------------------------------------

    def listen(self, source: str, simulated: bool = False) -> PingQueue:
        """Begins a hunt with pings as they come; a reader pushes them into the queue, from any thread.

        source : where they come from, in words, such as "receiver on COM3"
        """
        self._queue, self._log = PingQueue(), PingLog(source, simulated)
        settings = replace(self.fix_settings, left_out=frozenset(), start=None)
        self._begin_hunt(fix_settings=settings, pings=None, heard=0, listening=source, live=True)
        self.say(f"Listening to {source}")
        return self._queue

    def stop_listening(self) -> None:
        """Takes no further pings; those heard stay, and can be replayed."""
        self._take_waiting()
        self.listening = ""
        self._queue = PingQueue()

    def _take_waiting(self) -> None:
        """Adds the pings that wait to the hunt."""
        came = self._queue.drain()
        for ping in came:
            self._log.add(ping)
        if came:
            pings = self._log.pings()
            self.param.update(pings=pings, heard=len(pings))

    def _fix_live(self) -> None:
        """The live estimator told of every ping that it has not heard yet, off the event loop."""
        heard, settings = self.pings.only(slice(0, self.heard)), self.fix_settings
        count = self._log.count if self.listening else self.heard
        begun_for = (self.opened, settings)

        def work(progress):
            survey = self._live_survey
            if survey is None or self._live_of != begun_for or survey.told > count:
                try:
                    survey = LiveSurvey(heard, settings)
                except ValueError as error:
                    return replace(blank_fix(heard, settings)[0], reason=str(error))
                self._live_survey, self._live_of = survey, begun_for
            return survey.hear(heard, count)

        self._start_fix(work)

    # -- the fix and its replay ----------------------------------------------------------------

    @property
    def simulated(self) -> bool:
        """Whether anything shown is simulated."""
        return bool(
            (self.pings is not None and self.pings.simulated)
            or (self.tfile is not None and self.tfile.simulated)
        )

    @param.depends("pings", "fix_settings", "heard", "live", watch=True)
    def compute_fix(self) -> None:
        """Fixes the beacon from the pings heard so far, off the event loop, newest request first."""
        if self.pings is None:
            return
        if self.live and self.heard:
            self._fix_live()
            return
        heard, settings = self.pings.only(slice(0, self.heard)), self.fix_settings
        self._start_fix(lambda progress: fix_beacon(heard, settings))

    def _start_fix(self, work) -> None:
        opened = self.opened

        def done(fix):
            if self.opened == opened:  # another survey may be open by now
                self.fix = fix

        self.jobs.start("fix", work, done)

    def play(self) -> None:
        """Starts the replay, from the beginning if it stands at the end; pauses it if it runs."""
        if self.pings is None:
            return
        if self.listening:
            self.say(f"Pings come live from {self.listening}; stop listening to replay them")
            return
        if not self.playing and self.heard >= len(self.pings):
            self.heard = 0
        self._clock = float(self.pings.elapsed_s[max(self.heard - 1, 0)]) if self.heard else 0.0
        self.playing = not self.playing

    def tick(self, seconds: float) -> None:
        """Takes the pings that came, and lets the replay go on by some seconds of real time."""
        if self.listening:
            self._take_waiting()
        if not self.playing or self.pings is None:
            return
        self._clock += seconds * self.speed
        self.heard = int(self.pings.elapsed_s.searchsorted(self._clock, side="right"))
        if self.heard >= len(self.pings):
            self.playing = False

    # -- saving --------------------------------------------------------------------------------

    SAVED = ("mode", "max_slant_range_ft", "gap_counts", "speed", "live")

    def to_json(self) -> str:
        """Settings, choices and the names of the inputs as a session file."""
        settings = {
            field.name: getattr(self.fix_settings, field.name)
            for field in fields(self.fix_settings)
            if field.name not in ("profile", "left_out")
        }
        document = {
            "workbench_session": 1,
            "version": __version__,
            "simulated": self.simulated,
            "inputs": {
                "pings": self.pings.source if self.pings is not None else None,
                "tfile": self.tfile.reports.source if self.tfile is not None else None,
            },
            **{name: getattr(self, name) for name in self.SAVED},
            "fix_settings": settings,
            "left_out": {str(n): self.reasons.get(n, "") for n in sorted(self.fix_settings.left_out)},
            "chosen_set": None
            if self.crossover is None
            else [*self.crossover.pair, self.crossover.pass_number],
            "point_edits": edits_csv(self.edits),
            "timing_options": self.timing_options,
        }
        return json.dumps(document, indent=1)

    def _open_session(self, content, name) -> None:
        """Puts settings of a session file over the data that are open."""
        try:
            document = json.loads("\n".join(decode_lines(content, name)))
            kept = {key: document[key] for key in self.SAVED if key in document}
            told = document.get("fix_settings", {})
            told = {key: tuple(value) if isinstance(value, list) else value for key, value in told.items()}
            reasons = {int(number): str(why) for number, why in document.get("left_out", {}).items()}
            settings = replace(self.fix_settings, **told, left_out=frozenset(reasons))
            with param.parameterized.discard_events(self):
                self.param.update(**kept)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise InputError(f"{name}: not a session file of this program ({error})") from None
        self.param.update(fix_settings=settings, reasons=reasons)
        self.gate()
        if "point_edits" in document:
            self.edits = parse_edits(document["point_edits"].splitlines(), name)[0]
        self.timing_options = self.timing_options | document.get("timing_options", {})
        chosen = document.get("chosen_set")
        if chosen and self.gating is not None:
            for one in self.gating.sets:
                if [*one.pair, one.pass_number] == chosen:
                    self.crossover = one
        self.say(f"{name}: settings restored; the data files themselves are opened on their own")


def binary_kind(content: bytes) -> str | None:
    """The parameter that a sound or database is kept in, by its first bytes; None for anything else."""
    if content[:4] in (b"RIFF", b"RF64", b"fLaC", b"FORM", b"OggS"):
        return "recording"
    return "hunt_file" if content.startswith(b"SQLite format 3") else None


def same_set(one: CrossoverSet, other: CrossoverSet | None) -> bool:
    """Whether two sets are the same pass of the same two arrays."""
    return other is not None and one.pair == other.pair and one.pass_number == other.pass_number
