"""What one can turn on the Wet-paper chart: the thesis's menus, and ours."""

from __future__ import annotations

import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.wet_paper import LOOKS
from dashboards.session import SPEEDS, Session
from dashboards.tabs.chart_live import HUNTS
from dashboards.tabs.tab import choice, number
from trackerlib.acoustics.ambient_noise import LIMIT, SCALE, table_5_1
from trackerlib.live.receiver_poller import PollingSettings
from trackerlib.receiver.chart import ChartSettings
from trackerlib.receiver.front_end import ATTENUATIONS_DB, Attenuator
from trackerlib.receiver.report_receiver import ReceiverSettings
from trackerlib.receiver.sail import AUTOMATIC_GAIN, BAUD_RATES, FIRST_BAUD, ReceiverParameters
from trackerlib.simulation.hexagon import SCENARIOS
from trackerlib.surveyfiles.reading import DEFAULT_TURNAROUND_S

SURVEY, RECORDING, SIMULATION, RECEIVER, STORED = "survey", "recording", "simulated", "receiver", "stored"
DECK = "deck unit"  # whose pings lie on the paper as those of a survey log do
SOURCES = {
    "Survey log": SURVEY,
    "Recording": RECORDING,
    "Simulated sound": SIMULATION,
    "Receiver on its line": RECEIVER,
    "Deck unit on its line": DECK,
    "Stored receiver session": STORED,
}
SECOND_PINGERS = {"none": 0.0, "every 2.5 s": 2.5, "every 3 s": 3.0}  # which interferes with the beacon
NUDGE_S = 1e-4
COLUMNS = 1000
USUAL_THRESHOLD = 120


def sea_states() -> dict[str, float | str]:
    """Every whole number between the first and the last row of Table 5-1, and its "limit"."""
    rows = [int(row[0]) for row in table_5_1() if row[0] != LIMIT]
    return {str(state): float(state) for state in range(rows[0], rows[-1] + 1)} | {LIMIT: LIMIT}


def _button(label: str, **options):
    return pmui.Button(label=label, size="small", margin=(4, 3), **({"variant": "outlined"} | options))


def _path(label: str, tip: str):
    return pmui.TextInput(
        label=label, description=tip, size="small", sizing_mode="stretch_width", margin=(5, 8)
    )


