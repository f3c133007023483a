"""Numbers as a person reads them."""

from __future__ import annotations

import pytest

from trackerlib.rounding import rounded, value_with_sigma


@pytest.mark.parametrize(
    ("value", "words"),
    [(0, "0"), (0.0457, "0.046"), (0.996, "1.0"), (5, "5.0"), (24.6, "25"), (99.6, "100"), (1133.0, "1100")],
)
def test_a_size_has_two_digits_and_no_power_of_ten(value, words):
    assert rounded(value) == words


@pytest.mark.parametrize(
    ("value", "sigma", "words"),
    [
        (4481.27, 6.83, "4481.3 ± 6.8 m"),
        (4481.27, 0.0996, "4481.27 ± 0.10 m"),
        (4481.27, 683.0, "4480 ± 680 m"),
        (4481.27, None, "4481.27 m"),
        (float("nan"), 1.0, "unknown"),
    ],
)
def test_a_value_and_its_standard_error_are_rounded_together(value, sigma, words):
    assert value_with_sigma(value, sigma, "m") == words
