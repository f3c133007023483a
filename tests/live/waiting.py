"""Waiting in tests for what another thread or process does."""

from __future__ import annotations

import time


def until(condition, seconds=20.0):
    """Waits for a condition; whether it came true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False
