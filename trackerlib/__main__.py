"""`python -m trackerlib COMMAND ...`."""

import sys

from trackerlib.commands import main

sys.exit(main())
