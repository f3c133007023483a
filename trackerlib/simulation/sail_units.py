"""The thesis's receiver and a GPS on one SAIL line, character by character, from a simulated beacon.

    line = SailLine(SimulatedHunt(SCENARIOS[2]), clock=time.monotonic)
    line.answer(b"#PTR ")                # b"#PTR \\r\\n:\\x03"

The controller's program as the listing of Wojcik (1993), appendix 2, has it, with the slips of the listing mended
unless one is asked for by its name in FAULTS. Of the two load characters that both print as a comma, the comma
here announces a new address and the semicolon goes on with data, which is inferred. Everything here is simulated.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator

import numpy as np

from trackerlib.receiver.front_end import ATTENUATIONS_DB, next_step
from trackerlib.receiver.sail import (
    ATTENUATOR_CODES,
    BAUD_RATES,
    FIRST_BAUD,
    GPS,
    MAXIMA_ADDRESS,
    MOST_MAXIMA,
    PERIOD_ADDRESS,
    PROMPT,
    RECEIVER,
    WINDOW_ADDRESS,
    Maximum,
    ReceiverParameters,
)
from trackerlib.simulation.beacon_levels import SimulatedHunt, controller_maxima, largest_sums, moving_sums

FAULTS = {
    "deaf": "a bad baud code leaves the receiver deaf until a hardware reset",
    "gain-step": "no step from 9 to 12 dB: the automatic gain falls from 9 to 0",
    "edges": "a loud signal near the end of a period takes the place of the first maximum, which is lost",
    "clock": "the receiver's sample interval is 1.0005 ms, so 2000 samples are 2.001 s",
    "echo": "a character is not echoed now and then",
    "parity": "the units send even parity, now and then a wrong one",
    "stop": "an answer stops in mid-message now and then",
    "flood": "a unit sends thousands of characters now and then",
    "no-fix": "the GPS has no position now and then",
}
SAMPLE_S = 1e-3
CLOCK_FAULT = 1.0005  # timer compare of 2001 counts instead of 2000
MOST_BEHIND = 16  # periods worked through when nobody has asked for long
EPROM = 0xE800
CONTINUE, NEW_ADDRESS = ord(";"), ord(",")
FLOOD = b"U" * 20_000
HELP_TEXT = (
    "elp SAIL DRIVER Mon, Jun 7, 1993, 11:53",
    "MONITOR: space prompt*, ?Maaaa llll dump*, !Maaaa dd load*  (* returns a prompt)",
    "ATTENUATOR: A0 0 dB, A1 3 dB, A2 9 dB, A3 12 dB, A4 18 dB, A5 24 dB, A6 30 dB, AA automatic",
    "O start sampling, P pause, R restart",
    "RCA UT4 conventions: numbers are hex and end with space or return",
    "SIMULATED RECEIVER",
)

Program = Generator[None, int, None]


class Unit:
    """Something on the line that answers to its name; takes characters one by one."""

    def __init__(self, name: str):
        self.name = name
        self.baud = FIRST_BAUD
        self._said = bytearray()
        self._program: Program | None = None

    def hear(self, character: int) -> bytes:
        """What the unit says after one more character. Any # begins a new address."""
        if character == ord("#"):
            self._program = self._after_hash()
            next(self._program)
        elif self._program is not None:
            try:
                self._program.send(character)
            except StopIteration:
                self._program = None
        said, self._said = bytes(self._said), bytearray()
        return said

    def _after_hash(self) -> Program:
        name = bytes([(yield), (yield)])
        if name == b"00":
            digits = []
            for _ in range(5):
                digits.append((yield))
            self._change_baud(bytes(digits).replace(b" ", b"0"))
            return
        if (name + bytes([(yield)])).decode("latin-1") == self.name:
            yield from self._addressed()

    def _change_baud(self, digits: bytes) -> None:
        if digits.isdigit() and int(digits) in BAUD_RATES:
            self.baud = int(digits)

    def _addressed(self) -> Program:
        """Takes commands until one is not known."""
        while True:
            character = yield
            if character in b" \r":
                self._say(PROMPT)
            elif not (yield from self._command(character)):
                return

    def _command(self, character: int) -> Generator[None, int, bool]:
        raise NotImplementedError

    def _say(self, text: bytes) -> None:
        self._said += text


