"""Every fault of a radar and of its poses is told by its name, and a clean run by none."""

import numpy as np
import pytest
from faulty import FAULTS, FREQUENCY, PAIRS, TONES, WAYS, disturbed, make_drive, noise, with_fault

from flgpr.health.findings import LIMITS
from flgpr.health.judging import jitter_ps
from flgpr.health.of_run import health_of_run, radar_of, without
from flgpr.health.streaming import LiveHealth
from flgpr.health.sums import HealthSums
from flgpr.model import SPEED_OF_LIGHT, Lane, complete_scans, make_run


@pytest.fixture(scope="module")
def clean():
    return make_drive()


@pytest.fixture(scope="module")
def longer():
    return make_drive(scans=46)


def names(run, lane=None):
    return [finding.name for finding in health_of_run(run, lane).findings]


@pytest.mark.parametrize("seed", range(1, 7))
def test_a_clean_drive_is_left_in_peace(seed):
    health = health_of_run(make_drive(seed))
    assert health.findings == ()
    assert not health.left_out


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_told_with_number_limit_and_advice(clean, name):
    health = health_of_run(with_fault(clean, FAULTS[name]))
    told = {finding.name: finding for finding in health.findings}
    assert name in told
    one = told[name]
    assert one.value > one.limit == LIMITS[name].most
    assert one.advice in one.sentence or one.done in one.sentence


@pytest.mark.parametrize("words", WAYS)
def test_a_run_that_is_not_taken_as_it_was_recorded_is_told_with_what_is_wrong(
    clean, longer, words
):
    [one] = health_of_run(with_fault(clean, WAYS[words])).findings
    assert words in one.words
    assert one.advice
    [one] = findings_live(with_fault(longer, WAYS[words]), lost=False)
    assert words in one.words


@pytest.mark.parametrize("at", ["frozen", "anywhere", "standing"])
@pytest.mark.parametrize("words", ["conjugated", "reverse order"])
def test_a_scene_at_the_mirror_of_its_paths_is_told_without_poses(clean, at, words):
    def unmoved(signal, pose):
        middle = len(pose) // 2
        if at == "standing":
            signal[:] = signal[middle] + 0.1 * noise(np.random.default_rng(5), *signal.shape)
        pose[middle if at == "frozen" else 0 :] = pose[middle]

    right = with_fault(clean, unmoved)
    before = names(right)
    assert before == (["frozen positions"] if at == "frozen" else [])
    turned = np.conj if words == "conjugated" else lambda signal: signal[..., ::-1]
    *others, one = health_of_run(with_fault(right, lambda s, p: (turned(s), p))).findings
    assert [other.name for other in others] == before
    assert one.name == "paths"
    assert words in one.words
    assert one.advice


def test_a_course_beside_the_lane_is_told_and_one_within_is_not(clean):
    aside = with_fault(clean, lambda signal, pose: (signal, pose + [2, 0, 0, 0, 0, 0]))
    lane = Lane(-1.5, 1.5, 2.0, 12.0)
    assert names(clean, lane) == []
    assert names(aside, lane) == ["course"]
    assert names(aside) == []  # without a lane nobody can know


@pytest.mark.parametrize(
    ("name", "pairs", "tones"),
    [
        ("missing pairs", (4,), ()),
        ("hot pairs", (4,), ()),
        ("dead pairs", (4,), ()),
        ("stuck pairs", (4,), ()),
        ("missing tones", (), (50,)),
        ("disturbed tones", (), (31, 77, 120)),
    ],
)
def test_what_is_at_fault_is_left_out_and_the_rest_is_whole(clean, name, pairs, tones):
    run = with_fault(clean, FAULTS[name])
    health = health_of_run(run)
    assert (health.left_out.pairs, health.left_out.tones) == (pairs, tones)
    assert "left out" in health.findings[0].done
    kept = without(run, health.left_out)
    assert kept.sizes["pair"] == PAIRS - len(pairs)
    assert kept.sizes["frequency"] == TONES - len(tones)
    assert complete_scans(kept).all()
    same = np.setdiff1d(np.arange(TONES), [31, 77, 120, 50])
    expected = np.delete(clean["signal"].values, pairs, axis=2)
    of_kept = np.isin(kept["frequency"].values, clean["frequency"].values[same])
    np.testing.assert_array_equal(kept["signal"].values[..., of_kept], expected[..., same])


