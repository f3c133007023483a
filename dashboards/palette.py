"""Colours and marks that mean the same in every tab, legible in light, dark and grey print."""

from __future__ import annotations

from bokeh.palettes import RdBu11

# Okabe and Ito's colours, which colour-blind eyes tell apart.
FIRST_ARRAY = "#0072B2"  # blue
SECOND_ARRAY = "#D55E00"  # orange
ESTIMATE = "#CC3377"  # our fix, our estimate
TRUTH = "#009E73"  # green: published or true, only where known
SHIP = "#5A6470"  # thin dark line that still shows on black
REJECTED = "#8A8F96"  # grey cross
BEFORE = "#8A8F96"

# Downrange, crossrange and vertical components: Tol's muted set, apart from the arrays' colours.
COMPONENTS = ("#AA4499", "#44AA99", "#999933")

# Residuals: blue early, red late, symmetric about zero, its middle darkened so that it shows on white.
DIVERGING = [*RdBu11[:5], "#B8B8B8", *RdBu11[6:]]

# Wet paper: warm white to brown-black, 254 steps of ink.
PAPER_WHITE = (247, 241, 227)
PAPER_INK = (48, 34, 24)


def paper_colours(steps: int = 256) -> list[str]:
    """Ink on wet paper, from bare paper to darkest mark."""
    return [
        "#"
        + "".join(
            f"{round(white + (ink - white) * (k / (steps - 1)) ** 0.8):02x}"
            for white, ink in zip(PAPER_WHITE, PAPER_INK, strict=True)
        )
        for k in range(steps)
    ]
