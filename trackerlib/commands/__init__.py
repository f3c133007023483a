"""The shell's way in: `python -m trackerlib COMMAND ...`, one module a command.

A module has `SUMMARY`, `add_arguments(parser)`, `run(args) -> document` and `report(document) -> str`. One that
runs until interrupted prints for itself, and its `run` returns None.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

import numpy as np

from trackerlib.textfiles import InputError

COMMANDS = (
    "gate",
    "timing",
    "correct",
    "constancy",
    "fix",
    "plan",
    "montecarlo",
    "study",
    "listen",
    "emulate-receiver",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and prints its answer. Returns 0 for a result, 2 for an input that is no use.

    A wrong call ends in SystemExit(2), as argparse does it.
    """
    argv = sys.argv[1:] if argv is None else list(argv)
    args = parser_of(argv).parse_args(argv)
    try:
        document = args.module.run(args)
        if document is not None:
            print(to_json(document) if args.json else args.module.report(document))
    except InputError as error:
        print(f"{args.command}: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{args.command}: {error.filename or 'output'}: {error.strerror}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stopped:
        print(f"{args.command}: interrupted{f'; {stopped}' if stopped.args else ''}", file=sys.stderr)
        return 130
    return 0


def to_json(document: dict) -> str:
    """One JSON document; NaN and infinity become null, numpy's numbers and arrays plain ones."""
    return json.dumps(plain(document), allow_nan=False, ensure_ascii=False)


def plain(value):
    """The same value in types JSON knows."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


class _Parser(argparse.ArgumentParser):
    """A wrong call is one sentence: the usage of `fix` is a page long and would hide it."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; --help tells the options\n")


def parser_of(argv: Sequence[str]) -> argparse.ArgumentParser:
    """What reads a call: of all commands, or of the one that is called."""
    about = "From timed signals to tracks, fixes and honest error figures. COMMAND --help lists a command's options."
    parser = _Parser(prog="python -m trackerlib", description=about)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    # Only the command that is called is loaded: some take a second to import.
    for name in argv[:1] if argv and argv[0] in COMMANDS else COMMANDS:
        module = import_module(f"trackerlib.commands.{name.replace('-', '_')}")
        command = commands.add_parser(name, help=module.SUMMARY, description=module.SUMMARY)
        module.add_arguments(command)
        command.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
        command.set_defaults(module=module)  # a name that no option has: `timing` has --run
    return parser
