"""Late echoes make trains of their own, which are told from second pingers."""

import numpy as np
import pytest

from trackerlib.receiver.intervals import separate
from trackerlib.receiver.late_echoes import late_echoes


def sound(seed, other, seconds=300.0):
    """A pinger at 2 s heard by a moving ship, one ping in ten missing, and what else arrives."""
    rng = np.random.default_rng(seed)
    sent_s = 0.3 + 2.0 * np.arange(int(seconds / 2))
    first = sent_s + np.hypot(5 * (sent_s - 100), 700) / 1500
    every = np.concatenate([first[rng.random(len(first)) > 0.1], other(first)])
    every += rng.normal(0, 3e-4, len(every))
    trains = separate(every)
    return trains, late_echoes(trains, every)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_echo_is_told_with_its_lag(seed):
    trains, echoes = sound(seed, lambda first: np.delete(first, [5, 40, 41]) + 0.130)
    assert len(trains) == 2
    (echo,) = [each for each in echoes if each is not None]
    assert echo.lag_s == pytest.approx(0.130, abs=4 * echo.sigma_lag_s + 1e-6)
    assert echo.sigma_lag_s < 1e-4


def test_of_three_paths_two_are_echoes_of_the_first():
    trains, echoes = sound(4, lambda first: np.concatenate([first + 0.13, first + 0.32]))
    assert len(trains) == 3
    lags = sorted(round(each.lag_s, 2) for each in echoes if each is not None)
    assert lags == [0.13, 0.32]
    assert len({each.of for each in echoes if each is not None}) == 1


@pytest.mark.parametrize(
    "other",
    [
        lambda first: (
            first[:1] + 0.13 + 2.0 * (1 + 20e-6) * np.arange(len(first))
        ),  # does not share the ship's motion
        lambda first: (
            first + 0.13 + 20e-6 * (first - first[0])
        ),  # beside the first one, by a clock of its own
        lambda first: first[0] + 0.7 + 2.5 * np.arange(int(len(first) * 0.8)),
    ],
)
def test_a_second_pinger_is_no_echo(other):
    trains, echoes = sound(5, other)
    assert len(trains) == 2
    assert echoes == (None, None)
