"""Design of the front end: the values that the report prints, and where it slips."""

import numpy as np
import pytest

from trackerlib.receiver import front_end_design as design
from trackerlib.receiver.front_end_design import FrontEnd, ThirdStage, attenuation_db, decibels, shunt_for


def test_source_impedance_is_that_of_its_circuit_and_1693_ohm():
    # (Rc + 1/jwCh) in parallel with 1/jwCc
    for f in (100.0, 10e3, 1e6):
        w = 2j * np.pi * f
        assert design.source_impedance(f) == pytest.approx(
            design.parallel(3.331 + 1 / (w * 2.4e-9), 1 / (w * 7e-9))
        )
    impedance = design.source_impedance(10e3)
    assert abs(impedance) == pytest.approx(1693.1, abs=0.05)
    assert np.degrees(np.angle(impedance)) == pytest.approx(-90, abs=0.05)
    assert abs(design.source_impedance(10e3, hydrophone_f=1.8e-9)) == pytest.approx(1808.6, abs=0.1)
    assert 20 * abs(impedance) == pytest.approx(33.8e3, rel=3e-3)
    assert design.cable_loss_db() == pytest.approx(-11.9, abs=0.05)  # not in the text


def test_first_stage():
    assert design.highpass_hz(120e3, 180e-12) == pytest.approx(7368, abs=1)
    assert design.thermal_noise_v(120e3, kelvin=293) == pytest.approx(44.1e-9, abs=0.05e-9)
    assert design.thermal_noise_v(120e3) == pytest.approx(44.6e-9, abs=0.05e-9)  # printed 45
    # 89 nV do not give the printed 560 kohm.
    assert design.resistance_of_noise(89e-9) == pytest.approx(478e3, abs=1e3)
    assert design.thermal_noise_v(560e3) == pytest.approx(96e-9, abs=0.5e-9)
    assert decibels(design.first_stage_gain(68.3e3)) == pytest.approx(24.0, abs=0.01)
    assert decibels(design.first_stage_gain(1e12)) == pytest.approx(25.5, abs=0.05)


def test_loading_and_noise_of_the_source():
    source = complex(design.source_impedance(10e3))
    assert design.loading_loss_db(abs(source), 20 * abs(source)) == pytest.approx(0.42, abs=0.005)
    assert design.loading_loss_db(source, 20 * abs(source)) == pytest.approx(0.011, abs=5e-4)
    assert design.source_noise_v(source, 120e3) == pytest.approx(0.6e-9, abs=0.05e-9)
    assert design.thermal_noise_v(1700, kelvin=293) == pytest.approx(5.2e-9, abs=0.05e-9)


def test_required_gains_and_what_they_rest_on():
    assert design.required_gain_db() == pytest.approx(87, abs=0.1)  # printed
    assert design.required_gain_db(bandwidth_hz=100) == pytest.approx(67, abs=0.1)
    assert design.least_gain_db() == pytest.approx(58, abs=0.1)  # printed
    volt = design.signal_v(30, 100)
    assert volt == pytest.approx(1.69e-3, abs=0.005e-3)  # printed: about 10 mV
    assert decibels(10e-3 / volt) == pytest.approx(15.5, abs=0.1)
    assert design.signal_v(30, 17) == pytest.approx(10e-3, rel=0.01)
    assert design.least_gain_db(volt) == pytest.approx(73.5, abs=0.1)


@pytest.mark.parametrize(("step", "taken"), [(3, 3), (9, 9), (12, 10.2), (18, 18), (24, 24), (30, 28.0)])
def test_steps_are_what_the_switched_shunts_take_off(step, taken):
    assert attenuation_db(10e3, design.switched_shunts(10e3, step)) == pytest.approx(taken, abs=0.05)


def test_a_tuned_load_is_resistor_coil_and_capacitor_in_parallel():
    ohm, farad, henry = 68e3, 10e-9, 25.33e-3
    resonance = design.resonance_hz(henry, farad)
    assert resonance == pytest.approx(10e3, abs=1)
    for f in (3e3, 9.9e3, 25e3):
        w = 2j * np.pi * f
        assert design.tuned_load(f, ohm, henry, farad) == pytest.approx(
            design.parallel(ohm, w * henry, 1 / (w * farad))
        )
    assert design.tuned_load(resonance, ohm, henry, farad) == pytest.approx(ohm)
    half = design.stage_bandwidth_hz(ohm, farad) / 2
    edges = np.abs(design.tuned_load(resonance + np.array([-half, half]), ohm, henry, farad))
    assert decibels(edges / ohm) == pytest.approx([-3.01, -3.01], abs=0.05)


