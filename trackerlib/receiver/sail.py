"""What the thesis's receiver is told and what it answers on its SAIL line: bytes in, bytes out, nothing read or sent.

    exchange = Exchange(READ_MAXIMA)
    exchange.feed(b"-0A3F00C801DC0400\\r\\n:\\x03")     # a Reply; None while more must come, a Fault in words
    decode_maxima(exchange.feed(...).body, 2)

Wojcik (1993), appendices 2 and 3. All units hang on one current loop, so whoever sends hears his own characters
come back; a unit that is addressed answers after them and ends with a prompt whose last character is ETX.

Mended: the host of the thesis waits for ever where no ETX comes, and takes what it gets; here an exchange
that does not end, or whose parity or form is wrong, is a Fault. The data reply does not carry the gain, which is
asked for apart.
"""

from __future__ import annotations

from dataclasses import dataclass

from trackerlib.receiver.front_end import ATTENUATIONS_DB

ETX = b"\x03"
PROMPT = b"\r\n:" + ETX
RECEIVER, GPS = "PTR", "GPS"
START, PAUSE, READ_MAXIMA, READ_ATTENUATOR, HELP, RESTART = b"O", b"P", b"-", b"V", b"H", b"R"
READ_POSITION = b"?L"
LINK_TEST = b"!T"
AUTOMATIC_GAIN = "AA"
FIRST_BAUD = 9600  # after power on, reset and restart
BAUD_RATES = (9600, 4800, 2400, 1200, 600, 300)
MOST_MAXIMA = 8
SUM_SAMPLES = 11  # an index is that of the last sample of its sum (5-5)
LONGEST_REPLY = 4096  # characters; the help text is the longest reply of known length
PERIOD_ADDRESS, MAXIMA_ADDRESS, WINDOW_ADDRESS = 0x52, 0x63, 0x74

# Table 5-2: what port A shows at each of ATTENUATIONS_DB. PA0 is pulled up; PA6 toggles with the timer.
ATTENUATOR_CODES = (0x01, 0x09, 0x11, 0x19, 0x21, 0x81, 0xB9)
SWITCHES = 0xB8  # the bits of port A that switch shunts


@dataclass(frozen=True)
class Reply:
    """An answer that came whole."""

    command: bytes
    body: bytes  # between the echo and the prompt, parity bits taken off
    echo_missed: bool = False  # a character of the command did not come back
    even_parity: bool = False  # the unit sets bit 7 for even parity


@dataclass(frozen=True)
class Fault:
    """Why there is no answer. `kind` is one of FAULTS."""

    kind: str
    words: str


FAULTS = ("silent", "no answer", "stopped", "garbled", "flood", "refused", "gone")


@dataclass(frozen=True)
class Maximum:
    """One of the largest sums of a period."""

    value: int  # sum of SUM_SAMPLES samples, 0 to 2805
    index: int  # sample in the period of the last of them, from 0


@dataclass(frozen=True)
class ReceiverParameters:
    """What the receiver is told about a signal; ValueError names a number it cannot take."""

    period_samples: int = 2000  # a repetition period, whole samples
    maxima: int = 2  # kept of each period
    window_samples: int = 20  # two maxima are at least this far apart

    def __post_init__(self):
        for name, low, high in (
            ("period_samples", 2, 0xFFFF),
            ("maxima", 1, MOST_MAXIMA),
            ("window_samples", 1, 0xFFFF),
        ):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} is {getattr(self, name)}; wanted {low} to {high}")
        if self.window_samples >= self.period_samples:
            raise ValueError(
                f"window_samples is {self.window_samples}; wanted less than the period, {self.period_samples}"
            )

    def writes(self) -> tuple[tuple[int, bytes], ...]:
        """Address in the controller's memory and bytes, for each parameter."""
        return (
            (PERIOD_ADDRESS, self.period_samples.to_bytes(2, "big")),
            (MAXIMA_ADDRESS, bytes([2 * self.maxima])),
            (WINDOW_ADDRESS, self.window_samples.to_bytes(2, "big")),
        )


# -- what the host sends -------------------------------------------------------------------------


def address(unit: str) -> bytes:
    """What makes a unit listen; the space asks for its prompt."""
    return b"#%s " % unit.encode("ascii")


def baud_change(baud: int) -> bytes:
    """The command that changes the receiver's rate. ValueError for a rate it has no code for: that would deafen it."""
    if baud not in BAUD_RATES:
        raise ValueError(f"found {baud} baud; wanted one of {', '.join(map(str, BAUD_RATES))}")
    return b"#00%05d" % baud


def set_attenuator(step: int | str) -> bytes:
    """The command for an attenuation in dB (a step of Table 5-2), or for AUTOMATIC_GAIN."""
    if step == AUTOMATIC_GAIN:
        return b"AA"
    if step not in ATTENUATIONS_DB:
        raise ValueError(
            f"found an attenuation of {step} dB; wanted one of {ATTENUATIONS_DB} or {AUTOMATIC_GAIN}"
        )
    return b"A%d" % ATTENUATIONS_DB.index(step)


def dump_command(start: int, length: int) -> bytes:
    """The command that shows `length` bytes of memory."""
    return b"?M%04X %04X\r" % (start, length)


