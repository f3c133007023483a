"""What the chart is drawn from: opening, simulating, hearing, connecting, and the receiver's own menus."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from dashboards.jobs import Cancelled
from dashboards.tabs.chart_controls import DECK, RECEIVER, RECORDING, SIMULATION, STORED, SURVEY
from dashboards.tabs.chart_sources import RecordedSound, SimulatedHuntSound, stored_hunt
from dashboards.tabs.chart_words import deck_words, feed_words, position_notes, ranges_words, receiver_words
from trackerlib.live.navigation_file import BeginUnknown, read_navigation_file
from trackerlib.receiver.recording_start import instant_in
from trackerlib.rounding import value_with_sigma
from trackerlib.simulation.hunt_sound import second_pinger
from trackerlib.textfiles import InputError, decode_lines, read_bytes

EMULATOR_RATE = 20.0  # of an emulator started here, unless told


class Inputs:
    """The part of the tab that turns a person's choice of a source into a roll of paper."""

    def _take_files(self) -> None:
        """What File, Open… has put into the session since the last look."""
        for name, take in (
            ("recording", self._open_recording),
            ("hunt_file", self._open_stored),
            ("navigation_file", self._open_navigation),
        ):
            file = getattr(self.session, name)
            if file is not None and file is not self._taken.get(name):
                self._taken[name] = file
                self._try(lambda take=take, file=file: take(file.path, file.name))

    # -- sources -------------------------------------------------------------------------------

    def _choose_source(self) -> None:
        self.controls_.show_source()
        self._strip_pane.visible = self.kind != SURVEY
        self.roll, self.sound = self._rolls.get(self.kind), self._sounds.get(self.kind)
        self._clock_s, self._running = math.inf, False
        self.session.chart_marks = ()
        if self.kind == SURVEY:
            self._show_survey()
        if self.kind == RECEIVER:
            self.roll = self.live.roll
        self._redraw()

    def _redraw(self) -> None:
        self._draw(again=True)
        self._draw_left_out()
        self._show_marks()
        self.map.frame()
        self._tell()

    def _show_as(self, kind: str) -> None:
        """Turns the source's menu to a kind, without what follows a person's doing so."""
        self._quiet = True
        self.controls_.source.value = kind
        self._quiet = False
        self._choose_source()

    def _open_recording(self, path: Path, name: str | None = None) -> None:
        if str(path) in ("", "."):
            raise InputError("name a recording on this machine, or use File, Open…")
        sound = RecordedSound(path, name, self.controls_.channel.value or 1)
        self._sounds[RECORDING] = sound
        self._show_as(RECORDING)
        self._hear_again()
        if self._navigation is not None:
            self._place_recording()

    def _change_channel(self) -> None:
        sound = self._sounds.get(RECORDING)
        if isinstance(sound, RecordedSound):
            self._open_recording(sound.path, sound.name)

    def _open_navigation(self, path: Path, name: str | None = None) -> None:
        if str(path) in ("", "."):
            raise InputError("name a file of the ship's positions on this machine, or use File, Open…")
        self._navigation = (path, name or path.name)
        if RECORDING in self._sounds:
            self._place_recording()
        else:
            self.session.say(f"{self._navigation[1]}: positions, which wait for the recording beside them")

    def _place_recording(self) -> None:
        """Reads the positions beside the recording, off the event loop, and lays them under its paper."""
        if self._navigation is None or RECORDING not in self._sounds:
            return
        (path, name), sound = self._navigation, self._sounds[RECORDING]
        told = self.controls_.began.value.strip()
        began_s = instant_in(told) if told else sound.head_began_s
        if told and began_s is None:
            raise InputError(f"Recording began is {told!r}; wanted UTC such as 2024-05-01T12:34:56.5")

        def work(progress):
            try:
                return read_navigation_file(decode_lines(read_bytes(path), name), name, began_s)
            except BeginUnknown as error:
                raise InputError(f"{error}; fill in Recording began (UTC)") from None

        def done(navigation):
            if self._sounds[RECORDING] is not sound:
                return  # another was opened meanwhile, and reads them for itself
            sound.fixes, sound.began_s = navigation.fixes, began_s
            sound.simulated |= navigation.simulated
            roll = self._rolls.get(RECORDING)
            if roll is not None:
                roll.fixes, roll.simulated = sound.fixes, sound.simulated
            sound.position_notes = position_notes(
                navigation, name, roll, self.threshold, self.session.position_limits
            )
            if self.kind == RECORDING:
                self._redraw()
            self.session.say("; ".join(sound.position_notes))

        self.session.jobs.start("Positions", work, done)

    def _simulate(self) -> None:
        c = self.controls_
        seed, sea_state = c.seed.value or 0, c.sea_state.value
        others = (second_pinger(c.second.value),) if c.second.value else ()

        def done(sound):
            self._sounds[SIMULATION] = sound
            self._show_as(SIMULATION)
            self._try(self._hear_again)

        self.session.jobs.start(
            "Simulate", lambda progress: SimulatedHuntSound(seed, sea_state, others=others), done
        )

    def _hear_again(self) -> None:
        """Hears the sound from its beginning, off the event loop; lines come as they are heard."""
        sound = self._sounds.get(self.kind)
        if sound is None:
            return
        settings, detector = self.controls_.receiver_settings(), self.controls_.detector.value
        roll = sound.new_roll(settings)
        self.roll, self.sound = roll, sound
        self._rolls[self.kind] = roll
        self._hearing += 1
        mine, self._clock_s, self._running = self._hearing, math.inf, False
        self._redraw()

        def work(progress):
            def told(share, text):
                if self._hearing != mine:
                    raise Cancelled
                progress(share, text)

            try:
                return sound.listen(detector, settings, roll, told)
            except ValueError as error:
                raise (
                    error if isinstance(error, InputError) else InputError(f"{sound.name}: {error}")
                ) from None

        def done(heard):
            if sound.position_notes:
                self._place_recording()  # counts anew what has a position
            if self.roll is heard:
                self._draw()
                self.map.frame()
                self._tell()
                label = "SIMULATED sound" if sound.simulated else "recording"
                self.session.say(
                    "; ".join([f"{sound.name}: {label}, {heard.until_s:.0f} s heard", *sound.notes[1:]])
                )

        self.session.jobs.start("Hear", work, done)

    def _open_stored(self, path: Path, name: str | None = None) -> None:
        if str(path) in ("", "."):
            raise InputError("name a stored session on this machine, or use File, Open…")

        def done(found):
            self._rolls[STORED], settings, ranged = found
            if ranged is not None:
                pings, words = ranged
                self.session.take_pings(pings, words)
                self._show_as(SURVEY)
                return
            self._show_as(STORED)
            self.session.say(
                f"{found[0].source}: {len(np.unique(found[0].arrivals.period))} periods, "
                f"{len(found[0].fixes.time_s)} positions, by {settings.get('port', 'an unknown port')}"
            )

        self.session.jobs.start("Open", lambda progress: stored_hunt(path, name or path.name), done)

    def _emulate(self) -> None:
        c = self.controls_
        if self.live.emulator is not None:
            self.live.disconnect()
            self.live.stop_emulator()
            self.session.say("The emulator has stopped")
            self._tell()
            return
        rate = c.rate.value if (c.rate.value or 1.0) != 1.0 else EMULATOR_RATE
        emulator = self.live.emulate(c.scenario.value, rate, c.emulator_port.value or 0)
        c.rate.value = rate
        c.address.value = emulator.line.address
        self.session.say(
            f"SIMULATED receiver and GPS at {emulator.line.address}, {rate:g} times as fast as time; press Connect"
        )
        self._tell()

    def _connect(self) -> None:
        c = self.controls_
        if self.live.receiver is not None or self.deck.listening:
            lost = "; ".join(filter(None, (self.live.disconnect(), self.deck.disconnect())))
            self._tell()
            if lost:
                raise InputError(lost)
            self.session.say("Disconnected; what was heard stays")
            return
        turnaround_s = 1e-3 * (c.turnaround.value or 0.0)
        if c.source.value == DECK:
            self.deck.connect(c.address.value, c.positions.value, turnaround_s, c.folder.value)
            self._tell()
            return
        self.live.threshold, self.live.feeding = self.threshold, c.feed.value
        self.live.connect(
            c.address.value,
            c.line_settings(),
            self.session.fold_s,
            c.rate.value or 1.0,
            c.folder.value,
            c.positions.value,
            turnaround_s,
        )
        self.roll = self._rolls[RECEIVER] = self.live.roll
        self._redraw()

    def _tell_line(self) -> None:
        """How the receiver or the deck unit on its line does, and the line of positions beside it."""
        on_deck = self.controls_.source.value == DECK
        self.status_words.visible = on_deck or self.kind == RECEIVER
        if on_deck:
            kept = "" if self.deck.file is None else str(self.deck.file)
            self.status_words.object = deck_words(self.deck.status, self.deck.placer, self.deck.placed, kept)
        if self.kind == RECEIVER:
            live, status = self.live, self.live.status
            kept = "" if live.file is None or status is None else str(live.file)
            measured = (math.nan, math.nan) if status is None else live.receiver.measured_sample_interval_s
            words = receiver_words(status, len(live.followed[0]), live.unplaced, kept, measured)
            if live.feed is not None:
                words += f"<br>{feed_words(live.feed_status)}"
                if live.placer.ranges:
                    words += f"<br>{ranges_words(live.placer, live.placed)} {live.which_hunt}"
            self.status_words.object = words

    def _take_measured(self) -> None:
        """Fills in the sample interval that the line tells, for what is heard and connected from now on."""
        receiver = self.live.receiver
        interval_s, sigma_s = (
            (math.nan, math.nan) if receiver is None else receiver.measured_sample_interval_s
        )
        if math.isnan(interval_s):
            raise InputError(
                "the sample interval is measured while a receiver is connected, from three periods on"
            )
        self.controls_.sample.value = round(1e3 * interval_s, 7)
        told = value_with_sigma(1e3 * interval_s, 1e3 * sigma_s, "ms")
        self.session.say(
            f"Sample interval {told} by this machine's clock; a receiver is taken at it from Connect on"
        )

    # -- the receiver's menus ------------------------------------------------------------------

    def _tell_receiver(self) -> None:
        parameters = self.controls_.parameters()
        if self.live.receiver is not None and self.kind == RECEIVER:
            self.live.receiver.set_parameters(parameters)
            self.session.say("The receiver is told as soon as its line is free; sampling then begins anew")
        else:
            self._hear_again()

    def _change_attenuator(self) -> None:
        if self.live.receiver is not None:
            self.live.receiver.set_attenuation(self.controls_.attenuation)
        if self.kind != RECEIVER:
            self._hear_again()

    def _change_baud(self) -> None:
        if self.live.receiver is not None:
            self.live.receiver.set_baud(self.controls_.baud.value)

    def _type(self, text: str) -> None:
        if self.live.receiver is None:
            self.session.say("No receiver is connected; choose the source Receiver on its line, and connect")
            return
        self.live.receiver.type(text.encode("ascii", "replace"))
