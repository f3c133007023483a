"""Where bytes come from and go to: serial ports, UDP, TCP, files played back; their troubles in words.

    port = open_port("/dev/ttyUSB0", baud=9600)      # or "COM3", "tcp:ship:4001", "udp:10110", "file:nav.raw"
    port.read(0.2)

A port is opened by `open`, may be opened again after it failed, and is used by one thread at a time.
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import time
from io import BufferedReader
from pathlib import Path
from typing import Protocol

import serial

RECEIVE_BUFFER_BYTES = 4 << 20  # asked of the system for UDP: a second or more of a busy line
CHUNK = 1 << 16
CONNECT_S = 5.0
SERIAL_STEP_S = 0.02  # of waiting for a first byte: to change the device's own timeout is slow


class PortError(OSError):
    """A port that cannot be opened, or that is gone; the message says which, why and what would help."""


class PortEnded(PortError):
    """A source that has given all it had."""


class Port(Protocol):
    """What readers and hosts need of a port."""

    name: str
    datagrams: bool  # each read is one whole message
    has_baud: bool  # whether it has a rate that must be that of the other end

    def open(self) -> None:
        """Opens it, again if need be. Raises PortError."""

    def read(self, timeout_s: float) -> bytes:
        """What has come, at once if there is something; b"" after the time. Raises PortError once it is gone."""

    def write(self, data: bytes) -> None:
        """Sends. Raises PortError."""

    def set_baud(self, baud: int) -> None:
        """Changes the rate, where there is one."""

    def close(self) -> None:
        """Closes it; never raises."""


def open_port(where: str, baud: int = 9600) -> Port:
    """The port that an address names, not yet opened. Raises PortError for an address that makes no sense.

    where : a serial device, or `DEVICE@BAUD` for a rate of its own; `tcp:HOST:PORT`; `udp:PORT` or
        `udp:GROUP:PORT`; `file:PATH` or `file:PATH@SPEED`
    """
    kind, _, rest = where.partition(":")
    try:
        if kind == "tcp":
            host, _, number = rest.rpartition(":")
            return TcpPort(host.strip("[]") or "127.0.0.1", _port_number(number))
        if kind == "udp":
            group, _, number = rest.rpartition(":")
            return UdpPort(_port_number(number), group)
        if kind == "file":
            path, at, speed = rest.rpartition("@")
            return FilePort(path, float(speed)) if at and _is_number(speed) else FilePort(rest)
    except ValueError as error:
        raise PortError(f"{where}: {error}") from None
    if not where:
        raise PortError("no port was named; wanted a device, tcp:HOST:PORT, udp:PORT or file:PATH")
    device, at, rate = where.rpartition("@")
    return SerialPort(device, int(rate)) if at and rate.isdigit() else SerialPort(where, baud)


def _port_number(text: str) -> int:
    if not text.isdigit() or not 0 < int(text) < 65536:
        raise ValueError(f"found port {text!r}; wanted 1 to 65535")
    return int(text)


def _is_number(text: str) -> bool:
    try:
        return float(text) > 0
    except ValueError:
        return False


class SerialPort:
    """A serial device, 8 data bits, 1 stop bit, no parity; nobody else may have it open."""

    datagrams = False
    has_baud = True

    def __init__(self, device: str, baud: int = 9600):
        self.name, self.baud = device, baud
        self._serial: serial.Serial | None = None

    def open(self) -> None:
        """Opens the device. Raises PortError if it is missing, taken or forbidden."""
        self.close()
        try:
            self._serial = serial.Serial(
                self.name, self.baud, timeout=SERIAL_STEP_S, write_timeout=2, exclusive=True
            )
        except (serial.SerialException, OSError, ValueError) as error:
            raise PortError(f"{self.name}: {_serial_words(error, self.name)}") from None

    def read(self, timeout_s: float) -> bytes:
        """What has come. Raises PortError if the cable was pulled."""
        opened = self._opened()
        until = time.monotonic() + timeout_s
        try:
            while not (first := opened.read(1)):
                if time.monotonic() >= until:
                    return b""
            return first + opened.read(min(opened.in_waiting, CHUNK))
        except (serial.SerialException, OSError, TypeError) as error:
            self.close()
            raise PortError(f"{self.name}: the device is gone ({error}); is the cable in?") from None

    def write(self, data: bytes) -> None:
        """Sends, waiting at most two seconds for the device to take it."""
        opened = self._opened()
        try:
            opened.write(data)
        except (serial.SerialException, OSError) as error:
            self.close()
            raise PortError(f"{self.name}: the device takes nothing ({error}); is the cable in?") from None

    def set_baud(self, baud: int) -> None:
        """Changes the rate."""
        self.baud = baud
        try:
            self._opened().baudrate = baud
        except (serial.SerialException, OSError, ValueError) as error:
            raise PortError(f"{self.name}: cannot do {baud} baud ({error})") from None

    def close(self) -> None:
        """Closes the device."""
        if self._serial is not None:
            opened, self._serial = self._serial, None
            with contextlib.suppress(serial.SerialException, OSError):
                opened.close()

    def _opened(self) -> serial.Serial:
        if self._serial is None:
            raise PortError(f"{self.name}: not open")
        return self._serial


def _serial_words(error: Exception, device: str) -> str:
    number = getattr(error, "errno", None)
    text = str(error)
    if number == errno.ENOENT or "FileNotFoundError" in text:
        return "no such device; is it plugged in?"
    if number in (errno.EACCES, errno.EPERM) or "PermissionError" in text:
        return "no permission; on Linux join the group dialout, on Windows close the program that has it open"
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK) or "exclusively lock" in text:
        return "in use by another program; close that one first"
    return f"cannot be opened ({text})"


class _SocketPort:
    """What TCP and UDP share."""

    datagrams = False
    has_baud = False
    name = ""

    def __init__(self) -> None:
        self._socket: socket.socket | None = None

    def read(self, timeout_s: float) -> bytes:
        """What has come. Raises PortError once the other end is gone."""
        opened = self._opened()
        try:
            data = _received(opened)
            if data is None and select.select([opened], [], [], timeout_s)[0]:
                data = _received(opened)
        except (OSError, ValueError) as error:
            self.close()
            raise PortError(f"{self.name}: the connection broke ({_words(error)})") from None
        if data == b"" and not self.datagrams:
            self.close()
            raise PortError(f"{self.name}: the other end closed the connection")
        return data or b""

    def set_baud(self, baud: int) -> None:
        """Nothing: a network has no rate."""

    def close(self) -> None:
        """Closes the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise PortError(f"{self.name}: not open")
        return self._socket


