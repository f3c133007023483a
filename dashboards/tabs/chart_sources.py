"""Where the chart's sound comes from: recordings, simulated sound, stored hunts. Heard in a job, block by block."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dashboards.jobs import Progress
from trackerlib.beacon.pings import Pings
from trackerlib.live.deck_pings import pings_of_ranges
from trackerlib.live.hunt import hunt_of
from trackerlib.live.recorded_pings import utc_at
from trackerlib.live.session_file import RecordedSession, read_session
from trackerlib.receiver.detectors import hear
from trackerlib.receiver.recording import BLOCK_S, SIMULATED, Recording
from trackerlib.receiver.recording_start import instant_in
from trackerlib.receiver.report_receiver import ReceiverSettings
from trackerlib.receiver.rolls import NO_FIXES, MarkRoll, SoundRoll
from trackerlib.simulation.hunt_sound import HuntSound, simulate_hunt_sound
from trackerlib.textfiles import InputError

SHOW_EVERY_S = 0.2  # of progress told
MODERN_FULL_SCALE = 0.1  # darkest, so that both detectors' levels of a usual recording are alike
LATE_ARRIVALS_S = 5.0  # after the end of a period, by which every detector has told of it
LONGEST_EXCERPT_S = 60.0


class SoundSource:
    """Sound that can be heard from its beginning as often as wanted."""

    name = ""
    simulated = False
    rate_hz = 0
    seconds = 0.0  # of the whole, 0 if not known before it is read

    def __init__(self):
        self.notes: list[str] = []
        self.position_notes: list[str] = []  # on the positions beside it
        self.fixes = NO_FIXES
        self.began_s: float | None = None  # its first sample, since 1970, if that is known
        self.truth: dict | None = None

    def new_roll(self, settings: ReceiverSettings) -> SoundRoll:
        """An empty roll for what will be heard."""
        roll = SoundRoll(
            self.name, self.simulated, settings.sample_interval_s, settings.interval_s + LATE_ARRIVALS_S
        )
        roll.fixes = self.fixes
        return roll

    def utc_of(self, seconds: float) -> np.datetime64 | None:
        """UTC of a time of the sound; None if it is not known."""
        return None if self.began_s is None else utc_at(self.began_s, [seconds])[0]

    def blocks(self) -> Iterator[np.ndarray]:
        """Its samples in blocks of BLOCK_S, from the first."""
        raise NotImplementedError

    def listen(
        self, detector: str, settings: ReceiverSettings, roll: SoundRoll, progress: Progress
    ) -> SoundRoll:
        """Feeds the roll with all of it. Raises InputError, or ValueError for settings that make no sense."""
        told = 0.0
        for heard in hear(detector, settings, self.rate_hz, self.blocks(), BLOCK_S, MODERN_FULL_SCALE):
            roll.feed(heard)
            if time.monotonic() - told > SHOW_EVERY_S:
                told = time.monotonic()
                share = roll.until_s / self.seconds if self.seconds else 0.0
                progress(min(share, 1.0), f"{roll.until_s:.0f} s of sound")
        roll.finish()
        return roll

    def excerpt(self, first_s: float, last_s: float) -> tuple[np.ndarray, int]:
        """Samples (K,) between two times, and their rate; at most LONGEST_EXCERPT_S of them."""
        last_s = min(last_s, first_s + LONGEST_EXCERPT_S)
        first, last, at, parts = round(first_s * self.rate_hz), round(last_s * self.rate_hz), 0, []
        for block in self.blocks():
            if at + len(block) > first:
                parts.append(block[max(first - at, 0) : max(last - at, 0)])
            at += len(block)
            if at >= last:
                break
        return np.concatenate(parts) if parts else np.empty(0, np.float32), self.rate_hz


class RecordedSound(SoundSource):
    """A sound file. Raises InputError for what is none."""

    def __init__(self, path: Path, name: str | None = None, channel: int | None = None):
        super().__init__()
        self.path, self.channel = path, channel
        self.name = name or path.name
        with Recording(path, channel) as recording:
            self.rate_hz, self.simulated = recording.rate_hz, recording.simulated
            self.seconds = recording.promised / recording.rate_hz
            self.head_began_s = recording.began[0] if recording.began else instant_in(Path(self.name).stem)
        self.began_s = self.head_began_s

    def blocks(self):
        with Recording(self.path, self.channel) as recording:
            yield from recording.blocks()
            recording.check()
            self.notes = recording.notes()


class SimulatedHuntSound(SoundSource):
    """SIMULATED sound of a ship that passes a beacon twice. Raises InputError for a setting that makes no sense."""

    simulated = True

    def __init__(self, seed: int, sea_state: float | str, **options):
        super().__init__()
        try:
            self.hunt: HuntSound = simulate_hunt_sound(seed, sea_state=sea_state, **options)
        except ValueError as error:
            raise InputError(f"the sound cannot be simulated: {error}") from None
        self.name, self.rate_hz, self.seconds = self.hunt.name, self.hunt.rate_hz, self.hunt.seconds
        self.truth, self.fixes = self.hunt.truth, self.hunt.fixes

    def blocks(self):
        sound, count = self.hunt.open(), round(self.seconds * self.rate_hz)
        block = round(BLOCK_S * self.rate_hz)
        while (left := count - sound.position) > 0:
            yield sound.read(min(block, left))


def stored_hunt(path: Path, name: str) -> tuple[MarkRoll, dict, tuple[Pings, str] | None]:
    """What a stored session of a receiver holds, and its settings; if a deck unit's, its pings in words.

    Raises InputError.
    """
    recorded = read_session(path)
    arrivals, fixes = hunt_of(recorded)
    roll = MarkRoll(name, any(SIMULATED in words for _, words in recorded.events))
    roll.fixes = fixes
    run = max(recorded.runs, key=lambda number: len(recorded.runs[number])) if recorded.runs else None
    until = 0.0
    if run is not None:
        last = recorded.runs[run][-1]
        until = (last.number + 1) * last.period_samples * recorded.settings.get("sample_interval_s", 1e-3)
    roll.add(arrivals, until)
    return roll, recorded.settings, _ranged(recorded, name, roll.simulated) if run is None else None


def _ranged(recorded: RecordedSession, name: str, simulated: bool) -> tuple[Pings, str] | None:
    """Pings of a deck unit's session, and how they came about; None if it has no ranges."""
    if not recorded.ranges:
        return None
    pings, placer = pings_of_ranges(recorded, name, simulated)
    if not len(pings):
        raise InputError(f"{name}: none of its {placer.ranges} ranges has a ship's position")
    return (
        pings,
        f"{name}: {len(pings)} pings of {placer.ranges} ranges of a deck unit, {placer.no_reply} without reply",
    )
