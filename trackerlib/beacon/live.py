"""A fix that takes pings one at a time, for a day at ten a second, in the same time each and bounded memory.

    live = LiveFix(frame, FixSettings(gps_rms_m=3))
    live.add(number, east_north_up, seconds, travel_time_s)
    live.fix()

The squared range is quadratic in the unknowns, so with instruments and weights as they were when a ping came, all
that it will ever say is in a dozen weighted sums. They are made afresh from the pings kept whenever their number
has doubled, with instruments at the fix of that time: the answer is that of all pings at once. Until there is a
first fix that can be believed, `fix_beacon` is asked, at growing intervals, and its refusals are passed on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from trackerlib.beacon import squared_sums
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.minimise import CUT
from trackerlib.beacon.observability import UNSEEN_SHARE
from trackerlib.beacon.paths import paths_through
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import FixSettings
from trackerlib.beacon.small_systems import scaled_solve
from trackerlib.beacon.squared_sums import ONE
from trackerlib.beacon.squared_sums import RANGE as RANGES
from trackerlib.beacon.unbiased import NEIGHBOUR_SHARE
from trackerlib.beacon.uncertainty import Uncertainty
from trackerlib.compiled import compiled, warms
from trackerlib.frames import LocalFrame
from trackerlib.residuals import correlation_from

NEIGHBOURS = 10  # pings on either side whose straight line stands for the ship's place
KEPT = 1 << 17  # pings kept, three and a half hours at ten a second; older ones live on in the sums
FIRST_COUNT, GROWTH = 8, 1.5  # when a first fix is tried
FEW = 200  # pings, up to which the last ones count in where instruments are taken
FARTHEST = 0.2  # of the slant range: how far one ping may move a fix
LEAST_FOLLOWED = 0.6  # share of the pings that must fit
LAGS = 128  # of residuals whose correlation is followed
STEPS = 30
RANGE_SQUARED = squared_sums.COLUMNS  # the sums' last column, after those of squared_sums
EAST, NORTH, UP, TIME, RANGE = range(5)  # columns of a ping


class LiveFix:
    """The fix of one beacon from the pings heard so far.

    frame : local frame of the ship's positions
    settings : motion still or free; gps_rms_m None counts as the ship's error being part of the time's
    Raises ValueError for settings that pings one at a time cannot serve.
    """

    def __init__(
        self, frame: LocalFrame, settings: FixSettings, time_step_s: float = 0.0, simulated: bool = False
    ):
        if settings.motion not in ("still", "free") or settings.method != "all-pings":
            raise ValueError("a live fix is for every ping and a motion still or free")
        if settings.emission_known or settings.interval_s is not None:
            raise ValueError("a live fix is for an unknown emission time and times that are not folded")
        if settings.estimate_sound_speed or settings.gps_correlation_s or any(settings.antenna_sigma_m):
            raise ValueError(
                "a live fix estimates no speed of sound and knows white errors of the ship alone"
            )
        self.frame, self.settings = frame, settings
        self.count = 0
        self.reason: str | None = "no ping yet"
        self._simulated = simulated
        self._moving = settings.motion == "free"
        self._unknowns = 7 if self._moving else 4
        step_s = time_step_s if settings.sample_interval_ms is None else settings.sample_interval_ms * 1e-3
        self._time_step_s = step_s
        self._time_sigma_s = max(step_s / np.sqrt(12), 1e-6)
        self._paths = paths_through(settings.sound_speed_mps, settings.profile, settings.max_depth_m)
        self._rows = np.empty((KEPT, 5))
        self._numbers = np.empty(KEPT, np.int64)
        self._travel = np.empty(KEPT)
        self._theta: np.ndarray | None = None
        self._next_try = FIRST_COUNT
        self._next_renewal = 0
        self._sums = _Sums(self._unknowns)
        self._absorbed = 0
        self._scale = 1.0
        self._first: BeaconFix | None = None
        self._offset_s, self._speed_mps, self._straight = (
            0.0,
            settings.sound_speed_mps,
            settings.profile is None,
        )

    # -- pings ---------------------------------------------------------------------------------

    def add(self, number: int, east_north_up, seconds: float, travel_time_s: float) -> None:
        """Takes one ping: its number, the hydrophone [m], its instant and one-way time with any constant [s].

        What is not finite is counted and left out.
        """
        place = np.asarray(east_north_up, float)
        if not (np.isfinite(place).all() and np.isfinite(seconds) and np.isfinite(travel_time_s)):
            return
        k = self.count % KEPT
        self._rows[k, :3], self._rows[k, TIME] = place, seconds
        self._travel[k], self._numbers[k] = travel_time_s, number
        self.count += 1
        if self._theta is None:
            if self.count >= self._next_try:
                self._try_first()
            return
        self._rows[k, RANGE] = self._range_of(place, seconds, travel_time_s)
        self._absorb()
        if self.count >= self._next_renewal and self.count <= KEPT:
            self._renew()

    def _try_first(self) -> None:
        """Asks the batch for a first fix that can be believed."""
        self._next_try = int(np.ceil(GROWTH * self.count))
        if self.count > KEPT:
            return
        self._first = fix = fix_beacon(self._as_pings(self.count), self.settings)
        self.reason = fix.reason
        if not fix.converged:
            return
        self._offset_s = fix.emission_offset_s
        self._speed_mps = fix.sound_speed_mps
        # The frame of the batch has its origin at the first ping; ours is told.
        lat, lon, up = fix.frame.to_geodetic(fix.position)
        place = self.frame.to_local(lat, lon, up)
        velocity = np.zeros(3) if fix.velocity is None else fix.velocity
        self._scale = self._scale_of(fix)
        place = place - self._rows[0, TIME] * velocity
        self._theta = np.concatenate([place, [0.0], velocity] if self._moving else [place, [0.0]])
        self._renew()

    def _scale_of(self, fix: BeaconFix) -> float:
        """How many times as large as told the errors of a fix are."""
        gps, time = self._variances()
        residual = fix.residual_s[fix.used] * self._speed_mps
        offset = fix.position - fix.ship[fix.used]
        level = 1 - offset[:, 2] ** 2 / np.sum(offset**2, axis=1)
        freedom = max(len(residual) - self._unknowns, 1)
        return float(np.sqrt(np.sum(residual**2 / (gps * level + time)) / freedom))

    def _as_pings(self, count: int) -> Pings:
        rows = self._rows[:count]
        lat, lon, up = self.frame.to_geodetic(rows[:, :3])
        return Pings(
            number=self._numbers[:count].copy(),
            lat_deg=lat,
            lon_deg=lon,
            up_m=up,
            travel_time_s=self._travel[:count].copy(),
            utc=np.full(count, np.datetime64("NaT", "ms")),
            clock_s=rows[:, TIME].copy(),
            time_step_s=self._time_step_s,
            simulated=self._simulated,
        )

    def _range_of(self, place, seconds, travel_time_s) -> float:
        """The straight distance that stands for a travel time: along rays, near the present fix."""
        if self._straight:
            return self._speed_mps * (travel_time_s - self._offset_s)
        beacon = self._theta[:3] + (seconds * self._theta[4:] if self._moving else 0.0)
        time = self._paths.times(beacon[None], place[None])[0][0, 0]
        distance = np.linalg.norm(beacon - place)
        return float(distance + distance / time * (travel_time_s - self._offset_s - time))

    def _renew(self) -> None:
        """Makes the sums afresh from the pings kept, with instruments at the present fix."""
        for step in range(3):
            if self._theta is None:
                return
            self._all_ranges()
            if step == 0:  # what they tell does not hang on their times, false ones among them
                every = _Sums(self._unknowns)
                self._add_to(every, 0, self.count, cut=np.inf)
                _invert(every.spread, self._sums.told)
            told = self._sums.told
            self._sums = _Sums(self._unknowns)
            self._sums.told[:] = told
            self._absorbed = 0
            self._absorb()
        self._next_renewal = 2 * self.count

    def _all_ranges(self) -> None:
        rows, travel = self._rows[: self.count], self._travel[: self.count]
        self._offset_s += self._theta[3] / self._speed_mps
        self._theta[3] = 0.0
        if self._straight:
            rows[:, RANGE] = self._speed_mps * (travel - self._offset_s)
            return
        beacon = self._theta[:3] + (
            rows[:, TIME, None] * self._theta[4:] if self._moving else np.zeros((len(rows), 3))
        )
        time = self._paths.times(beacon[None], rows[:, :3])[0][0]
        distance = np.linalg.norm(beacon - rows[:, :3], axis=1)
        rows[:, RANGE] = distance + distance / time * (travel - self._offset_s - time)

    def _absorb(self) -> None:
        """Adds to the sums every ping whose neighbours on both sides have come, and solves them."""
        ready = self.count - NEIGHBOURS
        if ready > self._absorbed:
            self._absorbed = self._add_to(self._sums, self._absorbed, ready)
        if self.count > FEW:
            self._solve(self._sums, self._absorbed)
        else:
            self._solve(self._with_the_last(), self.count)

    def _add_to(self, sums: _Sums, first: int, last: int, cut: float = CUT) -> int:
        """Adds pings first to last (their running numbers) to the sums; `last`."""
        gps, time = self._variances()
        return _absorb(
            self._rows, first, last, self.count, self._theta, gps, time, cut, self._scale, *sums.arrays
        )

    def _with_the_last(self) -> _Sums:
        """The sums, with the last pings, whose neighbours after them have not come yet."""
        sums = self._sums.copy()
        self._add_to(sums, self._absorbed, self.count)
        return sums

    def _variances(self) -> tuple[float, float]:
        """Variances [m^2] of a ship position (each axis) and of a range, before scaling to the residuals."""
        return (self.settings.ship_rms_m or 0.0) ** 2, (self._speed_mps * self._time_sigma_s) ** 2

    def _solve(self, sums: _Sums, seen: int) -> None:
        """Moves the fix to where the sums of so many pings seen have it."""
        theta = self._theta.copy()
        solved = _solve_sums(sums.moments, theta) and theta[2] < self._rows[0, UP]
        reach = FARTHEST * np.linalg.norm(self._theta[:3] - self._rows[(self.count - 1) % KEPT, :3])
        followed = sums.tally[0] >= LEAST_FOLLOWED * seen
        if solved and followed and np.linalg.norm(theta[:3] - self._theta[:3]) < reach:
            self._theta = theta
        elif self.count <= KEPT:  # a fix that was believed too early
            self._theta, self._next_try = None, int(np.ceil(GROWTH * self.count))
            self.reason = "the pings that followed moved the first fix too far; sail on"
            if not followed:
                self.reason = "most pings that followed do not fit the first fix; sail on"
            return
        used = sums.tally[0]
        if used > self._unknowns + 3:
            self._scale = max(float(np.sqrt(sums.tally[1] / (used - self._unknowns))), 1e-3)
            _invert(sums.spread, self._sums.told)

    # -- the answer ----------------------------------------------------------------------------

    def fix(self) -> BeaconFix:
        """The fix of all pings so far, or the reason why there is none."""
        kept = min(self.count, KEPT)
        if self._theta is None:
            if self._first is not None:
                return replace(self._first, converged=False, reason=self.reason)
            return fix_beacon(self._as_pings(kept), self.settings)  # fewer than a first try needs
        theta, sums = self._theta.copy(), self._with_the_last()
        solved = _solve_sums(sums.moments, theta)
        uncertainty = self._uncertainty(theta, sums)
        order = np.arange(self.count - kept, self.count) % KEPT
        rows = self._rows[order]
        place = theta[:3] + (rows[:, TIME, None] * theta[4:] if self._moving else 0.0)
        residual = (rows[:, RANGE] - theta[3] - np.linalg.norm(place - rows[:, :3], axis=1)) / self._speed_mps
        began = float(rows[0, TIME])
        position = theta[:3] + (began * theta[4:] if self._moving else 0.0)
        lat, lon, up = self.frame.to_geodetic(position)
        fix = BeaconFix(
            converged=True,
            reason=None,
            frame=self.frame,
            ship=rows[:, :3],
            number=self._numbers[order],
            used=np.abs(residual)
            < CUT * max(float(np.median(np.abs(residual))) * 1.4826, self._time_sigma_s),
            position=position,
            velocity=theta[4:] if self._moving else None,
            elapsed_s=rows[:, TIME] - began,
            lat_deg=float(lat),
            lon_deg=float(lon),
            depth_m=-float(up),
            residual_s=residual,
            uncertainty=uncertainty,
            emission_offset_s=self._offset_s + theta[3] / self._speed_mps,
            sound_speed_mps=self._speed_mps,
            simulated=self._simulated,
        )
        slant_range = float(np.median(np.linalg.norm(place - rows[:, :3], axis=1)))
        if not solved or uncertainty is None:
            return replace(
                fix, converged=False, reason="the pings so far do not determine the place; sail on, and turn"
            )
        widest = np.sqrt(np.linalg.eigvalsh(fix.present.covariance)[-1])
        if widest > UNSEEN_SHARE * slant_range:
            why = f"the beacon can move by {widest:.0f} m one way within the noise; sail further, on another bearing"
            return replace(fix, converged=False, reason=why)
        return fix

    def _uncertainty(self, theta: np.ndarray, sums: _Sums) -> Uncertainty | None:
        own = np.empty((self._unknowns, self._unknowns))
        squared_sums.score(sums.moments, theta, np.empty(self._unknowns), own)
        used, squares = sums.tally[:2]
        correlation = correlation_from(sums.autocorrelation(), int(used))
        freedom = used / correlation.variance_length - self._unknowns
        if freedom < 1 or not np.isfinite(own).all():
            return None
        scale = np.sqrt(np.abs(np.diag(own)))
        inverse = np.linalg.pinv(own / np.outer(scale, scale)) / np.outer(scale, scale)
        variance = squares / (used - self._unknowns) * correlation.length
        widened = (stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)) ** 2
        noise = variance * widened * inverse @ sums.spread @ inverse.T
        # The range less c0 scales with the speed of sound; the answer moves to undo it.
        c0, moments = theta[3], sums.moments
        by_speed = (
            inverse
            @ (2 * (moments[:, RANGE_SQUARED] - 2 * c0 * moments[:, RANGES] + c0**2 * moments[:, ONE]))
            / self._speed_mps
        )
        covariance = noise + self.settings.speed_sigma_mps**2 * np.outer(by_speed, by_speed)
        keep = [0, 1, 2, 4, 5, 6] if self._moving else [0, 1, 2]
        matrix = np.eye(len(keep))
        if self._moving:
            matrix[:3, 3:] = float(self._rows[(self.count - min(self.count, KEPT)) % KEPT, TIME]) * np.eye(3)
        grid = np.ix_(keep, keep)
        return Uncertainty(
            covariance=covariance[grid],
            noise_covariance=noise[grid],
            by_sound_speed=by_speed[keep],
            speed_sigma_mps=self.settings.speed_sigma_mps,
            rms_s=float(np.sqrt(sums.tally[2] / max(used, 1))) / self._speed_mps,
            correlation=correlation,
            degrees_of_freedom=float(freedom),
        ).turned(matrix)


class _Sums:
    """All that the pings absorbed so far have to say."""

    def __init__(self, unknowns: int):
        self.moments = np.zeros((unknowns, RANGE_SQUARED + 1))
        self.spread = np.zeros((unknowns, unknowns))
        self.tally = np.zeros(3)  # pings used, weighted squares, squares of range residuals [m^2]
        self.products = np.zeros(LAGS + 1)  # of whitened residuals, by lag
        self.recent = np.zeros(LAGS + 1)  # the last of them, newest at `tally[0] % (LAGS + 1)`
        self.told = np.zeros((unknowns, unknowns))  # covariance of the fix that new pings are held against

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        return self.moments, self.spread, self.tally, self.products, self.recent, self.told

    def copy(self) -> _Sums:
        other = _Sums(len(self.spread))
        for mine, theirs in zip(self.arrays, other.arrays, strict=True):
            theirs[:] = mine
        return other

    def autocorrelation(self) -> np.ndarray:
        """Autocorrelation of the residuals at lags 0, 1, ..., as far as a quarter of the series."""
        lags = min(int(self.tally[0]) // 4, LAGS) + 1
        return self.products[:lags] / max(self.products[0], 1e-300)


@compiled
def _absorb(
    rows, first, last, count, theta, gps_variance, range_variance, cut, scale,
    moments, spread, tally, products, recent, told,
):  # fmt: skip
    """Adds pings first to last (their running numbers) to the sums; `last`."""
    unknowns, kept = len(theta), len(rows)
    instrument, column = np.empty(unknowns), np.empty(RANGE_SQUARED + 1)
    gps, rng = gps_variance * scale * scale, range_variance * scale * scale
    for k in range(first, last):
        row = rows[k % kept]
        t, up = row[TIME], row[UP]
        vx, vy, vz = (theta[4], theta[5], theta[6]) if unknowns > 4 else (0.0, 0.0, 0.0)
        x, y, z = row[EAST] - theta[0] - t * vx, row[NORTH] - theta[1] - t * vy, theta[2] + t * vz - up
        s = row[RANGE] - theta[3]
        q = x * x + y * y - 2 * gps + z * z - s * s + rng
        east, north, near = _place_by_neighbours(
            rows, k, max(count - kept, 0), count, NEIGHBOUR_SHARE * abs(s)
        )
        ix, iy = (east - theta[0] - t * vx, north - theta[1] - t * vy) if near else (x, y)
        h2 = ix * ix + iy * iy
        s2 = h2 + z * z
        w = 1 / (4 * (h2 + gps) * gps_variance + (4 * s2 + 2 * rng) * range_variance)
        whitened = q * np.sqrt(w)
        instrument[0], instrument[1], instrument[2], instrument[3] = -2 * ix, -2 * iy, 2 * z, 2 * np.sqrt(s2)
        for i in range(4, unknowns):
            instrument[i] = t * instrument[i - 4]
        if abs(whitened) > cut * scale * np.sqrt(1 + w * _form(told, instrument)):
            continue
        _fill_column(row, rng - 2 * gps, column)
        for i in range(unknowns):
            for j in range(RANGE_SQUARED + 1):
                moments[i, j] += w * instrument[i] * column[j]
            for j in range(unknowns):
                spread[i, j] += w * instrument[i] * instrument[j]
        if not near:
            for axis in (EAST, NORTH):
                _take_out_own(axis, row, instrument, w, gps, gps_variance + range_variance, moments)
        _follow_residual(whitened, int(tally[0]), products, recent)
        tally[0] += 1
        tally[1] += whitened * whitened
        tally[2] += q * q / (4 * s2)
    return last


@compiled
def _form(matrix, vector):
    """vector' matrix vector."""
    total = 0.0
    for i in range(len(vector)):
        for j in range(len(vector)):
            total += vector[i] * matrix[i, j] * vector[j]
    return total


