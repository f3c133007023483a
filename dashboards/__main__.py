"""`python -m dashboards [--address A] [--port P] ...`: the app, guarded, on this machine only.

Any further option goes to `panel serve`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from panel.command import main

HERE = Path(__file__).parent


def arguments(told: list[str]) -> list[str]:
    """The command line of `panel serve` for this app, with the defaults that are not told otherwise."""
    defaults = {
        "--address": "127.0.0.1",
        "--port": "5006",
        "--setup": str(HERE / "guard.py"),
        "--unused-session-lifetime": "15000",
    }
    command = ["panel", "serve", str(HERE / "app.py"), "--warm", *told]
    for option, value in defaults.items():
        if not any(one == option or one.startswith(option + "=") for one in told):
            command += [option, value]
    return command


if __name__ == "__main__":
    sys.argv = arguments(sys.argv[1:])
    main()
