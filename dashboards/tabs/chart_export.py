"""What leaves the chart: the paper as PNG and PDF, arrivals as CSV, a piece of the sound, the folded signal."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import panel as pn
import panel_material_ui as pmui
import soundfile

from dashboards.session import Session
from dashboards.tabs.chart_sources import SoundSource
from dashboards.tabs.tab import number
from trackerlib.commands.listen import csv_text
from trackerlib.exports.paper_print import PaperPrint, print_paper
from trackerlib.receiver.front_end import DB_PER_COUNT
from trackerlib.receiver.recording import SIMULATED
from trackerlib.receiver.rolls import PingRoll, Roll
from trackerlib.textfiles import InputError

HEARD_LINES = 20  # newest lines that are averaged for the folded signal
TONE_HZ, TONE_RATE_HZ = 800.0, 8000


@dataclass(frozen=True, eq=False)
class OnPaper:
    """What an export is of."""

    roll: Roll
    paper: PaperPrint
    source: SoundSource | None  # where the sound can be read again


class ChartFiles:
    """Buttons that save; `shown` gives what is on the paper, or None."""

    def __init__(self, session: Session, shown: Callable[[], OnPaper | None]):
        self.session, self._shown = session, shown
        small = {"size": "small", "margin": (4, 4)}
        self.png = pmui.FileDownload(
            label="PNG", callback=lambda: self._paper("png"), filename="paper.png", **small
        )
        self.pdf = pmui.FileDownload(
            label="PDF", callback=lambda: self._paper("pdf"), filename="paper.pdf", **small
        )
        self.csv = pmui.FileDownload(label="CSV", callback=self._arrivals, filename="arrivals.csv", **small)
        self.wav = pmui.FileDownload(label="WAV", callback=self._excerpt, filename="excerpt.wav", **small)
        self.from_s = number(
            "Excerpt from (s)", 0.0, "First second of the WAV excerpt, from the sound's beginning"
        )
        self.for_s = number("for (s)", 10.0, "Length of the WAV excerpt, at most 60 s", start=0.1, end=60.0)
        self.hear = pmui.Button(
            label="Hear the folded signal", size="small", variant="outlined", margin=(4, 8)
        )
        self.hear.on_click(lambda event: self._play())
        self.audio = pn.pane.Audio(None, visible=False, margin=(2, 8), sizing_mode="stretch_width", name="")

    def controls(self) -> list:
        """Its widgets."""
        return [
            pn.Row(self.png, self.pdf, self.csv, self.wav, margin=0),
            pn.Row(self.from_s, self.for_s, margin=0),
            self.hear,
            self.audio,
        ]

    def _saved(self, make: Callable[[OnPaper], bytes]) -> io.BytesIO:
        """A file, or an empty one and a sentence why."""
        try:
            shown = self._shown()
            if shown is None:
                raise InputError("there is nothing on the paper to export yet")
            return io.BytesIO(make(shown))
        except (InputError, ValueError, OSError) as error:
            self.session.report(error if isinstance(error, InputError) else InputError(str(error)))
            return io.BytesIO(b"")

    def _paper(self, layout: str) -> io.BytesIO:
        return self._saved(lambda shown: print_paper(shown.paper, layout))

    def _arrivals(self) -> io.BytesIO:
        return self._saved(lambda shown: arrivals_text(shown).encode())

    def _excerpt(self) -> io.BytesIO:
        return self._saved(lambda shown: excerpt(shown, self.from_s.value or 0.0, self.for_s.value or 10.0))

    def _play(self) -> None:
        shown = self._shown()
        if shown is None:
            self.session.report(InputError("there is nothing on the paper to hear yet"))
            return
        self.audio.param.update(
            object=folded_signal(shown.paper), sample_rate=TONE_RATE_HZ, visible=True, autoplay=True
        )


def arrivals_text(shown: OnPaper) -> str:
    """Arrivals on the paper as CSV, with a head that says what they are of."""
    roll, interval_s = shown.roll, shown.paper.interval_s
    label = "# SIMULATED DATA\n" if roll.simulated else ""
    head = f"{label}# {roll.source}, folded at {interval_s:.6f} s\n"
    if isinstance(roll, PingRoll):
        stop = shown.paper.first_line + len(shown.paper.lines)
        pings, folded = roll.pings.only(slice(0, stop)), np.mod(roll.pings.arrival_s[:stop], interval_s)
        rows = (
            f"{n},{'' if np.isnat(u) else f'{u}Z'},{t:.6f},{f:.6f}\n"
            for n, u, t, f in zip(pings.number, pings.utc, pings.arrival_s, folded, strict=True)
        )
        return head + "ping,utc,arrival_s,fold_s\n" + "".join(rows)
    return head + csv_text(roll.arrivals, interval_s, False)


def excerpt(shown: OnPaper, first_s: float, length_s: float) -> bytes:
    """A WAV of a piece of the sound. Raises InputError where there is no sound."""
    if shown.source is None:
        raise InputError("this source has no sound to save: only a recording or simulated sound has")
    samples, rate_hz = shown.source.excerpt(max(first_s, 0.0), max(first_s, 0.0) + length_s)
    if not len(samples):
        raise InputError(f"the sound has ended before {first_s:g} s")
    file = io.BytesIO()
    with soundfile.SoundFile(file, "w", rate_hz, channels=1, format="WAV", subtype="PCM_24") as wav:
        if shown.roll.simulated:
            wav.comment = SIMULATED
        wav.title = f"{shown.roll.source}, {first_s:g} s to {first_s + len(samples) / rate_hz:g} s"
        wav.write(samples)
    return file.getvalue()


def folded_signal(paper: PaperPrint) -> np.ndarray:
    """The newest lines averaged, as the loudness of a tone (K,) int16 at TONE_RATE_HZ: what stays put is heard."""
    level = paper.lines[-HEARD_LINES:].mean(axis=0)
    time_s = np.arange(int(paper.interval_s * TONE_RATE_HZ)) / TONE_RATE_HZ
    column = np.minimum((time_s / paper.interval_s * len(level)).astype(int), len(level) - 1)
    loudness = 10 ** ((level[column] - 255) * DB_PER_COUNT / 20)
    loudness /= max(loudness.max(), 1e-9)
    return np.int16(28_000 * loudness * np.sin(2 * np.pi * TONE_HZ * time_s))