@compiled
def _invert(spread, told):
    """Fills the inverse of a spread (P, P); it stays as it was where there is none."""
    inverse, fine = scaled_solve(spread, np.eye(len(spread)))
    if fine:
        told[:] = inverse


@compiled
def _fill_column(row, known, column):
    """Fills what a ping's instrument is multiplied by; `known` is what its noise adds to q in the mean."""
    x, y, up, r, t = row[EAST], row[NORTH], row[UP], row[RANGE], row[TIME]
    column[0] = x * x + y * y + up * up - r * r + known
    column[1], column[2], column[3], column[RANGES], column[ONE] = x, y, up, r, 1.0
    column[6], column[7], column[8], column[9], column[10] = t * x, t * y, t * up, t, t * t
    column[RANGE_SQUARED] = r * r


@compiled
def _follow_residual(whitened, used, products, recent):
    """Adds a residual, the `used`-th, to the products by lag."""
    lags = len(products)
    recent[used % lags] = whitened
    for lag in range(min(used, lags - 1) + 1):
        products[lag] += whitened * recent[(used - lag) % lags]


@compiled
def _place_by_neighbours(rows, k, oldest, count, reach):
    """Where the straight line through the neighbours of ping k has the ship, and whether they all lie near."""
    here, kept = rows[k % len(rows)], len(rows)
    n = 0
    st = stt = sx = sy = stx = sty = farthest = 0.0
    for j in range(max(k - NEIGHBOURS, oldest), min(k + NEIGHBOURS, count - 1) + 1):
        if j == k:
            continue
        other = rows[j % kept]
        lag, x, y = other[TIME] - here[TIME], other[EAST] - here[EAST], other[NORTH] - here[NORTH]
        n += 1
        st, stt = st + lag, stt + lag * lag
        sx, sy, stx, sty = sx + x, sy + y, stx + lag * x, sty + lag * y
        farthest = max(farthest, x * x + y * y)
    bottom = n * stt - st * st
    if bottom > 0:
        east, north = (stt * sx - st * stx) / bottom, (stt * sy - st * sty) / bottom
    else:
        east, north = sx / max(n, 1), sy / max(n, 1)
    return here[EAST] + east, here[NORTH] + north, n > 0 and farthest < reach * reach


