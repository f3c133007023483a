"""Which of the ship's positions are good enough for a reception, and where the hydrophone hangs from the antenna."""

from __future__ import annotations

import html

import panel as pn

from dashboards.session import Session
from dashboards.tabs.beacon_settings import optional, typed
from dashboards.tabs.tab import number
from trackerlib.beacon.navigation import PositionLimits, ShipPositions
from trackerlib.textfiles import InputError

WAYS = {
    "forward": "From antenna to hydrophone, towards the bow",
    "starboard": "From antenna to hydrophone, to the right of the bow",
    "down": "From antenna to hydrophone; it moves no position, the depth is that of Hydrophone depth",
}
OWN_POSITIONS = (
    "This survey came with positions of its own, so these limits and the offset do not apply to it. They do where "
    "instants of arrival and the ship's positions are opened side by side, where the Wet-paper chart hands on what it "
    "heard, and to pings that come from a receiver."
)
LIVE = (
    "A change judges all arrivals of this hunt again, and says what it refused; ranges of a deck unit that were heard "
    "keep their positions."
)


class PositionControls:
    """Widgets for the limits and the antenna's offset, with what they refuse; a change makes the pings afresh."""

    def __init__(self, session: Session):
        self.session = session
        self._quiet = False
        limits = session.position_limits
        self.hdop = number(
            "Greatest HDOP",
            limits.greatest_hdop,
            "Positions of this dilution of precision or more are refused; 10 unless told",
            step=1.0,
        )
        self.age = number(
            "Greatest age (s)",
            limits.greatest_age_s,
            "From a position to an arrival, either side; 2 s unless told",
            step=0.5,
        )
        self.gap = optional(
            "Greatest gap (s)",
            "twice the age",
            "Between two positions that is interpolated across; empty: twice the greatest age",
        )
        self.offset = [
            number(f"Hydrophone {way} (m)", value, tip, step=0.5)
            for (way, tip), value in zip(WAYS.items(), session.antenna_offset_m, strict=True)
        ]
        self.words = pn.pane.HTML(sizing_mode="stretch_width", margin=(2, 10), styles={"font-size": "13px"})
        for widget in (self.hdop, self.age, self.gap):
            widget.param.watch(lambda event: self._set_limits(), "value")
        for widget in self.offset:
            widget.param.watch(lambda event: self._set_offset(), "value")

    def controls(self) -> list:
        """What stands in the folded section."""
        return [self.hdop, self.age, self.gap, *self.offset, self.words]

    def show(self) -> None:
        """Makes the widgets say what the session has, and tells what is refused."""
        limits, gap = self.session.position_limits, self.session.position_limits.greatest_gap_s
        self._quiet = True
        try:
            self.hdop.value, self.age.value = limits.greatest_hdop, limits.greatest_age_s
            self.gap.value = "" if gap is None else f"{gap:g}"
            for widget, value in zip(self.offset, self.session.antenna_offset_m, strict=True):
                widget.value = value
        finally:
            self._quiet = False
        if self.session.placed is not None:
            self.words.object = placed_words(self.session.placed)
        else:
            self.words.object = LIVE if self.session.listening else OWN_POSITIONS

    def _set_limits(self) -> None:
        if self._quiet:
            return
        try:
            limits = PositionLimits(self.hdop.value or 0.0, self.age.value or 0.0, typed(self.gap.value))
        except ValueError as error:
            self.session.report(InputError(str(error)))
            self.show()
            return
        self.session.edit(position_limits=limits)

    def _set_offset(self) -> None:
        if not self._quiet:
            self.session.edit(antenna_offset_m=tuple(widget.value or 0.0 for widget in self.offset))


def placed_words(placed: ShipPositions) -> str:
    """At how many arrivals the ship's place is known, and what was refused, as HTML."""
    lines = [f"{int(placed.accepted.sum())} of {len(placed.time_s)} arrivals have a position", *placed.words]
    return "<br>".join(html.escape(line) for line in lines)
