"""Simulated sound: levels, paths, Doppler, noise, and independence of the blocks it is read in."""

import numpy as np
import pytest
from sounds import heard

from trackerlib.acoustics.absorption import absorption_db_per_km
from trackerlib.acoustics.ambient_noise import (
    HYDROPHONE_DB,
    LIMIT,
    ambient_noise_db,
    equivalent_noise_v,
    flow_noise_db,
    table_5_1,
)
from trackerlib.receiver.report_receiver import FULL_SCALE_V, ReceiverSettings, ReportReceiver
from trackerlib.simulation.sound import (
    PATHS,
    Listener,
    Pinger,
    Sea,
    SimulatedSound,
    joined_pulses,
    noise_density_v,
    pulses_heard,
)

RNG = np.random.default_rng
NO_PULSES = pulses_heard(Pinger(), Listener(), Sea(), 0.0, RNG(1))


def test_equivalent_noise_gives_every_row_of_table_5_1():
    assert len(table_5_1()) == 6
    for state, level_db, density_nv, total_uv in table_5_1():
        assert ambient_noise_db(state if state == LIMIT else float(state)) == level_db
        assert 1e9 * equivalent_noise_v(level_db) == pytest.approx(density_nv, abs=0.51)
        assert 1e6 * equivalent_noise_v(level_db, 100.0) == pytest.approx(total_uv, abs=0.0051)


def test_between_rows_the_noise_is_interpolated_and_outside_refused():
    assert ambient_noise_db(4) == 64
    assert ambient_noise_db(6.5) == 70.5
    for state in (0, 8.1, float("nan"), "calm"):
        with pytest.raises(ValueError, match=r"sea_state is .*Table 5-1"):
            ambient_noise_db(state)


def test_flow_noise_grows_with_the_sixth_power():
    assert flow_noise_db(5.0) == 60
    assert flow_noise_db(2.5) == pytest.approx(60 - 18.06, abs=0.01)
    assert flow_noise_db(0.0) == -np.inf
    assert noise_density_v(Sea(sea_state=3)) == pytest.approx(89e-9, rel=5e-3)
    assert noise_density_v(Sea(sea_state=3), 5.0) == pytest.approx(np.sqrt(2) * 89e-9, rel=5e-3)


def francois_garrison(f, t, s, z, ph):
    """dB/km at f kHz, J. Acoust. Soc. Am. 72 (1982), 1879; water of at most 20 degrees."""
    c = 1412 + 3.21 * t + 1.19 * s + 0.0167 * z
    f1 = 2.8 * np.sqrt(s / 35) * 10 ** (4 - 1245 / (t + 273))
    f2 = 8.17 * 10 ** (8 - 1990 / (t + 273)) / (1 + 0.0018 * (s - 35))
    boric = 8.86 / c * 10 ** (0.78 * ph - 5) * f1 * f**2 / (f1**2 + f**2)
    depth = 1 - 1.37e-4 * z + 6.2e-9 * z**2
    magnesium = 21.44 * s / c * (1 + 0.025 * t) * depth * f2 * f**2 / (f2**2 + f**2)
    water = 4.937e-4 - 2.59e-5 * t + 9.11e-7 * t**2 - 1.5e-8 * t**3
    return boric + magnesium + water * (1 - 3.83e-5 * z + 4.9e-10 * z**2) * f**2


@pytest.mark.parametrize("frequency_khz", [0.5, 3, 10, 30, 100])
@pytest.mark.parametrize(("temperature", "depth"), [(10, 0), (4, 2000), (18, 500)])
def test_absorption_is_within_a_tenth_of_francois_and_garrison(frequency_khz, temperature, depth):
    found = absorption_db_per_km(1e3 * frequency_khz, temperature, depth_m=depth)
    assert found == pytest.approx(francois_garrison(frequency_khz, temperature, 35, depth, 8), rel=0.12)


def test_thirty_watts_at_a_hundred_metres_are_1_7_millivolts():
    # The report says 10 mV; by its own hydrophone it is 15.5 dB less.
    pulses = pulses_heard(Pinger((0, 0, -110.0)), Listener(), Sea(), 3.0, RNG(1), ("direct",))
    volts = pulses.amplitude / np.sqrt(2) * 10 ** (HYDROPHONE_DB / 20)
    assert volts == pytest.approx(1.69e-3, rel=0.02)


