"""The correction applied: a corrected copy of the T-file, the merged track of the whole run, its hand-overs."""

from __future__ import annotations

import io

import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.offset_views import Jumps
from dashboards.session import Session
from dashboards.tabs.pages import button, fill, words
from dashboards.tabs.tab import choice
from trackerlib import __version__
from trackerlib.crossover.gating import gate_mode_and_flag
from trackerlib.rangefiles.corrected_tfile import corrected_copy
from trackerlib.rangefiles.run_track_file import hand_overs_csv, run_track_csv
from trackerlib.timing.one_run import RunVerdict
from trackerlib.timing.run_track import RunTrack, correct_run
from trackerlib.timing.track_correction import correct_reports

SLIDERS, RUN = "the sliders", "what the run agrees on"


class ApplyPage:
    """One offset for the whole run, single-array parts included.

    clock : gives offset [s], drift [s/count] and t0 of the sliders
    """

    def __init__(self, session: Session, clock):
        self.session, self._clock = session, clock
        self.verdict: RunVerdict | None = None
        self.run: RunTrack | None = None
        self.jumps = Jumps()
        self.words = words("14px")
        self.what = choice("Offset and drift of", {SLIDERS: SLIDERS, RUN: RUN}, RUN)
        self.what.param.watch(lambda event: self.apply(), "value")
        self.button = button("Apply", self.apply)
        self.tfile = _download("Corrected T-file", self.tfile_copy, "corrected.dat")
        self.track = _download("Merged track", lambda: self.run_file(run_track_csv), "track.csv")
        self.hand_overs = _download("Hand-overs", lambda: self.run_file(hand_overs_csv), "hand-overs.csv")
        self.pane = pn.Column(
            pn.Row(
                pn.Column(self.what, width=260, margin=0),
                self.button,
                self.tfile,
                self.track,
                self.hand_overs,
                margin=0,
            ),
            self.words,
            fill(self.jumps.figure),
            sizing_mode="stretch_both",
            margin=0,
        )

    def chosen(self) -> tuple[float, float, float]:
        """Offset [s], drift [s/count] and t0 that are applied."""
        serves = None if self.verdict is None else self.verdict.simplest
        if self.what.value == SLIDERS or serves is None:
            return self._clock()
        return serves.offset_s, serves.drift_s_per_count, serves.mean_count

    def apply(self) -> None:
        """Corrects the whole run off the event loop and shows the jumps at its hand-overs."""
        session = self.session
        ready = session.tfile is not None and session.survey is not None and session.profile is not None
        self.tfile.disabled = self.track.disabled = self.hand_overs.disabled = not ready
        if not ready:
            self.words.object = "A T-file, its arrays and a profile are wanted: sets alone hold no whole run."
            return
        vehicle = gate_mode_and_flag(session.tfile.reports, session.gating.mode)
        survey, profile, limit = session.survey, session.profile, session.max_slant_range_ft
        clock = self.chosen()

        def work(progress):
            try:
                return correct_run(vehicle, survey, profile, limit, *clock, gap_counts=session.gap_counts)
            except ValueError as error:
                return str(error)

        session.jobs.start("Correct the run", work, lambda found: self._show(found, clock))

    def _show(self, found: RunTrack | str, clock: tuple[float, float, float]) -> None:
        if isinstance(found, str):
            self.run, self.words.object = None, f"<b>The run cannot be corrected:</b> {found}."
            return
        self.run = found
        before, after = found.mean_jump
        missed, alone = int((~found.reached).sum()), int((found.arrays == 1).sum())
        self.words.object = (
            f"With {clock_words(*clock, decimals=3)} applied to all {len(found.reports)} positions, {alone} "
            f"of {len(found.track)} point counts seen by one array alone, <b>the step where one array hands the track "
            f"to the next shrinks from {before:.1f} to {after:.1f} ft</b> (root mean square of "
            f"{len(found.hand_overs)} hand-overs)."
            + (f" {missed} positions lie where no direct ray reaches and stay as reported." if missed else "")
        )
        self.jumps.show(found.hand_overs)

    def provenance(self) -> str:
        """What a file says of how it was made."""
        session = self.session
        return (
            f"tracker workbench {__version__}: {session.gating.source}, mode {session.gating.mode}, "
            f"{clock_words(*self.chosen())}; profile {session.profile.name}, arrays {session.survey.source}"
        )

    def run_file(self, written) -> io.BytesIO:
        """The merged track or its hand-overs as CSV, for the browser to save; `written` makes the text."""
        if self.run is None:
            self.apply()
        run, simulated = self.run, self.session.simulated
        if run is not None:
            self.session.say(
                f"{len(run.track)} point counts, {len(run.hand_overs)} hand-overs: saved to your downloads"
            )
        return io.BytesIO(b"" if run is None else written(run, self.provenance(), simulated).encode())

    def tfile_copy(self) -> io.BytesIO:
        """A copy of the T-file with this vehicle's positions corrected, for the browser to save."""
        session = self.session
        moved = correct_reports(
            session.tfile.reports, session.survey, session.profile, *self.chosen(), mode=session.gating.mode
        )  # fmt: skip
        copy = corrected_copy(
            session.tfile_content, session.tfile, moved.which, moved.position,
            "CORRECTED COPY" + ", SIMULATED DATA" * session.simulated + f", {self.provenance()}",
        )  # fmt: skip
        session.say(f"{int(copy.written.sum())} positions corrected in the copy; the original is untouched")
        return io.BytesIO(copy.content)


def clock_words(offset_s: float, drift_s_per_count: float, t0: float, *, decimals: int = 6) -> str:
    """An offset and a drift in one phrase, the offset in ms with so many decimals."""
    words_ = f"an offset of {1e3 * offset_s:.{decimals}f} ms"
    if drift_s_per_count:
        words_ += f" at count {t0:.1f} and a drift of {1e3 * drift_s_per_count:.3g} ms a count"
    return words_


def _download(label: str, make, name: str):
    return pmui.FileDownload(label=label, callback=make, filename=name, size="small", margin=(6, 8))