class ChartControls:
    """The widgets; the tab says what they do."""

    def __init__(self, session: Session):
        self.session = session
        self._make_sources()
        self._make_paper()
        self._make_receiver()
        self._make_sound()
        self._make_hyperbola()
        self.show_source()

    def _make_sources(self) -> None:
        self.source = choice("Source", SOURCES, SURVEY)
        tip = "WAV, RF64 or FLAC on this machine, of any length; files up to 200 MB also by File, Open…"
        self.path, self.open_path = _path("Recording on this machine", tip), _button("Open and hear")
        tip = "NMEA 0183 log, or CSV with utc, lat_deg, lon_deg (or time_s from the recording's start)"
        self.navigation, self.open_navigation = (
            _path("Ship's positions beside it", tip),
            _button("Open positions"),
        )
        self.channel = number("Channel", 1, "Of the recording, from 1", start=1)
        self.began = _path(
            "Recording began (UTC)", "2024-05-01T12:34:56.5; empty: as its head or its name tells"
        )
        self.seed = number("Seed", 1, "Of noise, pings not sent and GPS errors of the simulated hunt")
        self.sea_state = choice(SCALE[0].upper() + SCALE[1:], sea_states(), 3.0)
        self.second = choice("Second pinger", SECOND_PINGERS, 0.0)
        self.simulate = _button("Simulate and hear", variant="contained")
        tip = "Serial device such as /dev/ttyUSB0 or COM3, or tcp:HOST:PORT"
        self.address, self.connect = _path("Device or address", tip), _button("Connect", variant="contained")
        self.emulate = _button("Start emulator")
        tip = "Serial device (/dev/ttyUSB1@4800 tells its rate), tcp:HOST:PORT or udp:PORT; empty: the same line"
        self.positions = _path("Positions from", tip)
        self.stored, self.open_stored = (
            _path("Stored session on this machine", "A .session file"), _button("Open")
        )  # fmt: skip
        self._where = {
            SURVEY: pn.Column(margin=0),
            RECORDING: pn.Column(
                self.path,
                self.channel,
                self.open_path,
                self.navigation,
                self.began,
                self.open_navigation,
                margin=0,
            ),
            SIMULATION: pn.Column(
                self.seed,
                self.sea_state,
                self.second,
                self.simulate,
                margin=0,
                sizing_mode="stretch_width",
            ),
            RECEIVER: pn.Column(
                self.address, self.positions, pn.Row(self.connect, self.emulate, margin=0), margin=0
            ),
            STORED: pn.Column(self.stored, self.open_stored, margin=0),
        }
        self.where = pn.Column(*self._where.values(), margin=0, sizing_mode="stretch_width")
        self._where[DECK] = self._where[RECEIVER]

    def _make_paper(self) -> None:
        defaults = ChartSettings()
        self.play = _button("Play", icon="play_arrow", variant="contained")
        self.at_once, self.clear = _button("To the end"), _button("Clear")
        self.speed = pmui.Select.from_param(
            self.session.param.speed, label="Speed", options={f"x{speed}": speed for speed in SPEEDS},
            size="small", sizing_mode="stretch_width", margin=(5, 8),
        )  # fmt: skip
        self.interval = number(
            "Fold interval (s)",
            self.session.fold_s,
            "Period at which arrivals are folded: one line of paper. Steps of 0.1 ms; 2 s unless told",
            step=NUDGE_S,
            format="0.0000",
        )
        self.shorter, self.longer = _button("−0.1 ms"), _button("+0.1 ms")
        self.straighten = _button("Straighten")
        self.threshold = number(
            "Threshold (0 to 255)",
            USUAL_THRESHOLD,
            "Level below which the stylus leaves no mark and an arrival does not count; 120 unless told",
            start=0,
            end=255,
            step=5,
        )
        self.look = choice("Look", {name: name for name in LOOKS}, "paper")
        self.contrast = pmui.FloatSlider(
            label="Contrast", value=1.0, start=0.5, end=3.0, step=0.1, size="small",
            sizing_mode="stretch_width", margin=(0, 14),
        )  # fmt: skip
        self.left_edge = number(
            "Left edge (s)",
            defaults.offset_s,
            "Arrival time that falls on the left edge of the paper",
            step=0.01,
        )
        self.history = number(
            "Lines kept",
            1000,
            "Lines of paper that can be scrolled back to, 500 to 2000",
            start=500,
            end=2000,
            step=500,
        )

    def _make_receiver(self) -> None:
        defaults = ReceiverParameters()
        self.attenuator = choice(
            "Attenuator (dB)", {"auto": "auto", **{str(db): db for db in ATTENUATIONS_DB}}, "auto"
        )
        self.maxima = number(
            "Maxima a period", defaults.maxima, "Arrivals kept of each period", start=1, end=100
        )
        self.window = number(
            "Window (samples)",
            defaults.window_samples,
            "No two arrivals of a period lie closer; 20 unless told",
            start=1,
        )
        self.period = number(
            "Period (samples)",
            defaults.period_samples,
            "Whole samples of the receiver's clock; 2000 unless told",
            start=2,
        )
        self.sample = number(
            "Sample interval (ms)",
            1.0,
            "Calibrated; the original's crystal gives 1.0005",
            step=0.0001,
            format="0.0000",
        )
        self.measured = _button("As the receiver's line tells")
        self.baud = choice("Baud", {str(rate): rate for rate in BAUD_RATES}, FIRST_BAUD)
        self.send = _button("Tell the receiver")
        self.feed = pmui.Checkbox(
            label="Arrivals feed the beacon fix", value=True, size="small", margin=(2, 8)
        )
        self.folder = _path(
            "Keep the hunt in", "Folder for the session file and every raw byte; empty keeps nothing"
        )
        self.folder.value = HUNTS
        self.turnaround = number(
            "Turnaround (ms)",
            1e3 * DEFAULT_TURNAROUND_S,
            "Of the transponder, inside the times of a deck unit's host mode; 13 ms unless told",
            start=0.0,
        )
        self.scenario = choice("Emulated beacon: scenario", {str(k): k for k in SCENARIOS}, 2)
        self.rate = number(
            "Receiver's time against ours",
            1.0,
            "1 for a real receiver; the emulator may run faster",
            start=1.0,
            end=100.0,
        )
        self.emulator_port = number("Emulator's TCP port", 0, "0 takes a free one", start=0, end=65535)

    def _make_sound(self) -> None:
        defaults = ReceiverSettings()
        self.detector = choice(
            "Detector", {"the report's receiver": "report", "modern matched filter": "modern"}, "report"
        )
        self.carrier = number(
            "Carrier (Hz)", defaults.carrier_hz, "Of the pinger; 10 kHz unless told", step=100.0
        )
        self.pulse = number(
            "Pulse (ms)", 1e3 * defaults.pulse_s, "Length of a pulse; 10 ms unless told", step=1.0
        )

    def _make_hyperbola(self) -> None:
        self.fit, self.accept = _button("Hyperbola", variant="contained"), _button("Accept trace")
        self.unmark, self.unline = _button("Clear marks"), _button("Clear bearing lines")
        self.keep_line = _button("Line to the map")
        self.clock_sigma = number(
            "Interval known to (µs)", 10.0,
            "Standard error of the fold interval as the beacon's own: a wrong one tilts the trace; 10 µs unless told",
            start=0.0,
        )  # fmt: skip

    def in_sight(self) -> list:
        """At most nine rows."""
        return [
            self.source,
            self.where,
            pn.Row(self.play, self.at_once, self.clear, margin=0),
            self.speed,
            self.interval,
            pn.Row(self.shorter, self.longer, self.straighten, margin=0),
            self.threshold,
            pn.Row(self.look, self.contrast, margin=0, sizing_mode="stretch_width"),
            pn.Column(
                pn.Row(self.fit, self.keep_line, margin=0),
                pn.Row(self.accept, self.unmark, margin=0),
                margin=0,
            ),
        ]

    def folded(self) -> dict[str, list]:
        """The rest, in sections."""
        return {
            "Receiver": [
                self.attenuator, self.maxima, self.window, self.period, self.baud, self.send, self.feed, self.folder,
                self.turnaround,
            ],
            "Detector and sound": [self.detector, self.carrier, self.pulse, self.sample, self.measured],
            "Emulator": [self.scenario, self.rate, self.emulator_port],
            "Paper": [self.left_edge, self.history],
            "Hyperbola": [self.clock_sigma, self.unline],
        }  # fmt: skip

    def show_source(self) -> None:
        """Shows what belongs to the chosen source."""
        shown = self._where[self.source.value]
        for place in self._where.values():
            place.visible = place is shown
        self.emulate.visible = self.source.value == RECEIVER

    # -- what they say -------------------------------------------------------------------------

    def chart_settings(self) -> ChartSettings:
        """How arrivals are laid on paper. Raises ValueError for what makes no sense."""
        return ChartSettings(self.interval.value or 0.0, COLUMNS, self.left_edge.value or 0.0)

    @property
    def sample_s(self) -> float:
        """The calibrated sample interval [s]."""
        return 1e-3 * (self.sample.value or 0.0)

    def receiver_settings(self) -> ReceiverSettings:
        """The receiver's chain for sound. Raises ValueError, naming the setting, for one that makes no sense."""
        step = self.attenuator.value
        return ReceiverSettings(
            carrier_hz=self.carrier.value or 0.0,
            pulse_s=1e-3 * (self.pulse.value or 0.0),
            interval_s=(self.period.value or 0) * self.sample_s,
            maxima=self.maxima.value or 0,
            window_s=(self.window.value or 0) * self.sample_s,
            sample_interval_s=self.sample_s,
            attenuator=Attenuator(step == "auto", 0 if step == "auto" else step),
        )

    def parameters(self) -> ReceiverParameters:
        """What a receiver on its line is told of the signal. Raises ValueError."""
        return ReceiverParameters(self.period.value or 0, self.maxima.value or 0, self.window.value or 0)

    @property
    def attenuation(self) -> int | str:
        """The attenuator as the line's protocol names it."""
        return AUTOMATIC_GAIN if self.attenuator.value == "auto" else self.attenuator.value

    def line_settings(self) -> PollingSettings:
        """What a receiver on its line is told, and how it is asked. Raises ValueError."""
        return PollingSettings(self.parameters(), self.sample_s, self.attenuation)
