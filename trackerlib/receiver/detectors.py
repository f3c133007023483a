"""The detectors there are, by name, and one set up for a recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from trackerlib.receiver.arrivals import Detector, Heard
from trackerlib.receiver.front_end import Attenuator
from trackerlib.receiver.matched import ModernDetector
from trackerlib.receiver.report_receiver import ReceiverSettings, ReportReceiver, first_attenuation

DETECTORS = ("report", "modern")
LOOK_S = 60.0  # most of a stream that is looked at to set the gain


def make_detector(
    name: str, settings: ReceiverSettings, rate_hz: int, first: Sequence[np.ndarray], full_scale: float = 1.0
) -> Detector:
    """The detector of that name, its gain set by the stream's first period. Raises ValueError, naming the setting.

    first : blocks that the stream begins with; full_scale : see `ModernDetector`
    """
    if name == "modern":
        return ModernDetector(
            rate_hz,
            settings.carrier_hz,
            settings.pulse_s,
            settings.interval_s,
            maxima=settings.maxima,
            window_s=settings.window_s,
            full_scale=full_scale,
        )
    if settings.attenuator.automatic and first:
        start_db = first_attenuation(np.concatenate(first), settings, rate_hz)
        settings = replace(settings, attenuator=Attenuator(True, start_db))
    return ReportReceiver(settings, rate_hz)


def hear(
    name: str,
    settings: ReceiverSettings,
    rate_hz: int,
    blocks: Iterator[np.ndarray],
    block_s: float,
    full_scale: float = 1.0,
) -> Iterator[Heard]:
    """What the detector of that name makes of a stream, block by block; the last is what its end makes known."""
    first = list(islice(blocks, int(min(settings.interval_s, LOOK_S) / block_s) + 1))
    detector = make_detector(name, settings, rate_hz, first, full_scale)
    for block in first:
        yield detector.feed(block)
    for block in blocks:
        yield detector.feed(block)
    yield detector.finish()