@pytest.mark.parametrize("seed", range(10))
def test_third_stage_obeys_its_node_equations(seed):
    rng = np.random.default_rng(seed)
    series, shunt, one, two, feedback, entry = 10 ** rng.uniform(3, 6, 6)
    farad, f = 10 ** rng.uniform(-10, -6), 10 ** rng.uniform(2, 5)
    # Unknowns: attenuator's node and the amplifier's input, in volts a volt.
    y, bias = 2j * np.pi * f * farad, one * two / (one + two)
    nodes = np.array([[1 / series + 1 / shunt + y, -y], [-y, y + 1 / bias]])
    voltage = np.linalg.solve(nodes, np.array([1 / series, 0]))
    stage = ThirdStage(series, (one, two), farad, feedback, entry)
    assert stage.gain(f, shunt) == pytest.approx(-feedback / entry * voltage[1], rel=1e-10)
    nodes[0, 0] -= 1 / shunt
    open_voltage = np.linalg.solve(nodes, np.array([1 / series, 0]))[1]
    assert stage.gain(f) == pytest.approx(-feedback / entry * open_voltage, rel=1e-10)
    assert stage.gain(1e12) == pytest.approx(stage.open_gain(), rel=1e-3)


def test_shunts_add_as_conductances():
    shunts = [shunt_for(1.0, db) for db in (3, 9, 18, 24)]
    assert shunts == pytest.approx([2.424, 0.55, 0.144, 0.0673], rel=1e-3)
    for shunt, db in zip(shunts, (3, 9, 18, 24), strict=True):
        assert attenuation_db(1.0, [shunt]) == pytest.approx(db)
    assert attenuation_db(1.0, shunts[:2]) == pytest.approx(10.2, abs=0.05)  # Table 5-2: 12
    assert attenuation_db(1.0, shunts) == pytest.approx(28.0, abs=0.05)  # Table 5-2: 30
    stage = ThirdStage(bias_ohm=(1e12, 1e12))
    loss = decibels(stage.gain(10e3) / stage.gain(10e3, 0.55 * stage.series_ohm))
    assert loss == pytest.approx(attenuation_db(1.0, [0.55]), abs=0.01)


def test_compressor_and_dynamic_range():
    assert design.dynamic_range_db() == pytest.approx(72.04, abs=0.005)
    assert design.compressor_v(8.0) == 0
    assert design.compressor_v(2e-3) == pytest.approx(5.0, abs=0.01)


def test_noise_measurements():
    # (5-30) prints 31 nV: 86 dB and no correction of the meter.
    assert design.noise_by_meter(6.8e-3, 19_275, 120) == pytest.approx(36.4e-9, abs=0.1e-9)
    printed = design.noise_by_meter(6.8e-3, 10 ** (86 / 20), 120) / design.AVERAGE_METER
    assert printed == pytest.approx(31.1e-9, abs=0.05e-9)
    assert design.noise_by_oscilloscope(35e-3, 19_275, 120) == pytest.approx(27.6e-9, abs=0.05e-9)
    assert pytest.approx(1.128, abs=1e-3) == design.AVERAGE_METER
    # The meter's correction, by experiment: mean of |x| over sigma, for a meter that is right on sines.
    noise = np.random.default_rng(1).standard_normal(200_000)
    reading = np.mean(np.abs(noise)) * np.pi / (2 * np.sqrt(2))
    assert 1 / reading == pytest.approx(design.AVERAGE_METER, rel=5e-3)


def test_the_whole_preamplifier_has_the_stated_gains_and_the_measured_one():
    front = FrontEnd()
    first, second, third = (decibels(gain) for gain in front.stage_gains(10e3))
    assert (first, second, third) == pytest.approx((24, 31, 34), abs=0.15)
    assert first + second + third == pytest.approx(89, abs=0.3)
    assert front.gain_db(10e3) == pytest.approx(86, abs=0.5)  # measured
    f = np.linspace(9900, 10100, 2001)
    gain = front.gain_db(f)
    band = f[gain > gain.max() - 3.01]
    assert np.ptp(band) == pytest.approx(120, abs=1)
    assert np.median(band) == pytest.approx(10e3, abs=2)
