"""What would help: the next leg planned, drawn, dragged and saved."""

from __future__ import annotations

import html
import io
from dataclasses import replace

import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.beacon_map import LARGEST_DRAWN_M, BeaconMap, ellipse_ring
from dashboards.pictures.leg_layer import MOST_LEGS
from dashboards.pictures.mercator import from_mercator, mercator
from dashboards.session import Session
from dashboards.tabs.tab import number
from trackerlib.beacon.planning import (
    FASTEST_MPS,
    Leg,
    Plan,
    accuracy_map,
    forecast_leg,
    map_reach,
    plan_next_leg,
    surveys_so_far,
    worse_after,
)
from trackerlib.commands.plan import route_text
from trackerlib.textfiles import InputError

DRAG = (
    "<span style='opacity:.75'>To try another leg, choose “drag the end of a candidate leg” "
    "beside the map and drag a triangle.</span>"
)
MAP_CELLS = 21  # along each side of the map of attainable accuracy


class NextLeg:
    """Plans the next leg of a hunt on its map."""

    def __init__(self, session: Session, map_: BeaconMap):
        self.session, self.map = session, map_
        self.words = pn.pane.HTML(
            sizing_mode="stretch_width", margin=(0, 10), styles={"font-size": "14px"}, visible=False
        )
        self.budget = number(
            "Time for the next leg (min)", 30.0, "Candidates sail no longer than this", start=1.0
        )
        self.ship_speed = number(
            "Ship's speed (m/s)",
            FASTEST_MPS,
            "At most; above 5 m/s the flow past the hydrophone drowns the beacon",
        )
        self.button = pmui.Button(label="What would help?", size="small", variant="outlined", margin=(6, 8))
        self.button.on_click(lambda event: self.plan())
        self.save = pmui.FileDownload(
            label="Save the leg as GPX route", callback=self.route_file, filename="next-leg.gpx", size="small",
            visible=False, margin=(6, 8),
        )  # fmt: skip
        self._surveys: list = []
        self._shown: Plan | None = None
        self.map.leg.ends.on_change("data", lambda name, old, new: self._dragged())

    def clear(self) -> None:
        """Takes the plan away: it was for another fix."""
        if self._shown is not None:
            self._surveys, self._shown = [], None
            self.map.leg.clear()
            self.words.visible = self.save.visible = False

    def plan(self) -> None:
        """Looks for the leg that would help most, off the event loop."""
        session = self.session
        fix, settings, budget_s = session.fix, session.fix_settings, 60 * self.budget.value
        if fix is None:
            session.say("There is no fix to plan from yet")
            return
        heard, speed = session.pings.only(slice(0, len(fix.number))), self.ship_speed.value

        def work(progress):
            try:
                plan = plan_next_leg(heard, fix, settings, budget_s, speed)
            except ValueError as error:
                raise InputError(f"No leg can be planned: {error}") from None
            surveys = surveys_so_far(heard, fix, settings)
            progress(0.3, "map")
            reach = map_reach(plan, budget_s, speed)
            return plan, surveys, accuracy_map(surveys, reach, speed, cells=MAP_CELLS)

        def done(found):
            if session.fix is fix:
                self._surveys = found[1]
                self.map.leg.shade(fix, *found[2])
                self._show(distinct(found[0]))

        session.jobs.start("Plan", work, done)

    def _show(self, plan: Plan) -> None:
        self._shown = plan
        fix, best = self.session.fix, plan.best
        ring = None
        if fix.position is not None and best.ellipse.semi_major_m < LARGEST_DRAWN_M:
            ring = ellipse_ring(fix, fix.present.position, best.ellipse)
        self.map.leg.show(fix, plan.forecasts, ring)
        ends = [(*forecast.leg.end, 0.0) for forecast in plan.forecasts]
        lat, lon, _ = fix.frame.to_geodetic(ends)
        x, y = mercator(lat, lon)
        self.map.widen(list(x), list(y))
        words = html.escape(plan.words + self._too_long(best.leg))
        self.words.param.update(object=f"<b>What would help:</b> {words} {DRAG}", visible=True)
        self.save.visible = True

    def _too_long(self, leg: Leg) -> str:
        if leg.duration_s <= 60 * self.budget.value + 1:
            return ""
        return f" That takes longer than the {self.budget.value:g} min there are."

    def _dragged(self) -> None:
        """Forecasts the leg whose end the analyst drags, and makes it the one chosen."""
        moved = self.map.leg.dragged() if self._shown is not None else None
        if moved is None:
            return
        k, x, y = moved
        lat, lon = from_mercator(x, y)
        place = self.session.fix.frame.to_local(lat, lon, 0.0)
        leg = Leg(self._shown.forecasts[k].leg.start, place[:2], self.ship_speed.value)
        others = [one for j, one in enumerate(self._shown.forecasts) if j != k]
        forecasts = (forecast_leg(self._surveys, leg), *others)
        worse_after_s = worse_after(self._surveys, leg)
        self._show(replace(self._shown, forecasts=forecasts, worse_after_s=worse_after_s))

    def route_file(self) -> io.BytesIO:
        """The leg chosen as a GPX route."""
        return io.BytesIO(route_text(self._shown, self.session.fix).encode())


def distinct(plan: Plan) -> Plan:
    """The plan with the best leg of each bearing only, and always the one over the beacon."""
    kept: dict[float, object] = {}
    for forecast in plan.forecasts:
        kept.setdefault(round(forecast.leg.bearing_deg), forecast)
    few = list(kept.values())[: MOST_LEGS + 1]
    if plan.over_beacon is not None and not any(one.leg.over_beacon for one in few):
        few = [*few[:MOST_LEGS], plan.over_beacon]
    return replace(plan, forecasts=tuple(few))