def test_every_path_ends_where_the_ship_is_when_it_arrives():
    pinger = Pinger((300.0, -200.0, -900.0), first_emission_s=0.7, interval_s=1.3)
    listener = Listener((0, 0, -10.0), (3.0, 1.0, 0.0))
    sea = Sea(depth_m=1200.0)
    pulses = pulses_heard(pinger, listener, sea, 30.0, RNG(1))
    images = {"direct": -900.0, "surface": 900.0, "bottom": -1500.0}
    for number, name in enumerate(PATHS):
        mine = pulses.path == number
        ship = np.array([0, 0, -10.0]) + np.outer(pulses.arrival_s[mine], [3.0, 1.0, 0.0])
        distance = np.linalg.norm(ship - [300.0, -200.0, images[name]], axis=1)
        emitted = 0.7 + 1.3 * pulses.emission[mine]
        assert distance == pytest.approx(1500 * (pulses.arrival_s[mine] - emitted), rel=1e-9)
    assert np.all(np.isin(range(3), pulses.path))


def test_a_ship_that_goes_away_lowers_the_carrier_and_stretches_the_pulse():
    pulses = pulses_heard(
        Pinger((0, 0, -10.0)), Listener((2000, 0, -10.0), (5, 0, 0)), Sea(), 10.0, RNG(1), ("direct",)
    )
    assert pulses.carrier_hz == pytest.approx(10_000 * (1 - 5 / 1500), rel=1e-9)
    assert pulses.duration_s * pulses.carrier_hz == pytest.approx(100.0)


def test_the_sound_does_not_depend_on_how_much_is_read_at_a_time():
    pulses = pulses_heard(Pinger(first_emission_s=0.1, interval_s=0.3), Listener(), Sea(), 3.0, RNG(1))
    whole = SimulatedSound(pulses, 89e-9, 48_000, FULL_SCALE_V, 7).read(144_000)
    parts = SimulatedSound(pulses, 89e-9, 48_000, FULL_SCALE_V, 7)
    cuts = np.diff(np.sort([0, 144_000, *RNG(2).integers(0, 144_000, 500)]))
    assert np.array_equal(whole, np.concatenate([parts.read(count) for count in cuts]))


def test_noise_in_a_band_is_that_of_the_table():
    sound = SimulatedSound(NO_PULSES, 89e-9, 48_000, FULL_SCALE_V, 1).read(48_000 * 20)
    spectrum = np.fft.rfft(sound * FULL_SCALE_V) / len(sound)
    f = np.fft.rfftfreq(len(sound), 1 / 48_000)
    band = np.abs(f - 10_000) < 50
    assert np.sqrt(2 * np.sum(np.abs(spectrum[band]) ** 2)) == pytest.approx(0.89e-6, rel=0.05)


def test_missing_pulses_are_not_sent_and_drift_adds_up():
    pinger = Pinger((0, 0, -10.0), missing=0.3, drift_ppm=20.0)
    pulses = pulses_heard(pinger, Listener((150, 0, -10.0)), Sea(), 2000.0, RNG(1), ("direct",))
    assert 0.65 < len(pulses) / 1000 < 0.75
    late = pulses.arrival_s - 0.1 - 2.0 * pulses.emission
    assert late == pytest.approx(20e-6 * 2.0 * pulses.emission, abs=1e-9)


def test_a_second_pinger_on_another_carrier_is_not_heard():
    sea = Sea(sea_state=3)
    mine = pulses_heard(Pinger((0, 0, -800.0)), Listener(), sea, 30.0, RNG(1), ("direct",))
    other = Pinger((200, 0, -800.0), carrier_hz=12_000, interval_s=2.5, first_emission_s=0.9)
    both = joined_pulses(mine, pulses_heard(other, Listener(), sea, 30.0, RNG(2), ("direct",)))
    sound = SimulatedSound(both, noise_density_v(sea), 48_000, FULL_SCALE_V, 3).read(48_000 * 30)
    _, arrivals = heard(ReportReceiver(ReceiverSettings(maxima=1), 48_000), sound)
    assert np.abs(arrivals.arrival_s[: len(mine)] - mine.arrival_s).max() < 2e-4
