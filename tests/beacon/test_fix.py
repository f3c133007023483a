"""The fix of a still beacon on made-up surveys: by hand, always true, and with known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from surveys import BOX, ELBOW, FRAME, LINE, error_of, survey

from trackerlib.beacon.fix import FixSettings, fix_beacon, fix_history
from trackerlib.beacon.pings import Pings
from trackerlib.simulation.beacon_survey import Errors

BEACON = (100.0, 50.0, -2400.0)
KNOWN_SPEED = FixSettings(sound_speed_sigma_mps=0.0)
USUAL = Errors(gps_rms_m=3.0, time_rms_s=5e-4, time_step_s=5e-4)


def test_without_errors_the_fix_is_exact():
    # Nothing is random: the truth comes back to the accuracy of the arithmetic.
    fix = fix_beacon(survey(BOX, BEACON), KNOWN_SPEED)
    assert fix.converged
    assert np.abs(error_of(fix, BEACON)).max() < 1e-3
    assert fix.emission_offset_s == pytest.approx(0.8, abs=1e-6)
    assert fix.depth_m == pytest.approx(2400.0, abs=1e-2)


def test_the_covariance_of_four_pings_a_side_by_hand():
    """A beacon below the middle of a square, times known to be true travel times.

    Pings at (+-L, 0) and (0, +-L), depth D, sigma s metres of range each. East is seen by two
    pings with cosine L/R: sigma_east = s R / (L sqrt 2); depth by four with sine D/R:
    sigma_depth = s R / (2 D). With every place pinged n times both shrink by sqrt n.
    """
    length, depth, repeats, speed = 300.0, 400.0, 60, 1500.0
    slant = 500.0
    east = np.tile([length, -length, 0, 0], repeats)
    north = np.tile([0, 0, length, -length], repeats)
    lat, lon, _ = FRAME.to_geodetic(np.column_stack([east, north, np.zeros(len(east))]))
    noise = np.random.default_rng(3).normal(0, 1e-3, len(east))
    pings = Pings(
        number=np.arange(len(east)),
        lat_deg=lat,
        lon_deg=lon,
        up_m=np.zeros(len(east)),
        travel_time_s=slant / speed + noise,
        utc=np.full(len(east), np.datetime64("NaT", "ms")),
    )
    settings = FixSettings(emission_known=True, sound_speed_sigma_mps=0.0, gps_rms_m=0.0, reject="none")
    fix = fix_beacon(pings, settings)
    sigma_range = fix.uncertainty.rms_s * speed
    expected = (
        sigma_range * slant / np.sqrt(repeats) * np.array([1 / (length * 2**0.5)] * 2 + [1 / (2 * depth)])
    )
    # Student's t for 237 degrees of freedom and n against n - 3 widen by 1.2 %.
    assert fix.sigma == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("seed", range(6))
def test_turning_the_survey_turns_the_fix(seed):
    turn = 37.0 + 50 * seed
    angle = np.radians(turn)
    # Courses grow clockwise: (e, n) -> (e cos + n sin, n cos - e sin)
    matrix = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned_beacon = (*(matrix @ BEACON[:2]), BEACON[2])
    start = matrix @ np.array([-900.0, -700.0])
    legs = [(course + turn, length) for course, length in BOX]
    errors = Errors(time_rms_s=1e-3)
    plain = fix_beacon(survey(BOX, BEACON, errors, seed=seed), KNOWN_SPEED)
    turned = fix_beacon(survey(legs, turned_beacon, errors, seed=seed, start=start), KNOWN_SPEED)
    expected = np.append(matrix @ error_of(plain, BEACON)[:2], error_of(plain, BEACON)[2])
    # The ellipsoid is not quite the same in every direction.
    assert error_of(turned, turned_beacon) == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_the_order_of_the_pings_does_not_matter(seed):
    pings = survey(BOX, BEACON, USUAL, seed=seed)
    order = np.random.default_rng(seed).permutation(len(pings))
    order = np.concatenate([[0], order[order != 0]])  # the first ping gives the origin
    shuffled = fix_beacon(pings.only(order), FixSettings(gps_rms_m=3.0))
    assert np.abs(shuffled.position - fix_beacon(pings, FixSettings(gps_rms_m=3.0)).position).max() < 1e-3


def test_false_returns_are_found_and_the_rest_kept():
    errors = replace(USUAL, false_returns=8)
    fix = fix_beacon(survey(BOX, BEACON, errors, seed=5), FixSettings(gps_rms_m=3.0))
    clean = fix_beacon(survey(BOX, BEACON, USUAL, seed=5), FixSettings(gps_rms_m=3.0))
    assert len(fix.rejected) == 8
    assert np.abs(error_of(fix, BEACON) / fix.sigma).max() < 3.5
    assert np.linalg.norm(fix.position - clean.position) < 20


def test_every_ping_is_kept_when_told():
    errors = replace(USUAL, false_returns=8)
    fix = fix_beacon(survey(BOX, BEACON, errors, seed=5), FixSettings(gps_rms_m=3.0, reject="none"))
    assert len(fix.rejected) == 0


@pytest.mark.parametrize("false_returns", [0, 5])
def test_stated_intervals_hold_what_they_promise(false_returns):
    trials, inside, ellipsoid, converged = 240, np.zeros(3), 0, 0
    errors = replace(USUAL, false_returns=false_returns)
    for seed in range(trials):
        speed = 1500 + np.random.default_rng([1, seed]).normal(0, 2.0)
        pings = survey(ELBOW, BEACON, errors, seed=[2, seed], speed_mps=speed)
        fix = fix_beacon(pings, FixSettings(gps_rms_m=3.0))
        converged += fix.converged
        error = error_of(fix, BEACON)
        inside += np.abs(error) < 1.96 * fix.sigma
        ellipsoid += error @ np.linalg.solve(fix.uncertainty.covariance, error) < stats.chi2.ppf(0.95, 3)
    low, high = stats.binom.ppf([0.0005, 0.9995], trials, 0.95)
    assert converged == trials
    assert np.all((low <= inside) & (inside <= high)), inside / trials
    assert low <= ellipsoid <= high, ellipsoid / trials


def test_a_wrong_sound_speed_is_covered_by_its_own_sigma():
    pings = survey(ELBOW, BEACON, Errors(time_rms_s=1e-4), speed_mps=1504.0)
    error = error_of(fix := fix_beacon(pings, FixSettings(gps_rms_m=0.0)), BEACON)
    assert abs(error[2]) > 3  # metres wrong
    assert np.all(np.abs(error) < 3 * fix.sigma)
    sure = fix_beacon(pings, replace(FixSettings(gps_rms_m=0.0), sound_speed_sigma_mps=0.0))
    assert np.any(np.abs(error_of(sure, BEACON)) > 3 * sure.sigma)
    # The part that sound speed moves is predicted: 4 m/s times the stated sensitivity.
    assert error[2] == pytest.approx(-4.0 * fix.uncertainty.by_sound_speed[2], rel=0.15)


def test_slow_errors_of_the_ship_position_are_allowed_for_when_nothing_is_said():
    told = fix_beacon(survey(ELBOW, BEACON, USUAL), FixSettings(gps_rms_m=3.0))
    untold = fix_beacon(survey(ELBOW, BEACON, USUAL), FixSettings())
    assert np.all(untold.sigma[:2] > 1.2 * told.sigma[:2])


@pytest.mark.parametrize("side", [-1, 1])
def test_one_straight_leg_gives_both_sides(side):
    along = np.array([np.sin(np.radians(75)), np.cos(np.radians(75))])
    across = np.array([along[1], -along[0]])
    foot = np.array([-900.0, -700.0]) + 2500 * along
    beacon = (*(foot + side * 900 * across), -1200.0)
    fix = fix_beacon(survey(LINE, beacon, USUAL, seed=2), FixSettings(gps_rms_m=3.0))
    assert not fix.converged
    assert "across-track and depth cannot be told apart" in fix.reason
    assert len(fix.alternatives) == 2
    assert fix.along_track_m == pytest.approx(2500, abs=20)
    assert fix.closest_slant_range_m == pytest.approx(1500, abs=40)


def test_what_a_straight_leg_tells_is_as_sure_as_stated():
    along = np.array([np.sin(np.radians(75)), np.cos(np.radians(75)), 0.0])
    beacon = np.array([-900.0, -700.0, 0.0]) + 2500 * along + [900 * along[1], -900 * along[0], -1200.0]
    rng, errors = np.random.default_rng(7), []
    for seed in range(40):
        pings = survey(LINE, beacon, USUAL, seed=seed, speed_mps=1500 + 2 * rng.standard_normal())
        fix = fix_beacon(pings, FixSettings(gps_rms_m=3.0))
        place = fix.frame.to_local(*FRAME.to_geodetic(beacon)) - fix.ship[0]  # as that ping's place is logged
        errors.append(
            [
                (fix.along_track_m - place @ along) / fix.sigma_along_track_m,
                (fix.closest_slant_range_m - 1500) / fix.sigma_closest_slant_range_m,
            ]
        )
    # such means of 40 squares scatter by 0.22
    assert np.mean(np.square(errors), axis=0) == pytest.approx([1.0, 1.0], abs=0.55)


def test_a_short_straight_leg_does_not_even_tell_the_distance():
    fix = fix_beacon(survey(((75, 200),), BEACON, USUAL, interval_s=4.0), FixSettings(gps_rms_m=3.0))
    assert not fix.converged
    assert "too short yet to tell even the distance" in fix.reason
    assert fix.alternatives == ()
    assert fix.closest_slant_range_m is None


def test_a_mirror_solution_that_fits_as_well_is_shown():
    # A line with one slight bend: both sides are definite places now, and fit within the noise.
    legs = ((75, 3000), (84, 3000))
    pings = survey(legs, (1900.0, 700.0, -900.0), Errors(gps_rms_m=2.0, time_rms_s=2e-3), seed=4)
    fix = fix_beacon(pings, FixSettings(gps_rms_m=2.0))
    if fix.converged:
        assert np.all(np.abs(error_of(fix, (1900.0, 700.0, -900.0))) < 4 * fix.sigma)
    else:
        assert fix.alternatives or fix.unobservable


@pytest.mark.parametrize("count", [1, 3, 6])
def test_too_few_pings_are_refused(count):
    pings = survey(BOX, BEACON, USUAL).only(slice(0, count))
    fix = fix_beacon(pings)
    assert not fix.converged
    assert f"{count} usable pings" in fix.reason
    assert fix.position is None


def test_no_pings_at_all_are_refused():
    assert "0 usable pings" in fix_beacon(survey(BOX, BEACON).only(slice(0, 0))).reason


def test_all_pings_at_one_place_are_refused():
    pings = survey(BOX, BEACON, USUAL)
    here = replace(pings, lat_deg=np.full(len(pings), 41.0), lon_deg=np.full(len(pings), -66.0))
    fix = fix_beacon(replace(here, travel_time_s=2.4 + np.random.default_rng(0).normal(0, 1e-3, len(pings))))
    assert not fix.converged


def test_repeated_time_and_place_is_ordinary():
    pings = survey(BOX, BEACON, USUAL)
    twice = pings.only(np.repeat(np.arange(len(pings)), 2))
    twice = replace(twice, number=np.arange(len(twice)))
    assert np.linalg.norm(error_of(fix_beacon(twice, FixSettings(gps_rms_m=3.0)), BEACON)) < 30


def test_an_answer_on_the_edge_of_the_region_is_refused():
    fix = fix_beacon(survey(BOX, BEACON, USUAL), FixSettings(max_depth_m=1500.0))
    assert not fix.converged
    assert "greatest depth (1500 m)" in fix.reason
    fix = fix_beacon(survey(BOX, (4000.0, 50.0, -500.0), USUAL), FixSettings(max_range_m=2000.0))
    assert not fix.converged
    assert "greatest range (2000 m" in fix.reason


def test_pings_left_out_by_hand_stay_out():
    pings = survey(BOX, BEACON, USUAL)
    fix = fix_beacon(pings, FixSettings(left_out=frozenset({3, 17})))
    assert not fix.used[[2, 16]].any()
    assert {3, 17} <= set(fix.rejected.tolist())


def test_a_further_start_does_no_harm():
    place = FRAME.to_geodetic(np.array([5000.0, 5000.0, -100.0]))
    start = (float(place[0]), float(place[1]), 100.0)
    pings = survey(BOX, BEACON, USUAL)
    plain = fix_beacon(pings, FixSettings(gps_rms_m=3.0))
    assert (
        np.linalg.norm(fix_beacon(pings, FixSettings(gps_rms_m=3.0, start=start)).position - plain.position)
        < 1e-3
    )


def test_the_history_ends_with_the_fix_of_all_pings():
    pings = survey(ELBOW, BEACON, USUAL)
    *_, (count, last) = fix_history(pings, first=len(pings) - 1)
    assert count == len(pings)
    assert np.array_equal(last.position, fix_beacon(pings).position)


@pytest.mark.parametrize(
    "setting", [{"sound_speed_mps": 0.0}, {"sound_speed_mps": 340.0}, {"max_depth_m": -1.0}]
)
def test_settings_that_make_no_sense_are_named(setting):
    with pytest.raises(ValueError, match=next(iter(setting))):
        FixSettings(**setting)


def test_the_fix_prints_what_a_report_would_say():
    text = str(fix_beacon(survey(BOX, BEACON, USUAL), FixSettings(gps_rms_m=3.0)))
    assert text.startswith("SIMULATED: 4")
    assert "95 % ellipse" in text
    assert "depth 2" in text
    assert str(fix_beacon(survey(BOX, BEACON).only(slice(0, 2)))).startswith(
        "SIMULATED: no fix: 2 usable pings"
    )


@pytest.mark.parametrize("how", [{}, {"interval_s": 2.0}, {"motion": "free"}, {"estimate_sound_speed": True}])
def test_pings_left_out_by_hand_keep_a_residual(how):
    """They stay in the pictures, where they can be chosen and put back."""
    pings = survey(BOX, BEACON, Errors(1.0, 1e-4))
    late = pings.travel_time_s.copy()
    late[7] += 0.05
    settings = replace(FixSettings(gps_rms_m=1.0), left_out=frozenset(pings.number[[5, 7]].tolist()), **how)
    fix = fix_beacon(replace(pings, travel_time_s=late), settings)
    assert fix.converged, fix.reason
    assert not fix.used[[5, 7]].any()
    assert fix.residual_s[[5, 7]] == pytest.approx([0.0, 0.05], abs=5e-3)
    every = fix_beacon(pings, replace(settings, left_out=frozenset()))
    assert fix.residual_s[5] == pytest.approx(every.residual_s[5], abs=3e-4)