def _received(opened: socket.socket) -> bytes | None:
    """What has come to a socket that does not wait; None if nothing has."""
    try:
        return opened.recv(CHUNK)
    except BlockingIOError:
        return None


class TcpPort(_SocketPort):
    """A TCP connection to a server: a serial device server, a plotter, the emulator."""

    def __init__(self, host: str, port: int):
        super().__init__()
        self.host, self.port, self.name = host, port, f"tcp:{host}:{port}"

    def open(self) -> None:
        """Connects. Raises PortError if nobody listens there."""
        self.close()
        try:
            opened = socket.create_connection((self.host, self.port), timeout=CONNECT_S)
        except OSError as error:
            raise PortError(f"{self.name}: cannot connect ({_words(error)})") from None
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # With this a pulled network cable shows in the end.
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        opened.setblocking(False)
        self._socket = opened

    def write(self, data: bytes) -> None:
        """Sends all of it."""
        opened = self._opened()
        try:
            while data:
                if not select.select([], [opened], [], CONNECT_S)[1]:
                    raise TimeoutError
                data = data[opened.send(data) :]
        except OSError as error:
            self.close()
            raise PortError(f"{self.name}: the connection broke ({_words(error)})") from None


class UdpPort(_SocketPort):
    """Datagrams that come to a port: unicast, broadcast, or of a multicast group."""

    datagrams = True

    def __init__(self, port: int, group: str = ""):
        super().__init__()
        self.port, self.group = port, group
        self.name = f"udp:{group}:{port}" if group else f"udp:{port}"
        self.receive_buffer_bytes = 0  # what the system granted

    def open(self) -> None:
        """Listens. Raises PortError if the port is taken, or the group is none."""
        self.close()
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            if self.group:
                opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                member = socket.inet_aton(self.group) + socket.inet_aton("0.0.0.0")
                opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            opened.bind(("", self.port))
            opened.setblocking(False)
        except OSError as error:
            opened.close()
            raise PortError(f"{self.name}: cannot listen ({_words(error)})") from None
        self.receive_buffer_bytes = opened.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        self._socket = opened

    def write(self, data: bytes) -> None:
        """Datagrams are only listened to."""
        raise PortError(f"{self.name}: cannot be written to")


def _words(error: Exception) -> str:
    number = getattr(error, "errno", None)
    known = {
        errno.EADDRINUSE: "the port is in use by another program",
        errno.EACCES: "no permission; ports below 1024 belong to the system",
        errno.ECONNREFUSED: "nobody listens there",
        errno.EHOSTUNREACH: "no way to that host",
        errno.ENETUNREACH: "no way to that network",
    }
    if isinstance(error, socket.gaierror):
        return "no host of that name"
    if isinstance(error, TimeoutError):
        return f"no answer within {CONNECT_S:g} s"
    return known.get(number, getattr(error, "strerror", None) or str(error))  # type: ignore[arg-type]


class FilePort:
    """A file played back, at so many bytes a second (0: as fast as it is read)."""

    datagrams = False
    has_baud = False

    def __init__(self, path: str | Path, bytes_per_s: float = 0.0):
        self.path, self.bytes_per_s = Path(path), bytes_per_s
        self.name = f"file:{path}"
        self._file: BufferedReader | None = None
        self._began = 0.0
        self._given = 0

    def open(self) -> None:
        """Opens the file at its beginning. Raises PortError if it cannot be read."""
        self.close()
        try:
            self._file = self.path.open("rb")
        except OSError as error:
            raise PortError(f"{self.name}: {(error.strerror or str(error)).lower()}") from None
        self._began, self._given = time.monotonic(), 0

    def read(self, timeout_s: float) -> bytes:
        """The bytes that are due. Raises PortEnded after the last."""
        if self._file is None:
            raise PortError(f"{self.name}: not open")
        due = CHUNK
        if self.bytes_per_s:
            due = int((time.monotonic() - self._began) * self.bytes_per_s) - self._given
            if due <= 0:
                time.sleep(min(timeout_s, 0.05))
                return b""
        data = self._file.read(min(due, CHUNK))
        if not data:
            self.close()
            raise PortEnded(f"{self.name}: played to its end")
        self._given += len(data)
        return data

    def write(self, data: bytes) -> None:
        """A file is only played."""
        raise PortError(f"{self.name}: cannot be written to")

    def set_baud(self, baud: int) -> None:
        """Nothing: a file has no rate."""

    def close(self) -> None:
        """Closes the file."""
        if self._file is not None:
            self._file.close()
            self._file = None
