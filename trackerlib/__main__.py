"""`python -m trackerlib COMMAND ...`."""

import io
import sys

if isinstance(sys.stdout, io.TextIOWrapper):
    sys.stdout.reconfigure(errors="replace")  # a terminal that knows no ± gets the rest
try:
    from trackerlib.commands import main

    sys.exit(main())
except KeyboardInterrupt:  # while a command is still being loaded, which takes a second
    print("interrupted", file=sys.stderr)
    sys.exit(130)
