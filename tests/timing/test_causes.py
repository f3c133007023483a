"""Which cause parts two tracks: planted ones are found, and the demo's wrongly surveyed array is named."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.acoustics.rays import fit_rays
from trackerlib.crossover.gating import gate_reports
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.tfile import read_tfile
from trackerlib.rangefiles.velocity_file import read_velocity
from trackerlib.simulation.crossover_runs import ClockTruth, simulate_crossover
from trackerlib.timing.causes import compare_causes, independent_shares

DEPTH = np.arange(0.0, 2000.0, 100.0)
PROFILE = SoundSpeedProfile(DEPTH, 4870.0 - 20 * np.exp(-DEPTH / 300) + 0.012 * DEPTH)
PLACES = {
    1: (0.0, 0.0, -1300.0),
    2: (6000.0, 300.0, -1250.0),
    3: (3000.0, 5200.0, -1350.0),
    4: (9000.0, 5000.0, -1300.0),
}
COUNT = np.arange(40)


def survey() -> ArraySurvey:
    return ArraySurvey(
        number=np.array(list(PLACES)),
        position=np.array(list(PLACES.values())),
        survey_date=np.full(len(PLACES), np.datetime64("1985-06-20")),
        placeholder=np.zeros(len(PLACES), bool),
    )


def run(
    rng, *, offset=0.0, drift=0.0, profile=PROFILE, displaced=None, depths=(400.0,)
) -> list[CrossoverSet]:
    """Six sets of four arrays from one vehicle that sails across the range. Simulated."""
    sets = []
    for number, (a, b) in enumerate([(1, 2), (1, 3), (2, 3), (2, 4), (3, 4), (1, 2)]):
        middle = (np.array(PLACES[a]) + np.array(PLACES[b])) / 2
        middle[2] = -depths[number % len(depths)]
        heading = rng.uniform(0, 2 * np.pi)
        step = 45 * np.array([np.cos(heading), np.sin(heading), 0.0])
        count = COUNT + 500 * number
        track = middle + rng.uniform(-600, 600, 3) * [1, 1, 0] + (COUNT - 20)[:, None] * step
        one = simulate_crossover(
            track,
            count,
            (np.array(PLACES[a]), np.array(PLACES[b])),
            profile,
            ClockTruth(offset, drift, 1250.0),
            rng,
        )
        x, y = (
            version + (displaced[1] if displaced and array == displaced[0] else 0.0)
            for array, version in ((a, one.x), (b, one.y))
        )
        sets.append(CrossoverSet((a, b), count, x, y, number + 1, source="simulated"))
    return sets


def estimate(fit, parameter: str) -> tuple[float, float]:
    k = fit.parameters.index(parameter)
    return fit.estimate[k], fit.sigma[k]


def test_an_offset_alone_is_called_an_offset():
    ranking = compare_causes(run(np.random.default_rng(1), offset=3e-3), survey(), PROFILE)
    assert ranking.best.name == "timing offset"
    value, sigma = estimate(ranking.best, "offset (s)")
    assert abs(value - 3e-3) < 4 * sigma
    assert ranking.best.held_out == pytest.approx(1.0, abs=0.25)


def test_where_nothing_is_wrong_no_cause_is_named():
    for seed in range(30, 36):
        ranking = compare_causes(run(np.random.default_rng(seed)), survey(), PROFILE)
        assert ranking.best.name == "no cause beyond noise"
        assert ranking.best in ranking.leading(3)
        assert len(ranking.leading(3)) <= 4
        assert ranking.best.held_out == pytest.approx(1.0, abs=0.3)


def test_an_azimuth_bias_is_not_called_a_rotation_that_has_more_to_turn():
    for seed in range(40, 46):
        turned = []
        for one in run(np.random.default_rng(seed), offset=2e-3):
            x, y = (
                version + 1e-3 * np.cross([0, 0, 1.0], version - np.array(PLACES[array])) * (array == 2)
                for array, version in zip(one.pair, (one.x, one.y), strict=True)
            )
            turned.append(CrossoverSet(one.pair, one.point_count, x, y, one.pass_number, source="simulated"))
        found = compare_causes(turned, survey(), PROFILE).best
        assert found.name == "timing offset and azimuth bias of array 2"


def test_a_gradient_turns_about_one_depth_for_vehicles_at_several():
    water = SoundSpeedProfile(DEPTH, PROFILE.speed + 0.03 * (DEPTH - 850.0))
    sets = in_other_water(
        run(np.random.default_rng(14), depths=(100.0, 900.0)), lambda count, downrange: water
    )
    found = compare_causes(sets, survey(), PROFILE).best
    assert "gradient of sound speed" in found.name
    assert estimate(found, "gradient (1/s)")[0] == pytest.approx(0.03, rel=0.1)
    assert found.chi_square / found.count < 1.3


def test_a_drift_is_found_beside_the_offset():
    ranking = compare_causes(run(np.random.default_rng(2), offset=2e-3, drift=1e-6), survey(), PROFILE)
    assert ranking.best.name == "timing offset and timing drift"
    value, sigma = estimate(ranking.best, "drift (s/count)")
    assert abs(value - 1e-6) < 4 * sigma


def test_a_displaced_array_is_named_and_its_displacement_found():
    moved = np.array([6.0, -8.0, 5.0])
    ranking = compare_causes(
        run(np.random.default_rng(3), offset=1e-3, displaced=(3, moved)), survey(), PROFILE
    )
    assert ranking.best.name == "timing offset and displacement of array 3"
    assert np.all(
        np.abs(ranking.best.estimate[1:] + moved) < 4 * ranking.best.sigma[1:]
    )  # the correction undoes it


def test_patterns_are_those_of_the_rays():
    # A cause put in by moving what the arrays measured comes back as what it was.
    rng = np.random.default_rng(4)
    sets = run(rng)
    clean = compare_causes(sets, survey(), PROFILE, pairs=False)
    turned = []
    for one in sets:
        x, y = (
            version + 1e-3 * np.cross([0, 0, 1.0], version - np.array(PLACES[array])) * (array == 2)
            for array, version in zip(one.pair, (one.x, one.y), strict=True)
        )
        turned.append(CrossoverSet(one.pair, one.point_count, x, y, one.pass_number, source="simulated"))
    ranking = compare_causes(turned, survey(), PROFILE, pairs=False)
    assert ranking.best.name == "azimuth bias of array 2"
    value, sigma = estimate(ranking.best, "azimuth (rad)")
    assert abs(value + 1e-3) < 4 * sigma
    assert clean.best.name != ranking.best.name


STEPS = np.eye(2)[..., None]


def told_in_other_water(track, place, true, assumed, raised=0.0):
    """Where an array puts a track (T, 3) that follows its rays back through an assumed profile; by Newton's method.

    raised : what it adds to every elevation
    """
    level = track[:, :2] - place[:2]
    goal = seen(np.hypot(*level.T), track[:, 2], place, true)
    goal[0] += raised
    at = np.stack([np.hypot(*level.T), track[:, 2]])
    for _ in range(6):
        miss = seen(*at, place, assumed) - goal
        ways = [seen(*(at + step), place, assumed) - seen(*(at - step), place, assumed) for step in STEPS]
        slopes = np.stack(ways, axis=-1) / 2
        at = at - np.linalg.solve(slopes.swapaxes(0, 1), miss.T[..., None])[..., 0].T
    return np.column_stack([place[:2] + level * (at[0] / np.hypot(*level.T))[:, None], at[1]])


def seen(horizontal, height, place, profile):
    rays = fit_rays(profile, horizontal, -height, -place[2])
    return np.stack([rays.elevation_array, rays.travel_time])


def in_other_water(sets, water):
    """The same sets, reported in a water that the analyst does not know: water(point count, downrange)."""
    changed = []
    for one in sets:
        true = water(np.mean(one.point_count), np.mean(one.x[:, 0]))
        x, y = (
            told_in_other_water(version, np.array(PLACES[array]), true, PROFILE)
            for array, version in zip(one.pair, (one.x, one.y), strict=True)
        )
        changed.append(CrossoverSet(one.pair, one.point_count, x, y, one.pass_number, source="simulated"))
    return changed


def scaled(share):
    return SoundSpeedProfile(DEPTH, PROFILE.speed * (1 + share))


MEAN_COUNT, MEAN_DOWNRANGE = 1250.0, 4000.0


@pytest.mark.parametrize(
    ("name", "parameter", "value", "water"),
    [
        ("scale of sound speed", "scale", 2e-3, lambda count, downrange: scaled(2e-3)),
        (
            "gradient of sound speed", "gradient (1/s)", 0.03,
            lambda count, downrange: SoundSpeedProfile(DEPTH, PROFILE.speed + 0.03 * (DEPTH - 850.0)),
        ),
        (
            "sound speed changing in time", "scale per count", 2e-6,
            lambda count, downrange: scaled(2e-6 * (count - MEAN_COUNT)),
        ),
        (
            "sound speed changing along the range", "scale per length", 1e-6,
            lambda count, downrange: scaled(1e-6 * (downrange - MEAN_DOWNRANGE)),
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_with_the_water_is_named(name, parameter, value, water):
    sets = run(np.random.default_rng(8))
    ranking = compare_causes(in_other_water(sets, water), survey(), PROFILE, pairs=False)
    assert ranking.best.name == name
    found, sigma = estimate(ranking.best, parameter)
    assert abs(found - value) < max(4 * sigma, 0.1 * value)


@pytest.mark.parametrize(
    ("name", "parameter", "axis"),
    [
        ("rotation of array 3", "about downrange (rad)", [1.0, 0, 0]),
        ("rotation of array 3", "about crossrange (rad)", [0, 1.0, 0]),
    ],
)
def test_a_tilted_array_is_named_and_its_tilt_found(name, parameter, axis):
    tilted = []
    for one in run(np.random.default_rng(9)):
        x, y = (
            version + 3e-3 * np.cross(axis, version - np.array(PLACES[array])) * (array == 3)
            for array, version in zip(one.pair, (one.x, one.y), strict=True)
        )
        tilted.append(CrossoverSet(one.pair, one.point_count, x, y, one.pass_number, source="simulated"))
    ranking = compare_causes(tilted, survey(), PROFILE, pairs=False)
    assert ranking.best.name == name
    found, sigma = estimate(ranking.best, parameter)
    assert abs(found + 3e-3) < 4 * sigma


def test_a_bias_of_the_elevations_is_named():
    biased = []
    for one in run(np.random.default_rng(10)):
        x, y = (
            told_in_other_water(version, np.array(PLACES[array]), PROFILE, PROFILE, 2e-3 * (array == 2))
            for array, version in zip(one.pair, (one.x, one.y), strict=True)
        )
        biased.append(CrossoverSet(one.pair, one.point_count, x, y, one.pass_number, source="simulated"))
    ranking = compare_causes(biased, survey(), PROFILE, pairs=False)
    assert ranking.best.name == "elevation bias of array 2"
    found, sigma = estimate(ranking.best, "elevation (rad)")
    assert abs(found + 2e-3) < 4 * sigma


def test_gaps_of_three_arrays_at_one_count_are_two():
    count = np.arange(4)
    none = np.zeros((4, 3))
    sets = [CrossoverSet((1, 2), count, none, none), CrossoverSet((2, 3), count[2:], none[2:], none[2:])]
    alone = independent_shares(sets)
    assert [share.tolist() for share in alone] == [[1, 1, 1, 1], [1, 1]]
    shared = independent_shares([*sets, CrossoverSet((1, 3), count[1:], none[1:], none[1:])])
    assert shared[0] == pytest.approx([1, 1, 2 / 3, 2 / 3])
    assert shared[1] == pytest.approx([2 / 3, 2 / 3])
    assert shared[2] == pytest.approx([1, 2 / 3, 2 / 3])
    apart = independent_shares([sets[0], CrossoverSet((3, 4), count, none, none)])
    assert [share.tolist() for share in apart] == [[1] * 4] * 2


def test_one_set_cannot_tell_which_of_two_arrays_is_displaced():
    moved = np.array([6.0, -8.0, 5.0])
    one = run(np.random.default_rng(5), displaced=(3, moved))[1:2]
    ranking = compare_causes(one, survey(), PROFILE, pairs=False)
    fit = next(fit for fit in ranking.fits if fit.name == "displacement of array 3")
    assert "displacement of array 1" in fit.alike
    assert fit.held_out is None


def test_offset_and_scale_of_sound_speed_are_hardly_separated():
    ranking = compare_causes(run(np.random.default_rng(6), offset=3e-3), survey(), PROFILE)
    fit = next(fit for fit in ranking.fits if fit.name == "timing offset and scale of sound speed")
    assert fit.hardly_separated == (("offset (s)", "scale"),)


def test_sets_too_short_are_named_and_none_left_is_refused():
    sets = run(np.random.default_rng(7), offset=1e-3)
    short = sets[0].only(np.arange(3))
    ranking = compare_causes([short, *sets[1:]], survey(), PROFILE, pairs=False)
    assert "arrays 1 and 2, pass 1: 3 points are too few" in ranking.skipped[0]
    with pytest.raises(ValueError, match="no crossover set has enough points"):
        compare_causes([short], survey(), PROFILE)


@pytest.fixture(scope="module")
def demo(data):
    folder = data / "range-demo"
    reports = read_tfile(folder / "tfile.dat").reports
    return (
        lambda mode: gate_reports(reports, read_arrays(folder / "arrays.csv").survey, mode).sets,
        read_arrays(folder / "arrays.csv").survey,
        read_velocity(folder / "VELOCITY.DAT").profile,
        json.loads((folder / "truth.json").read_text()),
    )


def test_the_wrongly_surveyed_array_of_the_demo_is_named(demo):
    gate, positions, profile, truth = demo
    ranking = compare_causes(gate(7), positions, profile)
    assert ranking.best.name == "timing offset and displacement of array 5"
    error = np.array(truth["survey_errors_ft"]["5"]["table_minus_true"])
    assert np.all(np.abs(ranking.best.estimate[1:] + error) < 4 * ranking.best.sigma[1:])
    value, sigma = estimate(ranking.best, "offset (s)")
    assert abs(value - 2.85e-3) < 4 * sigma


def test_without_that_array_one_offset_or_a_drift_is_enough(demo):
    gate, positions, profile, _ = demo
    for mode, wanted in ((7, "timing offset"), (2, "timing offset and timing drift")):
        sets = [one for one in gate(mode) if 5 not in one.pair]
        assert compare_causes(sets, positions, profile).best.name == wanted
