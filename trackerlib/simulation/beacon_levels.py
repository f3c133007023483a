"""What the receiver's converter shows of a simulated beacon: the ship on its hexagon, levels, sums, maxima.

    hunt = SimulatedHunt(SCENARIOS[2], seed=1)
    codes = hunt.codes(start_s=0.0, samples=2000, sample_s=1e-3, attenuation_db=0)
    largest_sums(moving_sums(codes), number=2, window=20)

Levels are made directly at the sample interval, as narrow-band noise and pulses of random phase behind the
envelope detector; no carrier is sampled. Constants of Wojcik (1993), chapter V. Everything made here is simulated.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from trackerlib.acoustics.absorption import absorption_db_per_km
from trackerlib.acoustics.ambient_noise import HYDROPHONE_DB, ambient_noise_db, equivalent_noise_v
from trackerlib.frames import LocalFrame
from trackerlib.receiver.front_end import DB_PER_COUNT, FULL_CODE, LEAST_V
from trackerlib.receiver.report_receiver import MEASURED_GAIN
from trackerlib.receiver.sail import SUM_SAMPLES, Maximum
from trackerlib.simulation.hexagon import LEG_M, Receptions, Scenario, sail_hexagon

PULSE_S = 0.01
CARRIER_HZ = 10_000.0
SOURCE_LEVEL_DB = 185.5  # re 1 uPa at 1 m: 30 W in all directions, the 145.5 dB at 100 m beside (5-12)
SEA_STATE = 3.0
BANDWIDTH_HZ = 100.0
ORIGIN_DEG = (39.5, -67.5)  # latitude and longitude of the hexagon's centre, in deep water


class SimulatedHunt:
    """A ship that sails round the hexagon over a beacon, for as long as anybody listens."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int = 0,
        speed_mps: float = 5.0,
        gps_rms_m: float = 3.0,
        source_level_db: float = SOURCE_LEVEL_DB,
    ):
        self.scenario, self.seed, self.speed_mps = scenario, seed, speed_mps
        self.gps_rms_m, self.source_level_db = gps_rms_m, source_level_db
        self.frame = LocalFrame(*ORIGIN_DEG)
        self._rng = np.random.default_rng(seed)
        self._known = sail_hexagon(scenario, 1024, speed_mps)
        corners = np.radians(60.0 * (4 + np.arange(7)))
        self._corners = LEG_M * np.column_stack([np.cos(corners), np.sin(corners)])

    def receptions(self, until_s: float) -> Receptions:
        """All receptions before an instant, and some after it."""
        while self._known.received_s[-1] < until_s:
            self._known = sail_hexagon(self.scenario, 2 * len(self._known.received_s), self.speed_mps)
        return self._known

    def ship(self, time_s: float) -> np.ndarray:
        """East and north (2,) [m] of the ship."""
        sailed = np.mod(self.speed_mps * time_s, 6 * LEG_M)
        return np.array([np.interp(sailed, LEG_M * np.arange(7), self._corners[:, k]) for k in (0, 1)])

    def gps(self, second: int) -> tuple[float, float]:
        """Latitude and longitude [degrees] that a GPS gives at a whole second; always the same for the same one."""
        noise = np.random.default_rng((self.seed, abs(second), 1)).normal(0, self.gps_rms_m, 2)
        lat, lon, _ = self.frame.to_geodetic(np.array([*(self.ship(second) + noise), 0.0]))
        return float(lat), float(lon)

    def codes(self, start_s: float, samples: int, sample_s: float, attenuation_db: float) -> np.ndarray:
        """Samples (samples,) of the converter, 0 to 255, louder is more: FFh less its reading."""
        rng = self._rng
        kept = np.exp(-np.pi * BANDWIDTH_HZ * sample_s)
        noise = equivalent_noise_v(ambient_noise_db(SEA_STATE), BANDWIDTH_HZ)
        white = rng.standard_normal((2, samples + 32)) * noise * np.sqrt((1 - kept**2) / 2)
        envelope = lfilter([1.0], [1.0, -kept], white[0] + 1j * white[1])[32:]
        heard = self.receptions(start_s + samples * sample_s)
        first = np.searchsorted(heard.received_s, start_s - PULSE_S)
        last = np.searchsorted(heard.received_s, start_s + samples * sample_s)
        for k in range(first, last):
            begin = (heard.received_s[k] - start_s) / sample_s
            at = np.arange(max(int(begin), 0), min(int(begin + PULSE_S / sample_s) + 2, samples))
            share = np.clip(at + 1 - begin, 0, 1) * np.clip(begin + PULSE_S / sample_s - at, 0, 1)
            level = self.source_level_db + HYDROPHONE_DB - spreading_loss(heard.range_m[k])
            envelope[at] += share * 10 ** (level / 20) * np.exp(2j * np.pi * rng.random())
        return levels_of(np.abs(envelope) * MEASURED_GAIN * 10 ** (-attenuation_db / 20))


def spreading_loss(range_m) -> np.ndarray:
    """Loss [dB] from 1 m to a range: spherical spreading and absorption."""
    return 20 * np.log10(range_m) + 1e-3 * np.asarray(range_m) * absorption_db_per_km(CARRIER_HZ)


def levels_of(volt: np.ndarray) -> np.ndarray:
    """What the logarithmic compressor and the 8-bit converter make of an envelope [V] (5-10), (5-25)."""
    counts = 20 * np.log10(np.maximum(volt, 1e-9) / LEAST_V) / DB_PER_COUNT
    return np.clip(np.rint(counts), 0, FULL_CODE).astype(np.int64)


def moving_sums(codes: np.ndarray) -> np.ndarray:
    """Sums of each sample and the ten before it (5-5), undivided; fewer at the start."""
    total = np.concatenate([np.zeros(SUM_SAMPLES, np.int64), np.cumsum(codes)])
    return total[SUM_SAMPLES:] - total[:-SUM_SAMPLES]


def largest_sums(sums: np.ndarray, number: int, window: int) -> tuple[Maximum, ...]:
    """The largest sums of a period, no two of them within `window` samples."""
    left = sums.copy()
    found = []
    for _ in range(number):
        k = len(left) - 1 - int(np.argmax(left[::-1]))  # of equals the controller keeps the last
        found.append(Maximum(max(int(left[k]), 0), k))
        left[max(k - window, 0) : k + window + 1] = -1
    return tuple(found)


def controller_maxima(sums: np.ndarray, number: int, window: int) -> tuple[Maximum, ...]:
    """What the controller's own program makes of the sums of a period, its mistakes at both ends included.

    Within a window of either end a sum not below the first maximum takes its place, wherever that was, and moves
    nothing down; a lesser one within a window of the end is passed over.
    """
    value, index, count = [0] * number, [0] * number, len(sums)
    for k, total in enumerate(sums.tolist()):
        if total < value[-1]:
            continue
        place = 0
        if total < value[0]:
            place = next((m for m in range(1, number) if total >= value[m]), number)
            if place == number or k - index[place - 1] < window or count - k < window:
                continue
        end = place == 0 and (k < window or count - k <= window)
        if not end and k - window > index[place]:
            value.insert(place, total)
            index.insert(place, k)
            del value[-1], index[-1]
        value[place], index[place] = total, k
    return tuple(Maximum(*each) for each in zip(value, index, strict=True))
