"""The detector one would build today: a matched filter on the carrier, with times, sigmas and honest false alarms.

Sound is mixed down to I and Q in cells of a millisecond or less; cells are summed over the pulse coherently, and
where the power of that sum stands out of the noise around it, the samples there say when the pulse began. The
signal-to-noise ratio is the pulse's energy over the noise's density (one-sided), which is also the carrier's power
over the noise's in a band of one over the pulse.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from trackerlib.receiver import demodulation as kernels
from trackerlib.receiver.arrivals import Arrivals, Heard, joined
from trackerlib.receiver.cells import CellStream, MatchedFilter

NOISE_CELLS = 200  # pulse lengths of sound that a noise level rests on
NOISE_SHARE = 0.75  # of them that it uses, the weakest: up to a quarter may hold pulses
FEWEST_CELLS = 8  # of a stream that is searched at all
QUIETEST = 1e-7  # noise of digital silence, rms a sample over full scale
LUCKY = 3e-3  # of the pulses that there may be are so weak that only luck lifts them over the threshold
EXPECTED = 5  # intervals in which a pulse heard in its place makes the next one no matter of luck
PLACE = 0.1  # of an interval: half width of where it would come
NOTHING = joined([])


def threshold(false_alarm: float, kept: int) -> float:
    """Power over estimated noise that noise alone exceeds with probability `false_alarm`.

    Powers of noise are exponentially distributed and independent; the noise is the mean of a censored sample, from
    its `kept` smallest, which is gamma distributed: the probability is (1 + T / kept)^-kept. That is exact for a cell
    outside the sample; the detector's cells are in or astride it, which makes it true to some 6 % (`detection_curve`).
    """
    return kept * (false_alarm ** (-1 / kept) - 1)


class ModernDetector:
    """Finds pulses of a known carrier and length in a stream of sound (see `arrivals.Detector`).

    interval_s : repetition period that arrivals are numbered and ranked in, from the first sample on
    false_alarm : probability that noise alone exceeds the threshold in one cell (a millisecond for pulses of 8 ms
        and more); 1e-6 is four cells an hour
    maxima : most arrivals told of one period; window_s : no two arrivals lie closer, at least the pulse (default)
    full_scale : amplitude of the carrier that is darkest on paper, of samples whose full scale is 1 (integers are
        scaled by their kind); span_db : what lies that much below is bare
    Raises ValueError, naming the setting, for one that makes no sense. A pulse that either end of the stream cuts is
    not told. 1.96 sigma_s hold 92 to 98 % of the arrivals within a pulse of a true one, from 0 to 30 dB and whatever
    the threshold, by simulation (10-ms pulses): a pulse too weak to pass often, and heard alone, is told with the
    sigma of one that luck lifted. Its snr_db is as lucky. Doppler is not followed: 5 m/s costs a 10-ms pulse at 10 kHz
    1.6 dB and does not bias its time.
    """

    def __init__(
        self,
        rate_hz: int,
        carrier_hz: float,
        pulse_s: float,
        interval_s: float,
        *,
        false_alarm: float = 1e-6,
        maxima: int = 8,
        window_s: float | None = None,
        full_scale: float = 1.0,
        span_db: float = 72.0,
    ):
        self.matched = matched = MatchedFilter(rate_hz, carrier_hz, pulse_s)
        window_s = pulse_s if window_s is None else window_s
        for name, value, least, most in (
            ("interval_s", interval_s, 2 * pulse_s, 3600),
            ("false_alarm", false_alarm, 1e-30, 0.5),
            ("maxima", maxima, 1, 1000),
            ("window_s", window_s, 0, interval_s),
            ("full_scale", full_scale, 1e-9, 1e9),
            ("span_db", span_db, 10, 200),
        ):
            if not least <= value <= most:
                raise ValueError(f"{name} is {value:g}; wanted {least:g} to {most:g}")
        self.interval_s, self.false_alarm, self.maxima = interval_s, false_alarm, maxima
        self._window = max(int(np.ceil(window_s * matched.cells_per_s)), matched.cells)
        self._frame_cells = NOISE_CELLS * matched.cells
        self._ahead = self._window + matched.cells + 2
        octave = 255 * 10 * np.log10(2) / span_db  # levels
        black = 255 - octave * np.log2((full_scale * matched.length / 2) ** 2)  # level of a power of 1
        room = self._frame_cells + self._ahead + self._frame_cells // 2
        self._stream = CellStream(matched, self._ahead + matched.cells, room, (black, octave))
        self._searched = 0  # first cell that was not searched yet
        self._noise, self._kept = 0.0, 0  # variance a sample, and how many cells it was taken from
        # arrival_s, sigma_s, log likelihood and power of arrivals in periods that are not over
        self._open: list[tuple[float, ...]] = []
        self._before_s: list[float] = []  # arrivals of the last few intervals
        places = 2 * PLACE * EXPECTED * interval_s * matched.cells_per_s  # cells in which those would come
        self._sparse = false_alarm * places < 0.1  # noise hardly ever stands in one

    def feed(self, samples: np.ndarray) -> Heard:
        """Levels of the milliseconds and arrivals of the periods that samples (K,), integers or floats, complete.

        Raises ValueError for samples that are no row of finite numbers.
        """
        samples = np.asarray(samples)
        if samples.ndim != 1 or samples.dtype.kind not in "if":
            raise ValueError(
                f"samples are {samples.dtype} of shape {samples.shape}; wanted one row of numbers"
            )
        taken, levels = self._stream.take(samples)
        arrivals = self._arrivals()
        if taken == len(samples):
            return Heard(levels, arrivals)
        parts = [Heard(levels, arrivals)]
        while taken < len(samples):
            count, levels = self._stream.take(samples[taken:])
            taken += count
            parts.append(Heard(levels, self._arrivals()))
        return Heard(
            np.concatenate([part.levels for part in parts]), joined([part.arrivals for part in parts])
        )

    def finish(self) -> Heard:
        """The arrivals of what was still open."""
        self._stream.end()
        self._search(self._searched, self._stream.done)
        return Heard(np.empty(0, np.uint8), self._close(np.inf))

    def _arrivals(self) -> Arrivals:
        """Arrivals of the periods that became complete."""
        if self._stream.done < self._searched + self._frame_cells + self._ahead:
            return NOTHING
        end = self._searched + self._frame_cells
        self._search(self._searched, end)
        self._searched = end
        self._stream.forget(end)
        return self._close(end / self.matched.cells_per_s - 2 * self.matched.pulse_s)

    def _search(self, first: int, last: int) -> None:
        """Finds the arrivals whose pulse ends in cells first to last."""
        stream, matched = self._stream, self.matched
        self._measure_noise(
            stream.power[max(first + matched.cells - 1 - stream.base, 0) : last - stream.base]
        )
        if not self._kept:
            return
        samples = matched.cells * matched.rate_hz / matched.cells_per_s
        least = threshold(self.false_alarm, self._kept) * self._noise * samples
        for place in kernels.local_maxima(
            stream.power, first - stream.base, last - stream.base, self._window, least
        ):
            self._refine(stream.base + int(place))

    def _measure_noise(self, power: np.ndarray) -> None:
        """Variance a sample of the noise under these powers; a rest that is too short leaves it as it was."""
        apart = power[:: self.matched.cells]
        enough = FEWEST_CELLS if not self._kept else NOISE_CELLS // 2
        if len(apart) < enough:
            return
        self._kept = int(NOISE_SHARE * len(apart))
        samples = self.matched.cells * self.matched.rate_hz / self.matched.cells_per_s
        mean = kernels.censored_mean(apart, self._kept)
        self._noise = max(mean / samples, QUIETEST**2)

    def _refine(self, cell: int) -> None:
        """Keeps time, sigma, likelihood and power of the pulse that ends about with a cell, if it is whole."""
        stream, matched = self._stream, self.matched
        origin, length = matched.start_of(stream.base), matched.length
        middle = matched.start_of(cell - matched.cells + 1)
        first = max(middle - length, 0)
        last = min(middle + length + 1, origin + stream.filled - length)
        if last - first < 3:
            return
        likelihood = kernels.log_likelihood(
            stream.buffer, first - origin, first, last - first, length, matched.rotation, self._noise
        )
        if np.argmax(likelihood) in (0, len(likelihood) - 1):
            return
        passed = threshold(self.false_alarm, self._kept)
        lucky = 0.0 if self._expected(middle / matched.rate_hz) else LUCKY
        begin, sigma, best = kernels.posterior_time(likelihood, passed, lucky)
        begin = max(begin + first + (length - matched.pulse_s * matched.rate_hz) / 2, 0.0)
        rate = matched.rate_hz
        self._open.append((begin / rate, sigma / rate, best, best * self._noise * length))

    def _expected(self, time_s: float) -> bool:
        """Whether a pulse came about whole intervals before: if one in so many passes, none does by luck."""
        period = self.interval_s
        recent = [each for each in self._before_s if each > time_s - (EXPECTED + PLACE) * period]
        self._before_s = [*recent, time_s]
        late = [(time_s - each) / period for each in recent]
        return self._sparse and any(each > 0.5 and abs(each - round(each)) < PLACE for each in late)

    def _close(self, until_s: float) -> Arrivals:
        """The strongest arrivals of each period that ended by a time, and no longer open."""
        closed, still_open = [], []
        for found in self._open:
            period = int(found[0] // self.interval_s)
            if (period + 1) * self.interval_s <= until_s:
                closed.append((period, *found))
            else:
                still_open.append(found)
        self._open = still_open
        return self._ranked(closed) if closed else NOTHING

    def _ranked(self, found: list[tuple[float, ...]]) -> Arrivals:
        """Arrivals from rows of period, arrival_s, sigma_s, log likelihood and power."""
        found.sort(key=lambda row: (row[0], -row[3]))
        rank = [1]
        for before, row in pairwise(found):
            rank.append(rank[-1] + 1 if row[0] == before[0] else 1)
        number = np.array(rank)
        told = number <= self.maxima
        period, time_s, sigma_s, likelihood, power = np.array(found)[told].T
        level = np.empty(len(power), np.uint8)
        kernels.log_levels(power.astype(np.float32), self._stream.scale[0], self._stream.scale[1], level)
        snr_db = 10 * np.log10(np.maximum(likelihood - kernels.OVERSHOOT, 0.1))
        nothing = np.zeros(len(time_s))
        return Arrivals(
            period.astype(int), number[told], time_s, level.astype(float), nothing, snr_db, sigma_s
        )
