"""Estimators, noise models and motions side by side."""

from __future__ import annotations

import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.beacon_map import BeaconMap
from dashboards.session import Session
from dashboards.tabs.beacon_words import estimators_table, models_table
from trackerlib.beacon.choice import compare_models, usual_estimators, usual_models
from trackerlib.beacon.fix import fix_beacon


class SideBySide:
    """Fixes the pings heard in every usual way, and scores the motions."""

    def __init__(self, session: Session, map_: BeaconMap, shown):
        self.session, self.map, self._shown = session, map_, shown
        self.button = pmui.Button(label="Compare estimators", size="small", variant="outlined", margin=(6, 8))
        self.button.on_click(lambda event: self.compare())
        self.estimators = pn.pane.HTML(HINT, sizing_mode="stretch_width", margin=(4, 10), styles=TEXT)
        self.motions = pn.pane.HTML(sizing_mode="stretch_width", margin=(4, 10), styles=TEXT)
        self._known = False

    def panel(self):
        """Both tables."""
        return pn.Column(
            self.button,
            self.estimators,
            self.motions,
            scroll="y",
            sizing_mode="stretch_both",
            min_height=0,
            margin=0,
        )

    def clear(self) -> None:
        """Takes the comparison away: it was of other pings."""
        if self._known:
            self._known = False
            self.estimators.object, self.motions.object = HINT, ""
            self.map.show_compared({})

    def compare(self) -> None:
        """Compares off the event loop; first the estimators, then the motions, which takes longer."""
        session = self.session
        if session.pings is None or session.heard == 0:
            session.say("There are no pings to compare estimators on yet")
            return
        heard, settings, of = session.pings.only(slice(0, session.heard)), session.fix_settings, session.fix

        def estimators(progress):
            ways, fixes = usual_estimators(settings), {}
            for k, (name, one) in enumerate(ways.items()):
                progress(k / len(ways), name)
                fixes[name] = fix_beacon(heard, one)
            return fixes

        def show_estimators(fixes) -> None:
            if session.fix is not of:
                return
            self._known = True
            self.estimators.object = estimators_table(fixes)
            self.map.show_compared(fixes)
            self._shown()
            session.jobs.start(
                "Compare motions",
                lambda progress: compare_models(heard, usual_models(settings)),
                show_motions,
                long=True,
            )

        def show_motions(scores) -> None:
            if session.fix is of:
                self.motions.object = models_table(scores)

        session.jobs.start("Compare estimators", estimators, show_estimators)


TEXT = {"font-size": "13px"}
HINT = "<i>Compare estimators</i> fixes these pings in every usual way and shows the answers here and on the map."
