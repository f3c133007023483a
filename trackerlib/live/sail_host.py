"""The host's side of the SAIL line over any port: asks, waits no longer than it must, says in words what went wrong.

    host = SailHost(open_port("/dev/ttyUSB0"))
    host.port.open()
    host.resynchronise()                  # the rate it answers at, or a Fault
    host.write_parameters(ReceiverParameters(2000, 2, 20))
    host.maxima(2), host.attenuation(), host.position()

Nothing here raises for what a device does: every method gives its answer or a Fault.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass

from trackerlib.live import nmea
from trackerlib.live.ports import Port, PortError
from trackerlib.receiver.sail import (
    BAUD_RATES,
    FIRST_BAUD,
    GPS,
    HELP,
    LINK_TEST,
    LONGEST_REPLY,
    PAUSE,
    READ_ATTENUATOR,
    READ_MAXIMA,
    READ_POSITION,
    RECEIVER,
    RESTART,
    START,
    Exchange,
    Fault,
    Maximum,
    ReceiverParameters,
    Reply,
    address,
    baud_change,
    decode_attenuator,
    decode_dump,
    decode_maxima,
    dump_command,
    load_command,
    set_attenuator,
    shown,
)

QUIET_S = 0.5  # a unit that says nothing for so long has said all
CALM_S, LONGEST_CALM_S = 0.1, 2.0  # silence after a fault, and how long it is waited for
TYPED_S = 0.25  # silence that ends the answer to what a person typed
BITS = 10  # of a character on the line
PARTING = "it may be deaf after a wrong baud command, or off: press its reset button"


@dataclass(frozen=True)
class GpsReading:
    """What the GPS on the line said."""

    time_of_day_s: float  # UTC
    position: nmea.Position | None
    no_position: str | None  # why there is none


class SailHost:
    """Asks the units on one line. Used by one thread at a time.

    port : opened by the caller
    on_bytes : told every byte heard, before anything interprets it
    quiet_s : how long a unit may say nothing before an answer counts as ended
    """

    def __init__(self, port: Port, on_bytes: Callable[[bytes], None] | None = None, quiet_s: float = QUIET_S):
        self.port, self.quiet_s = port, quiet_s
        self.baud = FIRST_BAUD
        self._on_bytes = on_bytes or (lambda data: None)
        self._addressed: str | None = None

    # -- one question --------------------------------------------------------------------------

    def ask(
        self,
        unit: str,
        command: bytes,
        *,
        prompted: bool = True,
        longest: int = LONGEST_REPLY,
        tries: int = 2,
    ) -> Reply | Fault:
        """The answer of a unit to a command, addressed first if it does not listen already.

        tries : how often it is asked; more than once only if asking again does no harm
        """
        said: Reply | Fault = Fault("refused", "not asked")
        for _ in range(tries):
            said = self._address(unit)
            if isinstance(said, Reply):
                said = self._exchange(Exchange(command, prompted, longest))
            if isinstance(said, Reply):
                if not prompted:
                    self._addressed = None
                return said
            self._addressed = None
            if said.kind == "gone":
                return said
            self._calm_down()
        return said

    def _address(self, unit: str) -> Reply | Fault:
        if self._addressed == unit:
            return Reply(b"", b"")
        said = self._exchange(Exchange(address(unit)))
        if isinstance(said, Reply) and said.body:
            return Fault("garbled", f"#{unit} answered {shown(said.body)}; wanted its prompt alone")
        if isinstance(said, Reply):
            self._addressed = unit
        return said

    def _exchange(self, exchange: Exchange) -> Reply | Fault:
        try:
            self.port.write(exchange.command)
            patience = self.quiet_s + BITS * (len(exchange.command) + 2) / self.baud
            until = time.monotonic() + patience
            while (left := until - time.monotonic()) > 0:
                data = self.port.read(left)
                if data:
                    self._on_bytes(data)
                    said = exchange.feed(data)
                    if said is not None:
                        return said
                    until = time.monotonic() + patience
        except PortError as error:
            return Fault("gone", str(error))
        return exchange.expire()

    def _calm_down(self) -> None:
        """Lets what is still coming go by."""
        end = time.monotonic() + LONGEST_CALM_S
        with contextlib.suppress(PortError):  # the next question says so
            while time.monotonic() < end and (data := self.port.read(CALM_S)):
                self._on_bytes(data)

    def _plain(self, said: Reply | Fault) -> Fault | None:
        """None for an answer that is a prompt and nothing else."""
        if isinstance(said, Fault):
            return said
        if said.body:
            return Fault(
                "garbled", f"found {shown(said.body)} after {shown(said.command)}; wanted the prompt"
            )
        return None

    # -- the receiver --------------------------------------------------------------------------

    def start(self) -> Fault | None:
        """Sampling on."""
        return self._plain(self.ask(RECEIVER, START))

    def pause(self) -> Fault | None:
        """Sampling off."""
        return self._plain(self.ask(RECEIVER, PAUSE))

    def maxima(self, number: int) -> tuple[Maximum, ...] | Fault:
        """The maxima of the newest buffer, none if there is no new one. Asked once: it is offered only once."""
        said = self.ask(RECEIVER, READ_MAXIMA, tries=1)
        return said if isinstance(said, Fault) else decode_maxima(said.body, number)

    def attenuation(self) -> int | Fault:
        """Attenuation [dB] of now, after the step that followed the newest buffer."""
        said = self.ask(RECEIVER, READ_ATTENUATOR)
        return said if isinstance(said, Fault) else decode_attenuator(said.body)

    def set_attenuation(self, step: int | str) -> Fault | None:
        """Attenuation by hand [dB], or AUTOMATIC_GAIN. ValueError for a step it does not have."""
        return self._plain(self.ask(RECEIVER, set_attenuator(step)))

    def help_text(self) -> str | Fault:
        """What the receiver says of its commands."""
        said = self.ask(RECEIVER, HELP)
        return said if isinstance(said, Fault) else "H" + said.body.decode("ascii", "replace")

    def dump(self, start: int, length: int) -> bytes | Fault:
        """Bytes of its memory."""
        said = self.ask(RECEIVER, dump_command(start, length), longest=LONGEST_REPLY + 4 * length)
        return said if isinstance(said, Fault) else decode_dump(said.body, start, length)

    def load(self, start: int, content: bytes) -> Fault | None:
        """Writes bytes to its memory and reads them back."""
        fault = self._plain(self.ask(RECEIVER, load_command(start, content)))
        if fault is not None:
            return fault
        found = self.dump(start, len(content))
        if isinstance(found, Fault) or found == content:
            return found if isinstance(found, Fault) else None
        return Fault(
            "refused", f"memory at {start:04X}h holds {found.hex()}, wanted {content.hex()}; is it a ROM?"
        )

    def has_parameters(self, parameters: ReceiverParameters) -> bool | Fault:
        """Whether its memory holds these parameters; after a restart it holds its own again."""
        for where, content in parameters.writes():
            found = self.dump(where, len(content))
            if isinstance(found, Fault):
                return found
            if found != content:
                return False
        return True

    def write_parameters(self, parameters: ReceiverParameters) -> Fault | None:
        """Tells it about the signal, and checks that it was understood."""
        for where, content in parameters.writes():
            fault = self.load(where, content)
            if fault is not None:
                return fault
        return None

    def link_test(self) -> Fault | None:
        """Two numbers there, two greetings back."""
        first = self.ask(RECEIVER, LINK_TEST + b"1234 ", tries=1)
        if isinstance(first, Fault):
            return first
        second = self._exchange(Exchange(b"5678 "))
        if isinstance(second, Fault):
            self._addressed = None
            return second
        if b"GOT 4" not in first.body or b"DONE" not in second.body:
            return Fault("garbled", f"the link test answered {shown(first.body)}, {shown(second.body)}")
        return None

    # -- rates ---------------------------------------------------------------------------------

    def set_baud(self, baud: int) -> Fault | None:
        """Changes the rate of line and host, and checks that the receiver answers at it.

        A rate without a code is a ValueError and never sent: it would leave the original deaf.
        """
        said = self._exchange(Exchange(baud_change(baud), prompted=False))
        self._addressed = None
        if isinstance(said, Reply):
            self._follow(baud)
            if isinstance(self._address(RECEIVER), Reply):
                return None
        self._calm_down()
        found = self.resynchronise()
        if isinstance(found, Fault) or found == baud:
            return found if isinstance(found, Fault) else None
        return Fault("refused", f"the receiver did not take {baud} baud; it answers at {found}")

    def restart(self) -> Fault | None:
        """Restarts the receiver, which goes back to 9600 baud and its own parameters without a word.

        The whole line is brought to 9600 first, for the GPS hears no restart.
        """
        if self.baud != FIRST_BAUD and (fault := self.set_baud(FIRST_BAUD)) is not None:
            return fault
        said = self.ask(RECEIVER, RESTART, prompted=False)
        if isinstance(said, Fault):
            return said
        found = self.resynchronise()
        return found if isinstance(found, Fault) else None

    def resynchronise(self) -> int | Fault:
        """The rate at which the receiver answers: the present one, else that of a restart, else any other.

        If it has left the present one, the GPS, which has not, is called after it.
        """
        before = self.baud
        fault = Fault("silent", f"{self.port.name}: not asked")
        rates = [self.baud, *(rate for rate in (FIRST_BAUD, *BAUD_RATES) if rate != self.baud)]
        for rate in dict.fromkeys(rates if self.port.has_baud else rates[:1]):
            self._addressed = None
            self._follow(rate)
            for _ in range(2):  # a unit in the middle of a command takes the first address as part of it
                said = self._address(RECEIVER)
                if isinstance(said, Reply):
                    if rate != before:
                        self._call_after(before, rate)
                    return rate
                if said.kind == "gone":
                    return said
                fault = said
                self._calm_down()
        self._follow(FIRST_BAUD)
        return Fault(fault.kind, f"the receiver answers at no rate ({fault.words}); {PARTING}")

    def _call_after(self, before: int, rate: int) -> None:
        self._follow(before)
        self._exchange(Exchange(baud_change(rate), prompted=False))
        self._follow(rate)

    def _follow(self, baud: int) -> None:
        self.baud = baud
        with contextlib.suppress(PortError):  # the next question says so
            self.port.set_baud(baud)

    # -- the GPS, and a person -----------------------------------------------------------------

    def position(self) -> GpsReading | Fault:
        """What the GPS on the line says."""
        said = self.ask(GPS, READ_POSITION)
        return said if isinstance(said, Fault) else decode_position(said.body)

    def type(self, text: bytes) -> bytes | Fault:
        """Sends characters as they are and gives what comes back until there is silence: for a terminal."""
        self._addressed = None
        heard = b""
        try:
            self.port.write(text)
            while len(heard) < LONGEST_REPLY and (data := self.port.read(TYPED_S)):
                self._on_bytes(data)
                heard += data
        except PortError as error:
            return Fault("gone", str(error))
        return heard


def decode_position(body: bytes) -> GpsReading | Fault:
    """The GPS's answer ` HHMMSS,DDMM.hh,N,DDDMM.hh,E,x,x,DOP,xxx,M,xxxxx,M`, whose fields are those of a GGA.

    Mended: the thesis's host reads the letters of the hemispheres and does not use them.
    """
    fields = [field.strip() for field in body.decode("ascii", "replace").split(",")]
    wanted = "HHMMSS,DDMM.hh,N,DDDMM.hh,E,x,x,DOP,..."
    if len(fields) < 8:
        return Fault("garbled", f"the GPS said {shown(body)}; wanted {wanted}")
    try:
        time_of_day = nmea.time_of_day(fields[0])
        position, why = nmea.gga_position(fields[1:8])
    except ValueError as error:
        return Fault("garbled", f"the GPS said {shown(body)}: {error}")
    if time_of_day is None:
        return Fault("garbled", f"the GPS said {shown(body)}: no time; wanted {wanted}")
    return GpsReading(time_of_day, position, why)