def load_command(start: int, content: bytes) -> bytes:
    """The command that writes bytes to memory."""
    return b"!M%02X %s\r" % (start, content.hex().upper().encode("ascii"))


# -- what comes back -----------------------------------------------------------------------------


class Exchange:
    """One command on the line: takes what is heard, in pieces of any length, until the answer is whole.

    prompted : whether the answer ends with ETX; without, it ends with the command's own echo
    longest : more characters than this without an end are a flood
    """

    def __init__(self, command: bytes, prompted: bool = True, longest: int = LONGEST_REPLY):
        self.command, self.prompted, self.longest = command, prompted, longest
        self.rest = b""  # heard after the end
        self._heard = bytearray()

    def feed(self, data: bytes) -> Reply | Fault | None:
        """The answer, or why it is none; None while more must come."""
        end = len(self.command) if not self.prompted else None
        for k, byte in enumerate(data):
            self._heard.append(byte)
            ended = byte & 0x7F == ETX[0] if end is None else len(self._heard) == end
            if ended:
                self.rest = data[k + 1 :]
                return self._answer()
            if len(self._heard) > len(self.command) + self.longest:
                return Fault("flood", f"{self._said()}: {len(self._heard)} characters came without an end")
        return None

    def expire(self) -> Fault:
        """What it means that no more came."""
        heard = bytes(byte & 0x7F for byte in self._heard)
        if not heard:
            return Fault("silent", f"{self._said()}: not even the echo came back; is the line connected?")
        if heard == self.command:
            return Fault("no answer", f"{self._said()}: the echo came back, but the unit did not answer")
        return Fault("stopped", f"{self._said()}: the answer stopped in mid-message after {shown(heard)}")

    def _answer(self) -> Reply | Fault:
        heard = bytes(self._heard)
        plain = bytes(byte & 0x7F for byte in heard)
        even = False
        if plain != heard:
            after, _ = _after_echo(self.command, plain)
            wrong = [byte for byte in heard[len(heard) - len(after) :] if byte.bit_count() % 2]
            if wrong:
                return Fault(
                    "garbled", f"{self._said()}: character {wrong[0]:02X}h came with the wrong parity"
                )
            even = True
        if not self.prompted:
            if plain != self.command:
                return Fault("garbled", f"{self._said()}: the echo was {shown(plain)}")
            return Reply(self.command, b"")
        body, missed = _after_echo(self.command, plain[:-1])
        for ending in (b"\r\n:", b"\n:"):
            if body.endswith(ending):
                body = body[: -len(ending)]
                break
        return Reply(self.command, body, missed, even)

    def _said(self) -> str:
        return f"asked {shown(self.command)}"


def _after_echo(command: bytes, heard: bytes) -> tuple[bytes, bool]:
    """What follows the echo, and whether one of its characters was missed; everything if more were."""
    if heard.startswith(command):
        return heard[len(command) :], False
    for k in range(len(command)):
        echo = command[:k] + command[k + 1 :]
        if heard.startswith(echo):
            return heard[len(echo) :], True
    return heard, True


def decode_maxima(body: bytes, maxima: int) -> tuple[Maximum, ...] | Fault:
    """The maxima of the newest buffer, largest first; none if it is not ready yet, or has not been filled yet."""
    if not body:
        return ()
    text = body.decode("ascii", "replace")
    if len(text) != 8 * maxima or not _is_hex(text):
        return Fault("garbled", f"found {shown(body)}; wanted {8 * maxima} hex digits for {maxima} maxima")
    words = [int(text[k : k + 4], 16) for k in range(0, len(text), 4)]
    found = tuple(Maximum(value, index) for value, index in zip(words[::2], words[1::2], strict=True))
    return tuple(one for one in found if one.value > 0)


def decode_attenuator(body: bytes) -> int | Fault:
    """Attenuation in dB that port A shows."""
    text = body.decode("ascii", "replace")
    code = int(text, 16) & SWITCHES if len(text) == 2 and _is_hex(text) else None
    for attenuation, known in zip(ATTENUATIONS_DB, ATTENUATOR_CODES, strict=True):
        if code == known & SWITCHES:
            return attenuation
    return Fault("garbled", f"found {shown(body)} as attenuator; wanted two hex digits of Table 5-2")


def decode_dump(body: bytes, start: int, length: int) -> bytes | Fault:
    """The bytes of a memory dump.

    A line is CR LF, the address, a space and bytes in hex with a space before each even address; a comma stands
    before the next line.
    """
    content = bytearray()
    try:
        for line in body.decode("ascii").split("\r\n"):
            where, _, digits = line.strip(" ,").partition(" ")
            if not where:
                continue
            if int(where, 16) != start + len(content):
                raise ValueError
            content += bytes.fromhex(digits)
    except ValueError:
        content.clear()
    if len(content) != length:
        return Fault("garbled", f"found {shown(body)}; wanted {length} bytes of memory from {start:04X}h")
    return bytes(content)


def _is_hex(text: str) -> bool:
    return all(letter in "0123456789ABCDEFabcdef" for letter in text)


def shown(data: bytes) -> str:
    """Characters as a person can read them, cut short."""
    text = data[:40].decode("latin-1").encode("unicode_escape").decode("ascii")
    return f"'{text}{'...' if len(data) > 40 else ''}'"
