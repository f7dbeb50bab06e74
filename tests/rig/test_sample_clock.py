"""When readings were sensed: on the grid, whatever the way does to them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.rig.devices.reading_stream import LEAK, SampleClock

RATE = 1000.0
WAY = 0.0005  # [s] that every packet takes at least


def run(n=20_000, *, drift=0.0, jitter=0.0003, loss=0.0, latency=lambda t: 0.0, first=1, seed=1, leak=LEAK):
    """When readings were truly sensed, what the clock says of it, and the lateness; each (n,) less what is lost."""
    draw = np.random.default_rng(seed)
    truth = 50.0 + np.arange(n) * (1.0 + drift) / RATE
    arrival = truth + WAY + draw.exponential(jitter, n) + np.array([latency(t - 50.0) for t in truth])
    arrival = np.maximum.accumulate(arrival)
    kept = draw.random(n) >= loss
    kept[0] = True
    clock = SampleClock(RATE, leak)
    said = np.array([clock.sensed((first + int(i)) % 2**32, float(arrival[i])) for i in np.flatnonzero(kept)])
    return truth[kept], said[:, 0], said[:, 1]


@pytest.mark.parametrize("drift", [-1e-4, 0.0, 1e-4])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_jitter_loss_and_drift_leave_the_grid_within_a_quarter_of_a_millisecond(drift, loss):
    truth, said, lateness = run(drift=drift, loss=loss)
    settled = slice(1000, None)
    assert np.abs((said - truth - WAY)[settled]).max() < 0.25e-3
    assert np.median(lateness[settled]) == pytest.approx(0.3e-3 * np.log(2), abs=0.1e-3)  # of the jitter drawn


def test_without_the_leak_a_slow_sensor_would_seem_ever_later():
    truth, said, lateness = run(drift=1e-4, leak=0.0)
    assert lateness[-1] > 1.5e-3
    assert truth[-1] + WAY - said[-1] > 1.5e-3


def test_the_times_are_more_even_than_the_arrivals():
    _, said, lateness = run(jitter=0.0005)
    arrivals = said + lateness
    assert np.diff(said)[1000:].std() < 0.1 * np.diff(arrivals)[1000:].std()


def test_added_latency_shows_at_once_in_full_and_is_forgotten_slowly():
    truth, _, lateness = run(latency=lambda t: 0.03 if t >= 5.0 else 0.0, jitter=0.0001)
    step = np.searchsorted(truth, 55.0)
    assert lateness[:step].max() < 0.002
    assert lateness[step] > 0.029
    assert lateness[step : step + 1000].min() > 0.028  # a second later still
    assert lateness[-1] == pytest.approx(0.03 - 15.0 * 1e-3, abs=0.002)  # at a millisecond a second


def test_latency_that_falls_away_is_believed_at_once():
    truth, said, lateness = run(latency=lambda t: 0.03 if t < 5.0 else 0.0, jitter=0.0001)
    after = truth > 55.1
    assert lateness[after].max() < 0.002
    assert np.abs(said - truth - WAY)[after].max() < 0.25e-3


@given(
    st.lists(st.tuples(st.integers(0, 2**32 - 1), st.floats(0.0, 5.0)), min_size=1, max_size=60),
)
def test_whatever_comes_times_never_go_back_nor_beyond_the_arrival(packets):
    clock, arrival, before = SampleClock(RATE), 10.0, 0.0
    for sequence, pause in packets:
        arrival += pause
        time, lateness = clock.sensed(sequence, arrival)
        assert before <= time <= arrival
        assert lateness >= 0.0
        before = time


def test_the_wrap_around_of_the_sequence_is_no_event():
    plain = run(4000)
    wrapped = run(4000, first=2**32 - 2000)
    assert np.array_equal(plain[1], wrapped[1])
    assert np.array_equal(plain[2], wrapped[2])


@pytest.mark.parametrize("restarted", [1, 3_000_000_000, 200_000])
def test_a_restart_of_the_sensor_is_a_new_beginning(restarted):
    clock = SampleClock(RATE)
    for i in range(5000):
        clock.sensed(100_000 + i, 10.0 + i / RATE)
    assert clock.sensed(restarted, 16.0) == (16.0, 0.0)
    time, lateness = clock.sensed(restarted + 1, 16.003)
    assert time == pytest.approx(16.001, abs=1e-5)
    assert lateness == pytest.approx(0.002, abs=1e-5)


def test_a_pause_without_restart_is_lateness_only_of_what_comes_late():
    clock = SampleClock(RATE)
    for i in range(1000):
        clock.sensed(1 + i, 10.0 + i / RATE)
    # Held up for two seconds and let go at once: the first has waited for all of them.
    assert clock.sensed(1001, 13.0)[1] == pytest.approx(2.0, abs=0.01)
    assert clock.sensed(3001, 13.0)[1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan")])
def test_a_rate_that_is_none_is_refused(rate):
    with pytest.raises(ValueError, match="rate"):
        SampleClock(rate)
