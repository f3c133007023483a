"""`emulate-receiver`: the thesis's receiver and a GPS on one SAIL line, from a simulated beacon, until interrupted."""

from __future__ import annotations

import argparse
import json
import signal
import threading
import time

from trackerlib.simulation.beacon_levels import SOURCE_LEVEL_DB, SimulatedHunt
from trackerlib.simulation.hexagon import SCENARIOS
from trackerlib.simulation.sail_server import PtyLine, TcpLine
from trackerlib.simulation.sail_units import FAULTS, SailLine
from trackerlib.textfiles import InputError

SUMMARY = "answer as the thesis's receiver and a GPS on one SAIL line (simulated)"
FASTEST = 1000.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `emulate-receiver`."""
    add = parser.add_argument
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--tcp", metavar="HOST:PORT", help="listen on a TCP port (default 127.0.0.1:0, a free one)"
    )
    where.add_argument("--pty", action="store_true", help="make a pseudo-terminal, as if a serial device")
    add("--scenario", type=int, choices=SCENARIOS, default=2, help="beacon of the thesis (default 2)")
    add("--rate", type=float, default=1.0, metavar="X", help="times real time (default 1)")
    add("--seed", type=int, default=0, help="of noise and faults (default 0)")
    add("--ship-speed-mps", type=float, default=5.0, metavar="V", help="round the hexagon (default 5)")
    add("--gps-rms-m", type=float, default=3.0, metavar="G", help="of each of east and north (default 3)")
    add(
        "--gps-decimals",
        type=int,
        choices=range(2, 6),
        default=2,
        help="of a minute; the report's 2 are steps of 18.5 m (default 2)",
    )
    add("--source-level-db", type=float, default=SOURCE_LEVEL_DB, metavar="L", help="re 1 uPa at 1 m")
    add(
        "--faults",
        default="",
        metavar="NAMES",
        help="faults to have, with commas between: " + "; ".join(f"{k}: {v}" for k, v in FAULTS.items()),
    )


def run(args: argparse.Namespace) -> None:
    """Prints the address, then answers until interrupted. SIGUSR1, where there is one, is the reset button."""
    if not 0 < args.rate <= FASTEST:
        raise InputError(f"--rate is {args.rate:g}; wanted more than 0, at most {FASTEST:g}")
    if not 0 <= args.ship_speed_mps < 100 or not 0 <= args.gps_rms_m < 1e5:
        raise InputError(
            "--ship-speed-mps and --gps-rms-m: wanted a speed of 0 to 100 and an error of 0 or more"
        )
    hunt = SimulatedHunt(
        SCENARIOS[args.scenario], args.seed, args.ship_speed_mps, args.gps_rms_m, args.source_level_db
    )
    began = time.monotonic()
    faults = [name.strip() for name in args.faults.split(",") if name.strip()]
    try:
        line = SailLine(
            hunt, lambda: args.rate * (time.monotonic() - began), faults, time.time(), args.gps_decimals
        )
    except ValueError as error:
        raise InputError(f"--faults: {error}") from None
    with _served(line, args) as served:
        stopped = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stopped.set())
        if hasattr(signal, "SIGUSR1"):
            signal.signal(signal.SIGUSR1, lambda *_: line.receiver.reset())
        print(_greeting(served.address, args), flush=True)
        while not stopped.wait(0.2):
            pass


def _served(line: SailLine, args: argparse.Namespace) -> TcpLine | PtyLine:
    if args.pty:
        try:
            return PtyLine(line)
        except OSError as error:
            raise InputError(f"--pty: {error.strerror}") from None
    host, _, port = (args.tcp or "127.0.0.1:0").rpartition(":")
    if not port.isdigit() or int(port) > 65535:
        raise InputError(f"--tcp is {args.tcp}; wanted HOST:PORT, such as 127.0.0.1:4001")
    try:
        return TcpLine(line, host.strip("[]") or "127.0.0.1", int(port))
    except OSError as error:
        raise InputError(f"--tcp: cannot listen on {args.tcp} ({error.strerror})") from None


def _greeting(address: str, args: argparse.Namespace) -> str:
    if args.json:
        return json.dumps(
            {"address": address, "scenario": args.scenario, "rate": args.rate, "simulated": True}
        )
    return (
        f"{address}: SIMULATED receiver #PTR and GPS #GPS, scenario {args.scenario}, {args.rate:g} times real time; "
        "interrupt to stop"
    )
