"""Absorption of sound in sea water."""

from __future__ import annotations

import numpy as np


def absorption_db_per_km(
    frequency_hz, temperature_c: float = 10.0, salinity: float = 35.0, depth_m: float = 0.0, ph: float = 8.0
):
    """Absorption [dB/km] at a frequency or an array of them.

    Ainslie and McColm, J. Acoust. Soc. Am. 103 (1998), 1671: boric acid, magnesium sulphate, water. Within 10 % of
    Francois and Garrison (1982) from 100 Hz to 1 MHz, -6 to 35 degrees, salinity 5 to 50, 0 to 7 km, pH 7.7 to 8.3.
    """
    f, z = np.asarray(frequency_hz) / 1e3, depth_m / 1e3
    boric = 0.78 * np.sqrt(salinity / 35) * np.exp(temperature_c / 26)
    magnesium = 42 * np.exp(temperature_c / 17)
    return (
        0.106 * boric * f**2 / (boric**2 + f**2) * np.exp((ph - 8) / 0.56)
        + 0.52
        * (1 + temperature_c / 43)
        * (salinity / 35)
        * magnesium
        * f**2
        / (magnesium**2 + f**2)
        * np.exp(-z / 6)
        + 0.00049 * f**2 * np.exp(-(temperature_c / 27 + z / 17))
    )