def test_most_of_an_array_is_not_left_out(clean):
    dead = slice(0, PAIRS * 2 // 3)

    def change(signal, pose):
        signal[:, :, dead] = np.nan

    health = health_of_run(with_fault(clean, change))
    assert [finding.name for finding in health.findings] == ["missing pairs"]
    assert not health.left_out


@pytest.mark.parametrize("rest", [0.0, 1e-4])
def test_where_most_pairs_are_dead_those_that_live_are_not_hot(clean, rest):
    dead = slice(0, PAIRS * 2 // 3)

    def change(signal, pose):
        signal[:, :, dead] *= rest

    faulty = with_fault(clean, change)
    health = health_of_run(faulty)
    told = told_live(faulty, lost=False)
    assert "dead pairs" in told
    assert "hot pairs" not in told
    [one] = [finding for finding in health.findings if finding.name == "dead pairs"]
    assert one.pairs == tuple(range(dead.stop))
    assert "hot pairs" not in {finding.name for finding in health.findings}
    assert not health.left_out.pairs  # too many: they stay, and weigh nothing


def test_a_sign_is_told_with_its_pairs(clean):
    [one] = health_of_run(with_fault(clean, FAULTS["turned pairs"])).findings
    assert one.pairs == (2, 6, 13)


def test_pairs_in_each_others_place_are_told_and_not_taken_for_turned_ones(clean):
    swapped = with_fault(clean, FAULTS["swapped pairs"])
    [one] = health_of_run(swapped).findings
    assert one.pairs == (3, 7)
    swapped, turned = health_of_run(with_fault(swapped, FAULTS["turned pairs"])).findings
    assert swapped.pairs == (3, 7)
    assert turned.pairs == (2, 6, 13)


def test_tones_are_alike_while_an_echo_comes_near():
    """Its delay turns the phase between neighbouring tones by more than half a turn."""
    sums = HealthSums((2, 32, 60))
    rng = np.random.default_rng(3)
    tones = 442.5e6 + 7.5e6 * np.arange(60)
    for path in np.linspace(24, 4, 24):
        reflectivity = rng.normal(size=(2, 32, 1)) + 1j * rng.normal(size=(2, 32, 1))
        sums.add(reflectivity * np.exp(-2j * np.pi * tones * path / SPEED_OF_LIGHT))
    assert sums.tone_likeness.min() > 0.9


def test_a_long_run_is_judged_by_stretches_of_it():
    run = make_drive(2)
    many = 300 // run.sizes["scan"] + 1
    scans = np.tile(np.arange(run.sizes["scan"]), many)
    long = run.isel(scan=scans)
    long["pose"].values[:, 1] = 0.5 * np.arange(len(scans))
    signal = long["signal"].values
    signal[:, :, 3] *= 1e4
    told = names(long.assign(signal=(long["signal"].dims, signal)))
    assert "hot pairs" in told


def told_live(run, lane=None, lost=True):
    return [finding.name for finding in findings_live(run, lane, lost)]


def findings_live(run, lane=None, lost=True):
    """Return what is told of a run that comes scan by scan, of which one scan in six is lost."""
    watch = LiveHealth(radar_of(run))
    watch.lane = lane
    told = []
    for place, pose in enumerate(run["pose"].values):
        signal = run["signal"].values[place]
        if lost and place % 6 == 5:  # those after which sums are due are among them
            signal = np.full_like(signal, np.nan)
        told += watch.take(signal, pose).findings
    return told


@pytest.mark.parametrize(
    "words", ["the heading is turned by 180 degrees", "the data are conjugated"]
)
def test_what_leaves_nothing_in_common_is_told_live_within_16_scans(words):
    [one] = findings_live(with_fault(make_drive(scans=16), WAYS[words]), lost=False)
    assert words in one.words


def test_of_ground_that_shows_nothing_no_other_way_is_told_early():
    rng = np.random.default_rng(0)

    def nothing_seen(signal, pose):
        leak = np.exp(-2j * np.pi * FREQUENCY * 5e-9)
        return 3 * leak + noise(rng, *signal.shape), pose

    for seed in range(1, 6):
        assert findings_live(with_fault(make_drive(seed, 20), nothing_seen), lost=False) == []


@pytest.mark.parametrize(
    "name",
    [
        *("dead polarization", "stuck pairs", "swapped pairs", "turned pairs"),
        *("jitter", "time zero", "heading", "lag"),
    ],
)
def test_the_geometry_is_judged_while_driving_too(longer, name):
    assert told_live(longer) == []
    assert name in told_live(with_fault(longer, FAULTS[name]))


def test_a_course_beside_the_lane_is_told_while_driving(longer):
    aside = with_fault(longer, lambda signal, pose: (signal, pose + [2, 0, 0, 0, 0, 0]))
    lane = Lane(-1.5, 1.5, 2.0, 22.0)
    assert told_live(longer, lane) == []
    assert told_live(aside, lane) == ["course"]
    assert told_live(aside) == []


def test_scans_that_overtake_one_another_are_not_taken_for_consecutive_ones(longer):
    watch = LiveHealth(radar_of(longer))
    for place, pose in enumerate(longer["pose"].values):
        watch.take(longer["signal"].values[place], pose, follows=place % 3 > 0)
    assert watch.looks._looked == 0


def test_live_tries_a_way_that_is_far_off_again_where_what_is_stated_fails(longer):
    def turning(signal, pose):
        pose[25:, 3] += np.pi

    def tried(run):
        """Return how often a turned heading and late poses were tried."""
        watch = LiveHealth(radar_of(run))
        for signal, pose in zip(run["signal"].values, run["pose"].values, strict=True):
            watch.take(signal, pose)
        known = watch.looks._values
        return [
            next(len(known[name]) for name in known if words in name)
            for words in ("180 degrees", "1 scan late")
        ]

    turned, late = tried(longer)
    assert turned < late
    assert tried(with_fault(longer, turning))[0] > turned


@pytest.mark.parametrize("pairs", [1, 2])
def test_of_a_few_pairs_what_can_be_judged_is(clean, pairs):
    """A dead pair among two, disturbed tones and repeated scans; no level of one by another's."""
    few = clean.isel(pair=slice(pairs))
    assert names(few) == []

    def changed(change):
        signal = few["signal"].values.copy()
        change(signal)
        return names(few.assign(signal=(few["signal"].dims, signal)))

    def silent(signal):
        signal[:, :, pairs - 1] = 0

    def frozen(signal):
        signal[9:] = signal[9]

    def half_stuck(signal):
        signal[..., : TONES * 2 // 3] = signal[0, ..., : TONES * 2 // 3]

    assert "dead pairs" in changed(silent) if pairs > 1 else changed(silent) == ["repeated scans"]
    assert "repeated scans" in changed(frozen)
    assert "stuck pairs" in changed(half_stuck)
    assert "disturbed tones" in changed(lambda signal: disturbed(signal, None))


def line_over_a_pipe(level, jitter=0.0):
    """Simulate a line of one channel: what stands still, a hyperbola so much stronger, and noise."""
    rng = np.random.default_rng(4)
    way = 0.02 * np.arange(80)
    delay = 2e-9 + 2 * np.hypot(way - 0.8, 0.1) / 0.1e9
    signal = np.exp(-2j * np.pi * FREQUENCY * 2e-9)
    signal = signal + level * np.exp(-2j * np.pi * FREQUENCY * delay[:, None])
    signal *= np.exp(-2j * np.pi * FREQUENCY * jitter * rng.normal(size=(80, 1)))
    signal += 0.01 * noise(rng, *signal.shape)
    pose = np.zeros((80, 6))
    pose[:, 1:3] = np.column_stack([way, np.full(80, 0.05)])
    attrs = {"title": "line", "sounding": "ground-coupled"}
    return make_run(
        signal.astype(np.complex64)[:, None, None], FREQUENCY, ["HH"], [[0.0, 0, 0]],
        [[0.1, 0, 0]], pose, 0.1 * np.arange(80), attrs,
    )  # fmt: skip


@pytest.mark.parametrize("level", [0.3, 1.0, 2.0, 4.0])
def test_a_hyperbola_is_no_jump_of_time_zero(level):
    assert "jitter" not in names(line_over_a_pipe(level))


@pytest.mark.parametrize("level", [0.0, 0.3])
@pytest.mark.parametrize("jitter", [100e-12, 300e-12])
def test_time_zero_that_jumps_on_a_line_is_told(level, jitter):
    [one] = [
        one
        for one in health_of_run(line_over_a_pipe(level, jitter)).findings
        if one.name == "jitter"
    ]
    assert one.value == pytest.approx(1e12 * jitter, rel=0.3)


def passing_under(level, seed):
    """Return a change that adds bright rough ground close under an array, other ground at every scan."""

    def change(signal, pose):
        rng = np.random.default_rng(seed)
        along = rng.uniform(0, 30, 1500)
        amplitude = level * np.sqrt(np.mean(np.abs(signal) ** 2)) * noise(rng, 1500, 2, PAIRS)
        for scan, place in zip(signal, pose[:, 1], strict=True):
            near = (along - place > 1.5) & (along - place < 2.3)
            path = 2 * np.hypot(along[near] - place, pose[0, 2])
            phase = np.exp(-2j * np.pi * path[:, None] / SPEED_OF_LIGHT * FREQUENCY)
            scan += np.einsum("npq,nf->pqf", amplitude[near], phase) / np.sqrt(len(phase))

    return change


@pytest.mark.parametrize("level", [0.3, 1.0, 3.0])
def test_ground_that_passes_under_the_array_is_no_jitter(longer, level):
    """Not even where it is stronger than what stands still; then jitter is not known."""
    found = []
    for seed in range(5):
        run = with_fault(longer, passing_under(level, seed))
        sums = HealthSums(run["signal"].shape[1:])
        for signal in run["signal"].values:
            sums.add(signal)
        found.append(jitter_ps(sums, radar_of(run)))
    assert np.isnan(found).all() if level == 3.0 else max(found) < LIMITS["jitter"].most / 2


def test_jitter_is_told_by_its_number_above_ground_that_passes(longer):
    run = with_fault(with_fault(longer, passing_under(0.6, 1)), FAULTS["jitter"])
    [one] = [one for one in health_of_run(run).findings if one.name == "jitter"]
    assert one.value == pytest.approx(200, rel=0.35)


@pytest.mark.parametrize("lowest", [0.5e9, 8.4e9])
@pytest.mark.parametrize("spread", [100e-12, 2e-9])
def test_jitter_is_told_in_every_band_however_large(longer, spread, lowest):
    """At 8.4 GHz it turns the phase by many times."""

    def change(signal, pose):
        delay = spread * np.random.default_rng(5).normal(size=len(signal))
        tones = FREQUENCY - FREQUENCY[0] + lowest
        signal *= np.exp(-2j * np.pi * delay[:, None] * tones)[:, None, None]

    told = health_of_run(with_fault(longer, change)).findings
    [one] = [one for one in told if one.name == "jitter"]
    assert one.value == pytest.approx(1e12 * spread, rel=0.35)


def test_a_pair_of_zeros_is_told_with_a_number(clean):
    silent = with_fault(
        clean, lambda signal, pose: (signal * (np.arange(PAIRS) != 4)[:, None], pose)
    )
    [one] = [one for one in health_of_run(silent).findings if one.name == "dead pairs"]
    assert one.pairs == (4,)
    assert np.isfinite(one.value)


def test_a_scan_of_zeros_is_of_no_use_while_driving(clean):
    watch = LiveHealth(radar_of(clean))
    first, second = clean["signal"].values[:2]
    pose = clean["pose"].values
    assert watch.take(first, pose[0]).signal is not None
    assert watch.take(0 * second, pose[1]).signal is None


def noisy_neighbours(signal, pose):
    """Let 12 of the 140 tones, neighbours, hold noise."""
    signal[..., 60:72] += 2 * noise(np.random.default_rng(5), *signal[..., 60:72].shape)


def test_a_tenth_of_the_tones_that_hold_noise_is_left_out(clean):
    health = health_of_run(with_fault(clean, noisy_neighbours))
    assert set(range(61, 71)) <= set(health.left_out.tones) <= set(range(59, 73))
    assert {finding.name for finding in health.findings if finding.done} == {"noisy tones"}


def test_tones_that_hold_noise_are_left_out_while_driving(longer):
    noisy = with_fault(longer, noisy_neighbours)
    watch = LiveHealth(radar_of(noisy))
    for signal, pose in zip(noisy["signal"].values, noisy["pose"].values, strict=True):
        kept = watch.take(signal, pose).signal
    assert not kept[..., 61:71].any()
    assert np.count_nonzero(~kept.any(axis=(0, 1))) <= 14
    again = LiveHealth(radar_of(noisy))
    again.restore(*watch.state())
    assert not again.take(1.1 * signal, pose + 1).signal[..., 61:71].any()
