"""The simulated SAIL line on a TCP port or a pseudo-terminal, for hosts that want something to talk to.

    with TcpLine(line, "127.0.0.1", 0) as served:
        served.address                     # "tcp:127.0.0.1:40123"

A pseudo-terminal has a rate, and units at another one understand nothing; a network has none.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading

from trackerlib.simulation.sail_units import SailLine

CHUNK = 4096
WAIT_S = 0.1


class _Served:
    """A line that a thread answers on until it is stopped."""

    address = ""

    def __init__(self, line: SailLine):
        self.line = line
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emulated receiver", daemon=True)

    def start(self) -> None:
        """Begins to answer."""
        self._thread.start()

    def stop(self) -> None:
        """Stops answering and gives port or device back."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(5)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.stop()

    def _run(self) -> None:
        raise NotImplementedError


class TcpLine(_Served):
    """The line for one caller at a time; a new one takes it over. Raises OSError if the port cannot be had."""

    def __init__(self, line: SailLine, host: str, port: int):
        super().__init__(line)
        self._server = socket.create_server((host, port), backlog=1)
        self.host, self.port = self._server.getsockname()[:2]
        self.address = f"tcp:{self.host}:{self.port}"

    def _run(self) -> None:
        caller: socket.socket | None = None
        with self._server, contextlib.ExitStack() as opened:
            while not self._stop.is_set():
                waiting = [self._server] if caller is None else [self._server, caller]
                ready = select.select(waiting, [], [], WAIT_S)[0]
                if self._server in ready:
                    if caller is not None:
                        caller.close()
                    caller = opened.enter_context(self._server.accept()[0])
                    caller.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    caller.settimeout(5)
                elif caller in ready and not self._answer(caller):
                    caller = None

    def _answer(self, caller: socket.socket) -> bool:
        """Answers what a caller said; whether he is still there."""
        try:
            heard = caller.recv(CHUNK)
            if heard:
                caller.sendall(self.line.answer(heard))
                return True
        except OSError:
            pass
        caller.close()
        return False


class PtyLine(_Served):
    """The line on a pseudo-terminal. Raises OSError where the system has none (Windows)."""

    def __init__(self, line: SailLine):
        super().__init__(line)
        try:
            import termios
            import tty
        except ImportError:
            raise OSError(0, "this system has no pseudo-terminals; use TCP") from None
        self._termios = termios
        # The far end stays open here, so that callers may come and go.
        self._near, self._far = os.openpty()
        tty.setraw(self._far)
        self.address = os.ttyname(self._far)

    def _rate(self) -> int | None:
        """The caller's rate in baud."""
        code = self._termios.tcgetattr(self._near)[5]
        for baud in (300, 600, 1200, 2400, 4800, 9600, 19200, 38400):
            if code == getattr(self._termios, f"B{baud}"):
                return baud
        return None

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                if select.select([self._near], [], [], WAIT_S)[0]:
                    heard = os.read(self._near, CHUNK)
                    said = self.line.answer(heard, self._rate())
                    while said and not self._stop.is_set():
                        if select.select([], [self._near], [], WAIT_S)[1]:
                            said = said[os.write(self._near, said[:CHUNK]) :]
        finally:
            os.close(self._near)
            os.close(self._far)