class ReceiverUnit(Unit):
    """The receiver: samples, keeps the maxima of each period, steps its attenuator."""

    def __init__(self, hunt: SimulatedHunt, clock: Callable[[], float], faults: frozenset[str] = frozenset()):
        super().__init__(RECEIVER)
        self.hunt, self.clock, self.faults = hunt, clock, faults
        self.sample_s = SAMPLE_S * (CLOCK_FAULT if "clock" in faults else 1)
        self.memory = bytearray(0x10000)
        self.memory[EPROM:] = bytes(k * 37 % 251 for k in range(0x10000 - EPROM))
        self.reset()

    def reset(self) -> None:
        """What the button does: everything as after power on, sampling off."""
        self.deaf = False
        self.sampling = False
        self._period_began = 0.0
        self._restart()

    def _restart(self) -> None:
        self.baud = FIRST_BAUD
        for where, content in ReceiverParameters().writes():
            self._store(where, content)
        self.automatic, self.attenuation_db = True, 0
        self._unsent: list[tuple[Maximum, ...]] = [(Maximum(0, 0),) * MOST_MAXIMA] * 2
        self._program = None

    def hear(self, character: int) -> bytes:
        """What the receiver says after one more character."""
        return b"" if self.deaf else super().hear(character)

    def _word(self, where: int) -> int:
        return int.from_bytes(self.memory[where : where + 2], "big")

    def _store(self, where: int, content: bytes) -> None:
        for k, byte in enumerate(content):
            if (where + k) % 0x10000 < EPROM:
                self.memory[(where + k) % 0x10000] = byte

    # -- sampling ------------------------------------------------------------------------------

    def _catch_up(self) -> None:
        """Works through the periods that have ended by now."""
        if not self.sampling:
            return
        now = self.clock()
        period = max(self._word(PERIOD_ADDRESS), 1)
        behind = int((now - self._period_began) / (period * self.sample_s))
        if behind > MOST_BEHIND:
            self._period_began += (behind - MOST_BEHIND) * period * self.sample_s
        for _ in range(min(behind, MOST_BEHIND)):
            self._end_period(period)
            self._period_began += period * self.sample_s

    def _end_period(self, period: int) -> None:
        codes = self.hunt.codes(self._period_began, period, self.sample_s, self.attenuation_db)
        number = min(max(self.memory[MAXIMA_ADDRESS] // 2, 1), MOST_MAXIMA)
        maxima_of = controller_maxima if "edges" in self.faults else largest_sums
        self._unsent = [maxima_of(moving_sums(codes), number, self._word(WINDOW_ADDRESS))]
        if self.automatic:
            self.attenuation_db = self._stepped(int(codes.max()))

    def _stepped(self, largest: int) -> int:
        """The attenuation after the automatic gain has seen the largest sample of a period."""
        step = int(next_step(ATTENUATIONS_DB.index(self.attenuation_db), largest))
        if "gain-step" in self.faults and self.attenuation_db == 9 and ATTENUATIONS_DB[step] > 9:
            return 0
        return ATTENUATIONS_DB[step]

    # -- commands ------------------------------------------------------------------------------

    def _change_baud(self, digits: bytes) -> None:
        known = digits.isdigit() and int(digits) in BAUD_RATES
        if not known and "deaf" in self.faults:
            self.deaf = True
        super()._change_baud(digits)

    def _command(self, character: int) -> Generator[None, int, bool]:
        """Carries out one command; whether it was one."""
        self._catch_up()
        simple = {"O": self._start, "P": self._pause, "-": self._send_maxima, "V": self._send_attenuator}
        letter = chr(character)
        if letter in simple:
            simple[letter]()
        elif letter == "H":
            self._say("\r\n".join(HELP_TEXT).encode("ascii"))
        elif letter == "R":
            self._restart()
            return False
        elif letter == "A":
            return self._set_attenuator(chr((yield)))
        elif letter in "?!":
            return (yield from self._monitor(letter + chr((yield))))
        else:
            return False
        self._say(PROMPT)
        return True

    def _start(self) -> None:
        if not self.sampling:
            self.sampling, self._period_began = True, self.clock()

    def _pause(self) -> None:
        self.sampling = False

    def _send_maxima(self) -> None:
        if self._unsent:
            number = min(max(self.memory[MAXIMA_ADDRESS] // 2, 1), MOST_MAXIMA)
            maxima = self._unsent.pop()
            padded = (*maxima, *[Maximum(0, 0)] * number)[:number]
            self._say("".join(f"{one.value:04X}{one.index:04X}" for one in padded).encode("ascii"))

    def _send_attenuator(self) -> None:
        self._say(b"%02X" % ATTENUATOR_CODES[ATTENUATIONS_DB.index(self.attenuation_db)])

    def _set_attenuator(self, step: str) -> bool:
        if step not in "0123456A":
            return False
        self.automatic = step == "A"
        if not self.automatic:
            self.attenuation_db = ATTENUATIONS_DB[int(step)]
        self._say(PROMPT)
        return True

    def _monitor(self, command: str) -> Generator[None, int, bool]:
        if command == "?M":
            start = yield from self._number()
            length = yield from self._number()
            self._dump(start, length)
        elif command == "!M":
            yield from self._load()
        elif command == "!T":
            self._store(0x80, (yield from self._number()).to_bytes(2, "big"))
            self._say(b" GOT 4! SEND 4 MORE\x03")
            self._store(0x84, (yield from self._number()).to_bytes(2, "big"))
            self._say(b"DONE")
        else:
            return False
        self._say(PROMPT)
        return True

    def _number(self) -> Generator[None, int, int]:
        """A hex number: the last four digits before a space or return; other characters are passed over."""
        digits = ""
        while (character := (yield)) not in b" \r":
            if _is_hex(character):
                digits += chr(character)
        return int(digits[-4:] or "0", 16)

    def _dump(self, start: int, length: int) -> None:
        for k in range(length):
            where = (start + k) % 0x10000
            if k == 0 or where % 16 == 0:
                self._say((b"," if k else b"") + b"\r\n%04X " % where)
            self._say((b" " if where % 2 == 0 else b"") + b"%02X" % self.memory[where])

    def _load(self) -> Program:
        where = yield from self._number()
        while True:
            character = yield
            if character in (CONTINUE, NEW_ADDRESS):
                while (yield) != ord("\n"):
                    pass
                if character == NEW_ADDRESS:
                    where = yield from self._number()
            elif _is_hex(character):
                second = yield
                if not _is_hex(second):
                    return
                self._store(where, bytes([int(chr(character) + chr(second), 16)]))
                where += 1
            elif character != ord(" "):
                return


def _is_hex(character: int) -> bool:
    return chr(character) in "0123456789ABCDEFabcdef"


class GpsUnit(Unit):
    """A GPS that gives the position of the last whole second, in the report's form."""

    def __init__(
        self,
        hunt: SimulatedHunt,
        clock: Callable[[], float],
        faults: frozenset[str] = frozenset(),
        start_utc_s: float = 0.0,
        minute_decimals: int = 2,
    ):
        super().__init__(GPS)
        self.hunt, self.clock, self.faults = hunt, clock, faults
        self.start_utc_s = float(int(start_utc_s))  # UTC at the clock's zero, seconds since 1970
        self.minute_decimals = minute_decimals
        self._rng = np.random.default_rng((hunt.seed, 2))

    def _command(self, character: int) -> Generator[None, int, bool]:
        if character != ord("?") or (yield) != ord("L"):
            return False
        second = int(self.clock() // 1)
        of_day = int(self.start_utc_s + second) % 86_400
        clock_time = f"{of_day // 3600:02d}{of_day // 60 % 60:02d}{of_day % 60:02d}"
        if "no-fix" in self.faults and self._rng.random() < 0.05:
            place = "0000.00,N,00000.00,E,0,0,000,000,M,00000,M"
        else:
            lat, lon = self.hunt.gps(second)
            place = (
                f"{degrees_minutes(lat, 2, self.minute_decimals)},{'S' if lat < 0 else 'N'},"
                f"{degrees_minutes(lon, 3, self.minute_decimals)},{'W' if lon < 0 else 'E'},1,08,1.2,000,M,00000,M"
            )
        self._say(f" {clock_time},{place}".encode("ascii") + PROMPT)
        return True


def degrees_minutes(angle_deg: float, digits: int, decimals: int) -> str:
    """An angle as degrees and decimal minutes without a separator."""
    step = 60 * 10**decimals
    whole = round(abs(angle_deg) * step)
    degrees, minutes = divmod(whole, step)
    return f"{degrees:0{digits}d}{minutes / 10**decimals:0{3 + decimals}.{decimals}f}"


class SailLine:
    """The loop with its two units: what a host hears for what it sends.

    clock : simulated seconds since the ship set out
    faults : names of FAULTS; ValueError for another
    start_utc_s : UTC at the clock's zero, seconds since 1970
    """

    def __init__(
        self,
        hunt: SimulatedHunt,
        clock: Callable[[], float],
        faults=(),
        start_utc_s: float | None = None,
        minute_decimals: int = 2,
    ):
        unknown = sorted(set(faults) - set(FAULTS))
        if unknown:
            raise ValueError(f"found faults {', '.join(unknown)}; wanted some of {', '.join(FAULTS)}")
        self.faults = frozenset(faults)
        began = time.time() if start_utc_s is None else start_utc_s
        self.receiver = ReceiverUnit(hunt, clock, self.faults)
        self.gps = GpsUnit(hunt, clock, self.faults, began, minute_decimals)
        self._rng = np.random.default_rng((hunt.seed, 3))

    def answer(self, heard: bytes, host_baud: int | None = None) -> bytes:
        """All that comes back: each character's echo, then what the units say to it.

        host_baud : the host's rate, if it can be told; a unit at another understands nothing
        """
        line = bytearray()
        for character in heard:
            if not self._happens("echo", 0.01):
                line.append(character)
            said = b""
            for unit in (self.receiver, self.gps):
                if host_baud is None or host_baud == unit.baud:
                    said += unit.hear(character & 0x7F)
            line += self._spoilt(said) if said else b""
        return bytes(line)

    def _spoilt(self, said: bytes) -> bytes:
        if self._happens("stop", 0.03):
            return said[: len(said) // 2]
        if self._happens("flood", 0.01):
            return said[:-1] + FLOOD
        if "parity" in self.faults:
            wrong = self._rng.random(len(said)) < 0.002
            return bytes(
                byte | 0x80 * (byte.bit_count() % 2 ^ int(bad)) for byte, bad in zip(said, wrong, strict=True)
            )
        return said

    def _happens(self, fault: str, chance: float) -> bool:
        return fault in self.faults and self._rng.random() < chance
