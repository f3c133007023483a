"""The operators' skill, helped: marks on a trace, the interval straightened, the hyperbola, the bearing line."""

from __future__ import annotations

import numpy as np

from dashboards.session import Session
from trackerlib.receiver.chart import ChartSettings
from trackerlib.receiver.following import ping_rows
from trackerlib.receiver.hyperbola import Marks, Pass, fit_pass, straighten
from trackerlib.receiver.intervals import separate
from trackerlib.receiver.late_echoes import late_echoes
from trackerlib.receiver.rolls import PingRoll, Roll

SNAP_COLUMNS = 12  # of the paper: a click so near to an arrival means that arrival
SNAP_LINES = 3
FREE_SIGMA_S = 2e-3  # of a mark that is no arrival: what a hand can do
ARRIVAL_SIGMA_S = 0.5e-3  # of an arrival whose detector tells no sigma
STRAIGHTEN_WITHIN = 0.01  # of the interval at which the paper is folded


class TraceMarks:
    """Marks as (line, time from its left edge), kept in the session so that Undo reaches them."""

    def __init__(self, session: Session):
        self.session = session
        self.found: Pass | None = None  # the hyperbola through the marks
        self._fitted: tuple = ()

    @property
    def marks(self) -> tuple[tuple[int, float], ...]:
        """The marks, in order of line."""
        return self.session.chart_marks

    def click(
        self, roll: Roll, settings: ChartSettings, line: float, fold_s: float, threshold: float
    ) -> None:
        """Marks the arrival nearest to a click, or the place itself; a mark that is there goes."""
        near = SNAP_COLUMNS * settings.interval_s / settings.columns
        for mark in self.marks:
            if abs(mark[0] + 0.5 - line) < SNAP_LINES and abs(mark[1] - fold_s) < near:
                self.session.edit(chart_marks=tuple(one for one in self.marks if one is not mark))
                return
        arrivals, at, folded = roll.placed(settings)
        away = np.hypot((at + 0.5 - line) / SNAP_LINES, (folded - fold_s) / near)
        away[arrivals.level < threshold] = np.inf
        best = int(np.argmin(away)) if len(away) else -1
        if best >= 0 and away[best] < 1:
            self.add([(int(at[best]), float(folded[best]))])
        elif 0 <= line < roll.whole_lines(settings) and 0 <= fold_s <= settings.interval_s:
            self.add([(int(line), float(fold_s))])

    def add(self, marks) -> None:
        """Further marks; of one line the newest counts."""
        kept = dict(self.marks) | dict(marks)
        self.session.edit(chart_marks=tuple(sorted(kept.items())))

    def choose(self, roll: Roll, settings: ChartSettings, rows) -> None:
        """Marks arrivals (rows of the roll), of each line the strongest."""
        arrivals, line, folded = roll.placed(settings)
        rows = np.asarray(rows, int)
        rows = rows[np.argsort(arrivals.level[rows], kind="stable")]
        self.add((int(line[row]), float(folded[row])) for row in rows)

    def clear(self) -> None:
        """No marks."""
        if self.marks:
            self.session.edit(chart_marks=())

    def times(self, roll: Roll, settings: ChartSettings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Line (M,), time of the stream [s] and standard error [s] of each mark."""
        line = np.array([mark[0] for mark in self.marks], int)
        time_s = roll.time_of(settings, line, np.array([mark[1] for mark in self.marks]))
        arrivals = roll.arrivals
        sigma = np.full(len(line), FREE_SIGMA_S)
        order = np.argsort(arrivals.arrival_s, kind="stable")
        if len(order) and len(line):
            sorted_s = arrivals.arrival_s[order]
            place = np.clip(np.searchsorted(sorted_s, time_s - 1e-7), 0, len(order) - 1)
            hit = np.abs(sorted_s[place] - time_s) < 1e-6
            told = arrivals.sigma_s[order[place]]
            sigma[hit] = np.where(np.isnan(told[hit]), ARRIVAL_SIGMA_S, np.maximum(told[hit], 1e-6))
        return line, time_s, sigma

    def straight(self, roll: Roll, settings: ChartSettings, threshold: float) -> tuple[float, float, str]:
        """Interval at which the marked trace stands upright, or without marks the strongest train; and its sigma [s].

        Last what other trains are, in words, if any is an echo. Raises ValueError where there is no trace.
        """
        if len(self.marks) >= 3:
            line, time_s, sigma = self.times(roll, settings)
            fold_s = time_s - roll.time_of(settings, line, 0.0)
            if isinstance(roll, PingRoll):
                raise ValueError(
                    "a survey log's pings come at odd times; its trace bends with the range alone, fold it as you like"
                )
            nowhere = np.zeros(len(line))
            return *straighten(Marks(line, fold_s, sigma, nowhere, nowhere, settings.interval_s)), ""
        return self._train(roll, settings, threshold)

    @staticmethod
    def _train(roll: Roll, settings: ChartSettings, threshold: float) -> tuple[float, float, str]:
        """Of the longest train about the fold interval that is no echo. Raises ValueError where there is none."""
        times = roll.arrivals.arrival_s[ping_rows(roll.arrivals, threshold)]
        shortest, longest = (
            settings.interval_s * (1 + off) for off in (-STRAIGHTEN_WITHIN, STRAIGHTEN_WITHIN)
        )
        jitter_s = min(1e-3, settings.interval_s / 20)
        trains = separate(times, (shortest, longest), jitter_s)
        if not trains:
            raise ValueError(
                f"no train of arrivals within {100 * STRAIGHTEN_WITHIN:g} % of {settings.interval_s:g} s was found; "
                "lower the threshold, or mark the trace"
            )
        echoes = late_echoes(trains, times, jitter_s)
        first = next(k for k, echo in enumerate(echoes) if echo is None)
        lags = [f"{1e3 * echo.lag_s:.0f}" for echo in echoes if echo is not None and echo.of == first]
        words = f"the trace {' and '.join(lags)} ms behind is its echo, no second pinger" if lags else ""
        return trains[first].interval_s, trains[first].sigma_interval_s, words

    def fit(
        self,
        roll: Roll,
        settings: ChartSettings,
        sound_speed_mps: float,
        sigma_sound_speed_mps: float,
        sigma_interval_s: float,
    ) -> Pass:
        """The hyperbola through the marks. Raises ValueError where the ship's positions are not known."""
        line, time_s, sigma = self.times(roll, settings)
        lat, lon = roll.ship(time_s)
        known = np.isfinite(lat)
        if len(line) and not known.any():
            raise ValueError("where the ship was is not known, so the marks have no hyperbola on the map")
        if isinstance(roll, PingRoll):  # each ping's time is from its own emission: no interval is in it
            folded, interval_s, sigma_interval_s = roll.pings.travel_time_s[line] + (
                time_s - roll.pings.arrival_s[line]
            ), 1e6, 0.0  # fmt: skip
        else:
            folded, interval_s = time_s - roll.time_of(settings, line, 0.0), settings.interval_s
        marks = Marks(line[known], folded[known], sigma[known], lat[known], lon[known], interval_s)
        self.found = fit_pass(
            marks,
            sound_speed_mps,
            sigma_sound_speed_mps=sigma_sound_speed_mps,
            sigma_interval_s=sigma_interval_s,
        )
        self._fitted = (line[known], time_s[known])
        return self.found

    def curve(self, roll: Roll, settings: ChartSettings) -> tuple[np.ndarray, np.ndarray]:
        """Fold times and lines of the hyperbola found, broken where it leaves the paper; empty without one."""
        if self.found is None or self.found.line is None:
            return np.empty(0), np.empty(0)
        line, time_s = self._fitted
        fitted_s = time_s - self.found.residual_s
        fold_s = fitted_s - roll.time_of(settings, line, 0.0) if not isinstance(roll, PingRoll) else None
        if fold_s is None:
            fold_s = roll.where(settings, fitted_s)[1]
        fold_s = np.mod(fold_s, settings.interval_s)
        jumps = np.flatnonzero(np.abs(np.diff(fold_s)) > settings.interval_s / 2) + 1
        return np.insert(fold_s, jumps, np.nan), np.insert(line.astype(float), jumps, np.nan)

    @property
    def fitted_lines(self) -> np.ndarray:
        """Lines of the marks that the hyperbola went through."""
        return self._fitted[0]

    def forget(self) -> None:
        """Forgets the hyperbola: the marks have changed."""
        self.found = None
