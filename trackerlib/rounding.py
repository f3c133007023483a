"""Numbers as a person should read them: never more digits than are known."""

from __future__ import annotations

import math


def decimals_for(sigma: float) -> int:
    """Decimals that show two digits of a standard error; negative for tens, hundreds."""
    if not math.isfinite(sigma) or sigma <= 0:
        return 3
    magnitude = math.floor(math.log10(sigma))
    if round(sigma, 1 - magnitude) >= 10 ** (magnitude + 1):  # 0.0996 reads 0.10
        magnitude += 1
    return 1 - magnitude


def rounded(value: float) -> str:
    """A size of 0 or more to two digits, never as a power of ten: 1133 is `1100`, 0.0457 is `0.046`."""
    if value == 0:
        return "0"
    decimals = decimals_for(value)
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def value_with_sigma(value: float, sigma: float | None, unit: str) -> str:
    """A value and its standard error rounded together: `value_with_sigma(4481.27, 6.83, "m")` is `4481.3 ± 6.8 m`.

    Without a standard error the value stands alone, to six digits.
    """
    if value is None or not math.isfinite(value):
        return "unknown"
    if sigma is None or not math.isfinite(sigma):
        return f"{value:.6g} {unit}"
    decimals = decimals_for(sigma)
    shown = max(decimals, 0)
    return f"{round(value, decimals):.{shown}f} ± {round(sigma, decimals):.{shown}f} {unit}"