@compiled
def _take_out_own(axis, row, instrument, w, gps, variances, moments):
    """Takes out of the moments what an instrument at the ping's own noisy place leaves in the mean.

    As `squared_sums.take_out_shared` does, all of the error being shared.
    """
    unknowns, t = len(instrument), row[TIME]
    d, s = -instrument[axis] / 2, instrument[3]
    by_weight = -16 * gps * d * w * w * variances
    for i in range(unknowns):
        change = by_weight * instrument[i]
        if i % 4 == axis:
            change -= 4 * gps * w * (1.0 if i < 4 else t)
        elif i == 3:
            change += 8 * gps * w * d / s
        moments[i, 0] -= change * row[axis]
        moments[i, 1 + axis] -= change / 2
        moments[i, 6 + axis] -= change * t / 2


@compiled
def _solve_sums(moments, theta):
    """Newton's steps to where the score of the sums is zero, in place; whether they came to rest."""
    unknowns = len(theta)
    score, own = np.empty(unknowns), np.empty((unknowns, unknowns))
    for _ in range(STEPS):
        squared_sums.score(moments, theta, score, own)
        scale = np.sqrt(np.abs(np.diag(own)))
        if not np.all(scale > 0) or not np.all(np.isfinite(own)):
            return False
        scaled = own / scale.reshape(-1, 1) / scale.reshape(1, -1)
        if abs(np.linalg.det(scaled)) < 1e-30:
            return False
        step = np.linalg.solve(scaled, -score / scale) / scale
        theta += step
        if np.max(np.abs(step)) < 1e-6:
            return True
    return False


@warms
def _warm() -> None:
    for unknowns in (4, 7):
        theta = np.zeros(unknowns)
        theta[2] = -100.0
        sums = _Sums(unknowns)
        rows = np.random.default_rng(1).normal(size=(40, 5))
        _absorb(rows, 0, 30, 40, theta, 1.0, 1.0, CUT, 1.0, *sums.arrays)
        _solve_sums(sums.moments, theta)
