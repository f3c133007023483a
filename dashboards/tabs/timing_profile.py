"""Editor of the sound-speed profile: a table, a picture whose points can be dragged, and the rays through it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import panel as pn
from panel_splitjs import Split

from dashboards.pictures.profile_views import ProfileViews
from dashboards.session import Session
from dashboards.tabs.pages import button, fill, words
from dashboards.tabs.tab import TABLE, choice
from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.rangefiles.range_profile import LAYOUTS, parse_range_profile
from trackerlib.textfiles import InputError

DEPTH, SPEED = "depth (ft)", "speed (ft/s)"
EDITED = "edited here"


class ProfilePage:
    """The profile of the range; every change is an edit that Undo takes back."""

    def __init__(self, session: Session):
        self.session = session
        self.views = ProfileViews()
        self.opened: SoundSpeedProfile | None = None
        self._quiet = False
        self.words = words()
        self.layout = choice("Layout of the file", LAYOUTS, "middle")
        self.file = pn.widgets.FileInput(accept=".dat,.DAT,.csv,.txt,.VEL", margin=(6, 8), width=220)
        self.file.param.watch(lambda event: self._upload(event.new), "value")
        self.again = button("As it was opened", self.restore)
        self.which = choice("Rays of", {"the first array": 0, "the second array": 1}, 0)
        self.which.param.watch(lambda event: self._draw_rays(), "value")
        self.table = pn.widgets.Tabulator(
            pd.DataFrame({DEPTH: [], SPEED: []}), show_index=False, sizing_mode="stretch_both", theme="simple",
            layout="fit_columns", stylesheets=[TABLE], margin=(4, 4), min_height=80,
            configuration={"columnDefaults": {"headerSort": False}},  # a profile has one order
        )  # fmt: skip
        self.table.on_edit(lambda event: self._typed())
        self.views.points.on_change("data", lambda attr, old, new: self._dragged())
        self.pane = pn.Column(
            pn.Row(self.layout, self.file, self.again, self.which, margin=0),
            self.words,
            Split(
                Split(self.table, fill(self.views.profile), sizes=(34, 66), sizing_mode="stretch_both"),
                fill(self.views.paths),
                sizes=(55, 45),
                sizing_mode="stretch_both",
            ),
            sizing_mode="stretch_both",
            margin=0,
        )

    def show(self) -> None:
        """The session's profile, and the rays of the chosen set through it."""
        profile = self.session.profile
        if profile is None:
            self.words.object = (
                "<b>No profile is open.</b> Open a VELOCITY.DAT, or a T-file whose header has one."
            )
            return
        if EDITED not in profile.notes:
            self.opened = profile
        self._quiet = True
        try:
            self.views.show_profile(profile, self.opened)
            self.table.value = pd.DataFrame({DEPTH: profile.depth.round(2), SPEED: profile.speed.round(2)})
        finally:
            self._quiet = False
        self._draw_rays()

    def _draw_rays(self) -> None:
        session = self.session
        if session.crossover is None or session.survey is None or session.profile is None:
            self.words.object = "Rays are drawn for a set whose arrays are known."
            return
        which = self.which.value
        track = (session.crossover.x, session.crossover.y)[which]
        number = session.crossover.pair[which]
        try:
            position = session.survey.position_of(number)
        except InputError as error:
            self.words.object = f"<b>No rays can be drawn:</b> {error}."
            return
        missed = self.views.show_rays(session.profile, position, track, which)
        above = int(np.sum(-track[:, 2] > -position[2]))
        notes = session.profile.notes
        also = (
            " The profile was edited here." if EDITED in notes else "".join(f" Note: {one}." for one in notes)
        )
        told = f"Direct rays from array {number} reach all {len(track)} points of the track."
        if missed:
            told = (
                f"<b>No direct ray reaches {missed} of {len(track)} points</b> from array {number}: refraction turns "
                "them away. These points take no part in the timing."
            )
        if above:
            told += f" {above} points lie deeper than the array; their rays go down."
        self.words.object = told + also

    # -- what the analyst does -----------------------------------------------------------------

    def _upload(self, content: bytes | None) -> None:
        if not content:
            return
        try:
            reading = parse_range_profile(content, self.file.filename or "profile", self.layout.value)
        except InputError as error:
            self.session.report(error)
            return
        self.session.edit(profile=reading.profile)
        bad = [f"{len(reading.bad_records)} rows could not be read"] if reading.bad_records else []
        told = [f"{self.file.filename}: {len(reading.profile.depth)} depths", *bad, *reading.profile.notes]
        self.session.say("; ".join(told))

    def _typed(self) -> None:
        frame = self.table.value
        self._change(frame[DEPTH].to_numpy(float), frame[SPEED].to_numpy(float))

    def _dragged(self) -> None:
        if self._quiet:
            return
        depth, speed = (np.asarray(self.views.points.data[name], float) for name in ("depth", "speed"))
        self._change(depth, speed)

    def _change(self, depth: np.ndarray, speed: np.ndarray) -> None:
        """Takes new depths and speeds, or says why they are no profile and shows the last one again."""
        profile = self.session.profile
        if self._quiet or profile is None:
            return
        if np.array_equal(depth, profile.depth) and np.array_equal(speed, profile.speed):
            return
        order = np.argsort(depth, kind="stable")
        try:
            changed = replace(profile, depth=depth[order], speed=speed[order], notes=(EDITED,))
        except ValueError as error:
            self.session.report(InputError(str(error)))
            self.show()
            return
        self.session.edit(profile=changed)
        self.session.say("The profile is changed; Ctrl+Z undoes")

    def restore(self) -> None:
        """Takes the profile as it was opened."""
        if self.opened is not None and self.session.profile is not self.opened:
            self.session.edit(profile=self.opened)
            self.session.say("The profile is as it was opened; Ctrl+Z undoes")
