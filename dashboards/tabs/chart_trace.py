"""What the analyst does with a trace: marks it, fits its hyperbola, puts its line on the map, accepts its pings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import panel as pn

from dashboards.tabs.chart_controls import RECEIVER, SIMULATION
from dashboards.tabs.chart_sources import SimulatedHuntSound
from trackerlib.live.recorded_pings import Trace, followed_trace, receptions_of
from trackerlib.receiver.hyperbola import Marks
from trackerlib.receiver.rolls import PingRoll
from trackerlib.textfiles import InputError


class TraceActions:
    """The part of the tab that works on the trace."""

    # -- marks, hyperbola, fix -----------------------------------------------------------------

    def _tapped(self, x: float, y: float) -> None:
        if self.roll is None or x is None:
            return
        self.marks.click(self.roll, self.settings, y, x, self.threshold)
        if 0 <= y < self._stop():
            lat, lon = self.roll.ship(np.atleast_1d(self.roll.line_time(self.settings, int(y))))
            self.session.pointed = (float(lat[0]), float(lon[0])) if np.isfinite(lat[0]) else None

    def _dragged(self) -> None:
        source = self.paper.arrivals
        chosen = [k for k in source.selected.indices if k < len(source.data["row"])]
        if chosen and self.roll is not None:
            source.selected.indices = []
            self.marks.choose(self.roll, self.settings, np.asarray(source.data["row"])[chosen])

    def _fit(self) -> None:
        if self.roll is None:
            raise InputError("there is no trace yet")
        settings = self._known_settings()
        self.marks.fit(
            self.roll,
            self.settings,
            settings.sound_speed_mps,
            settings.speed_sigma_mps,
            1e-6 * (self.controls_.clock_sigma.value or 0.0),
        )
        self._show_marks()
        self._tell()

    def _keep_line(self) -> None:
        found = self.marks.found
        if found is None or found.line is None:
            raise InputError("mark a trace and press Hyperbola first: the bearing line comes from it")
        self.session.edit(bearing_lines=(*self.session.bearing_lines, found.line))
        self.session.say(
            "The bearing line is on the map beside and in the tab Beacon fix; Undo takes it back"
        )

    def _known_settings(self):
        """Settings of a fix, with what is known of simulated water."""
        settings = self.session.fix_settings
        if isinstance(self.sound, SimulatedHuntSound) and self.kind == SIMULATION:
            hunt = self.sound.hunt
            settings = replace(
                settings, profile=None, sound_speed_mps=hunt.sound_speed_mps, gps_rms_m=hunt.gps_rms_m,
                hydrophone_depth_m=hunt.hydrophone_depth_m, sample_interval_ms=1.0,
            )  # fmt: skip
        return settings

    def _accept(self) -> None:
        """The marked trace, or without marks the pinger followed through all arrivals, as pings of the beacon fix."""
        if self.roll is None:
            raise InputError("there is no trace yet")
        if isinstance(self.roll, PingRoll):
            raise InputError("a survey log's pings are in the beacon fix already")
        if self.kind == RECEIVER and self.live.receiver is not None:
            raise InputError(
                "a connected receiver's pings go to the beacon fix as they come; disconnect first"
            )
        settings = self._known_settings()
        trace = self._marked_trace() if self.marks.marks else self._followed_trace()
        receptions = receptions_of(
            trace, self.settings.interval_s, self.roll.fixes,
            began_s=None if self.sound is None else self.sound.began_s,
            source=self.roll.source, simulated=self.roll.simulated,
        )  # fmt: skip
        _, ship = receptions.pings(self.session.position_limits, self.session.antenna_offset_m)
        if ship.accepted.sum() < 3:
            refused = "".join(f"; {words}" for words in ship.words)
            raise InputError(
                f"where the ship was is not known for three of these arrivals, so they cannot make a fix{refused}"
            )
        self._accepted[self.kind] = (receptions.number, receptions.arrival_s)
        with pn.io.hold():
            if settings is not self.session.fix_settings:
                self.session.fix_settings = settings
            self.session.take_receptions(
                receptions,
                f"{int(ship.accepted.sum())} arrivals of {self.roll.source} are the pings of the tab Beacon fix",
                self.sound.truth if self.sound is not None else None,
            )

    def _marked_trace(self) -> Trace:
        """The arrivals marked, unfolded."""
        interval_s = self.settings.interval_s
        line, time_s, sigma = self.marks.times(self.roll, self.settings)
        fold_s, nowhere = time_s - self.roll.time_of(self.settings, line, 0.0), np.zeros(len(line))
        return Trace(line, time_s, Marks(line, fold_s, sigma, nowhere, nowhere, interval_s).unfolded_s())

    def _followed_trace(self) -> Trace:
        """The pinger followed through all arrivals."""
        interval_s = self.settings.interval_s
        trace = followed_trace(self.roll.arrivals, interval_s, self.threshold)
        if not len(trace.emission):
            raise InputError(
                f"no pings at about {interval_s:g} s can be followed through these arrivals; straighten the "
                "interval, change the threshold, or mark the trace"
            )
        return trace
