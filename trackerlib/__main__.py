"""`python -m trackerlib COMMAND ...`."""

import sys

try:
    from trackerlib.commands import main

    sys.exit(main())
except KeyboardInterrupt:  # while a command is still being loaded, which takes a second
    print("interrupted", file=sys.stderr)
    sys.exit(130)
