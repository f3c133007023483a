"""What the tabs of one browser page share. Two pages never share a Session."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import param

from dashboards.jobs import Jobs
from dashboards.live import PingQueue
from dashboards.opening import Opening, SoundFile
from dashboards.session_file import session_json
from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.live_survey import LiveSurvey
from trackerlib.beacon.navigation import PositionLimits, Receptions, ShipPositions
from trackerlib.beacon.pings import Ping, PingLog, Pings
from trackerlib.beacon.result import BeaconFix, blank_fix
from trackerlib.beacon.settings import FixSettings
from trackerlib.crossover.edits import PointEdits
from trackerlib.crossover.gating import GatingResult, gate_reports
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.campaign import Campaign, CampaignRun
from trackerlib.rangefiles.tfile import TFileReading
from trackerlib.textfiles import InputError
from trackerlib.timing.correction import fit_timing
from trackerlib.timing.offsets import OffsetTable

log = logging.getLogger("workbench")

LARGE_REPORTS = 100_000  # from here on they are gated off the event loop
SPEEDS = (1, 5, 20, 100, 1000)
MODE_NAMES = {2: "ship", 7: "torpedo"}


class Session(param.Parameterized):
    """State that tabs read, watch and write back; every value is one of trackerlib's frozen types."""

    # The range
    campaign = param.ClassSelector(class_=Campaign, allow_None=True, doc="whose runs can be chosen")
    campaign_run = param.ClassSelector(class_=CampaignRun, allow_None=True, doc="the run in sight")
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
    transponders = param.ClassSelector(
        class_=tuple, default=(), doc="names in the survey that is open, where it holds several"
    )
    transponder = param.String(default="", doc="the one of them whose pings are in sight")
    fix_settings = param.ClassSelector(class_=FixSettings, default=FixSettings())
    fix = param.ClassSelector(class_=BeaconFix, allow_None=True, doc="of the pings heard so far")
    truth = param.Dict(default=None, allow_None=True, doc="known or published place of the beacon, if any")
    reasons = param.Dict(default={}, doc="why pings were left out by hand, by their number")
    receptions = param.ClassSelector(
        class_=Receptions,
        allow_None=True,
        doc="what the pings are made of; None where they came with positions",
    )
    placed = param.ClassSelector(class_=ShipPositions, allow_None=True, doc="where the ship was at each")
    position_limits = param.ClassSelector(class_=PositionLimits, default=PositionLimits())
    antenna_offset_m = param.Tuple(
        default=(0.0, 0.0, 0.0), doc="antenna to hydrophone: forward, starboard, down"
    )
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
        self._opening = Opening(self)
        self._clock = 0.0  # seconds of survey time since its first ping
        self._queue, self._log = PingQueue(), PingLog()
        self._live_survey: LiveSurvey | None = None
        self._live_of: tuple = ()  # what the live estimator was begun for
        self._heard_again = 0  # times that the pings of a live hunt were put in the place of others
        self._placed_by: tuple = ()  # limits, offset and depth by which the pings were made

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
        self.say("Undone; Ctrl+Shift+Z does it again")
        self._future.append(self._past.pop())
        self.param.update(**self._future[-1]["before"])

    def redo(self) -> None:
        """Makes the last edit taken back again."""
        if not self._future:
            self.say("Nothing to redo")
            return
        self.say("Done again; Ctrl+Z undoes")
        self._past.append(self._future.pop())
        self.param.update(**self._past[-1]["after"])

    def forget_edits(self) -> None:
        """Nothing can be undone any more: other data are open."""
        self._past.clear()
        self._future.clear()

    # -- opening -------------------------------------------------------------------------------

    def open_file(self, name: str, content: bytes) -> None:
        """Opens an upload of any kind the tabs know; raises InputError for what none of them reads."""
        self._opening.upload(name, content)

    def open_path(self, path: str) -> None:
        """Opens a file of this machine, a campaign with all that it names; raises InputError as `open_file`."""
        self._opening.path(path)

    def open_run(self, run: CampaignRun) -> None:
        """Opens a run of the campaign; raises InputError, and keeps the last run, where its files are no use."""
        self._opening.run(run)

    def open_transponder(self, which: str) -> None:
        """Opens the pings of another transponder of the survey that is open."""
        self._opening.transponder(which)

    def open_beacon_demo(self) -> None:
        """Opens the simulated beacon survey that comes with the program."""
        self._opening.beacon_demo()

    def open_range_demo(self) -> None:
        """Opens the simulated range run that comes with the program."""
        self._opening.range_demo()

    def close(self) -> None:
        """Lets go of what the session keeps on disk."""
        self._opening.close()

    @param.depends("mode", watch=True)
    def _follow_vehicle(self) -> None:
        """Another vehicle of the same T-file is another run of the campaign, if the campaign has it."""
        run = self.campaign_run
        if run is not None and run.mode != self.mode:
            beside = (one for one in self.campaign.runs if (one.tfile, one.mode) == (run.tfile, self.mode))
            self.campaign_run = next(beside, replace(run, mode=self.mode, vehicle=""))

    @property
    def day_and_run(self) -> tuple[str, str]:
        """How a table of offsets names the day and run in sight: as the campaign does, else by header and file."""
        if self.campaign_run is not None:
            return self.campaign_run.day, self.campaign_run.run
        if self.tfile is None:
            return "unknown", "crossover files"
        day, name = self.tfile.run_date, Path(self.tfile.reports.source).stem
        return "unknown" if np.isnat(day) else str(day), f"{name} mode {self.mode}"

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

    def begin_hunt(self, **state) -> None:
        """Other pings, or none yet: what belonged to the last hunt goes."""
        self.forget_edits()
        made_of = {"receptions": None, "placed": None, "transponders": (), "transponder": ""}
        self.param.update(
            playing=False, truth=None, fix=None, reasons={}, bearing_lines=(), opened=self.opened + 1,
            **(made_of | state),
        )  # fmt: skip

    def take_pings(self, pings: Pings, words: str, truth: dict | None = None, **made_of) -> None:
        """Begins a hunt with pings that another tab found."""
        settings = replace(self.fix_settings, left_out=frozenset(), start=None)
        lines = self.bearing_lines
        self.begin_hunt(fix_settings=settings, pings=pings, heard=len(pings), listening="", **made_of)
        self.param.update(truth=truth, bearing_lines=lines)
        self.say(words)

    def take_receptions(self, receptions: Receptions, words: str, truth: dict | None = None) -> None:
        """Begins a hunt with pings made of arrivals and positions; raises ValueError as `Receptions.pings` does."""
        self._placed_by = self.placing
        pings, placed = receptions.pings(*self.placing)
        words = "; ".join([words, *placed.words])
        self.take_pings(pings, words, truth, receptions=receptions, placed=placed)

    @property
    def placing(self) -> tuple[PositionLimits, tuple, float]:
        """By what arrivals and positions are made into pings: limits, antenna offset, hydrophone's depth."""
        return self.position_limits, self.antenna_offset_m, self.fix_settings.hydrophone_depth_m

    @param.depends("position_limits", "antenna_offset_m", "fix_settings", watch=True)
    def _place_again(self) -> None:
        """Other limits, another offset or depth: the pings are made afresh, off the event loop."""
        receptions, placing = self.receptions, self.placing
        if receptions is None or placing == self._placed_by:
            return
        self._placed_by = placing

        def done(made: tuple[Pings, ShipPositions]) -> None:
            if self.receptions is not receptions or self._placed_by != placing:
                return
            pings, placed = made
            heard = len(pings) if self.heard >= len(self.pings) else min(self.heard, len(pings))
            self.param.update(pings=pings, placed=placed, heard=heard, fix=None)
            self.say(
                "; ".join([f"{len(pings)} of {len(placed.time_s)} arrivals have a position", *placed.words])
            )

        self.jobs.start("Ship's positions", lambda progress: receptions.pings(*placing), done)

    # -- live pings ----------------------------------------------------------------------------

    def listen(self, source: str, simulated: bool = False) -> PingQueue:
        """Begins a hunt with pings as they come; a reader pushes them into the queue, from any thread.

        source : where they come from, in words, such as "receiver on COM3"
        """
        self._queue, self._log = PingQueue(), PingLog(source, simulated)
        settings = replace(self.fix_settings, left_out=frozenset(), start=None)
        self.begin_hunt(fix_settings=settings, pings=None, heard=0, listening=source, live=True)
        self.say(f"Listening to {source}")
        return self._queue

    def hear_again(self, queue: PingQueue, pings: Iterable[Ping]) -> None:
        """Puts other pings in the place of those of a live hunt; of one that is over nothing is touched."""
        if queue is not self._queue:
            return
        queue.drain()
        self._log = PingLog(self._log.source, self._log.simulated)
        for ping in pings:
            self._log.add(ping)
        self._heard_again += 1
        heard = self._log.pings()
        self.param.update(pings=heard, heard=len(heard), fix=None)

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
        begun_for = (self.opened, settings, self.placed, self._heard_again)

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
        opened, placed, again = self.opened, self.placed, self._heard_again

        def done(fix):
            # Another survey may be open by now, or the pings of this one made afresh.
            if self.opened == opened and self.placed is placed and self._heard_again == again:
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

    def to_json(self) -> str:
        """Settings, choices and the names of the inputs as a session file."""
        return session_json(self)


def same_set(one: CrossoverSet, other: CrossoverSet | None) -> bool:
    """Whether two sets are the same pass of the same two arrays."""
    return other is not None and one.pair == other.pair and one.pass_number == other.pass_number
