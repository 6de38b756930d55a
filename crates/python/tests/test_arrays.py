"""Arrays in and out, against NumPy and SciPy."""

import threading
import time
import _thread

import gearwatch as gw
import numpy as np
import pytest
from scipy import signal

RATE_HZ, SPEED_HZ = 2048.0, 5.0


def lines(duration_s, amplitudes, noise=0.0, seed=1):
    """Mesh harmonics of 20 teeth at 5 Hz with these peak amplitudes (m/s²)."""
    t = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    tones = sum(a * np.cos(2 * np.pi * 20 * SPEED_HZ * k * t + k) for k, a in enumerate(amplitudes, start=1))
    return tones + noise * np.random.default_rng(seed).standard_normal(t.size)


def recording(samples):
    tacho_s = np.arange(0.0, samples.size / RATE_HZ, 1 / SPEED_HZ)
    return gw.Recording.from_arrays(
        {"acc_1": samples, "acc_2": samples}, RATE_HZ, motor_speed_hz=SPEED_HZ, brake_torque_nm=10.0, tacho_s=tacho_s,
        tacho_shaft="input",
    )


def test_oracle_order_spectrum_is_scipys():
    """At constant speed it is SciPy's amplitude spectrum under Hann's window on another axis; the mean is taken off first."""
    samples = lines(2.0, [1.0, 0.5], noise=0.1) + 3.0
    orders, amplitude = gw.order_spectrum(samples, RATE_HZ, SPEED_HZ)
    frequency, power = signal.periodogram(samples, RATE_HZ, "hann", detrend="constant", scaling="spectrum")
    # Double precision, and lines far below the largest: absolute.
    np.testing.assert_allclose(orders * SPEED_HZ, frequency, rtol=1e-12)
    # The spectrum of mean squares: peak amplitudes are sqrt(2) times the root, but at the ends, where there is no negative frequency.
    np.testing.assert_allclose(amplitude[1:-1], np.sqrt(2 * power[1:-1]), atol=1e-12)


def test_analytic_amplitudes_of_known_tones(bench):
    """Peak amplitudes of tones without noise, within single precision of the samples (6e-8) and the tacho's nanoseconds."""
    told = [2.0, 1.0, 0.5, 0.25, 0.125]
    table = gw.amplitudes(recording(lines(10.0, told)), bench)
    assert set(table.channel) == {"acc_1", "acc_2"} and set(table.instrument) == {"ok"}
    for k, amplitude in enumerate(told, start=1):
        np.testing.assert_allclose(table[f"amp_{k}x"], amplitude, rtol=1e-4)
    np.testing.assert_allclose(table.input_speed_hz, SPEED_HZ, rtol=1e-6)
    np.testing.assert_allclose(table.mesh_hz, 20 * SPEED_HZ, rtol=1e-6)
    assert "amp_1x-1pinion" in gw.amplitudes(recording(lines(3.0, told)), bench, sidebands=True)


def test_conform_shapes_and_types(bench):
    made = recording(lines(3.0, [1.0]))
    channel = made["acc_1"]
    assert channel.samples.shape == (6144,) and channel.samples.dtype == np.float64
    assert (channel.unit, channel.sample_rate_hz, len(channel.segments)) == ("m/s^2", RATE_HZ, 1)
    assert made.tachos["input"].dtype == np.int64 and made.operating_points["brake_torque_nm"].tolist() == [10.0]
    with pytest.raises(KeyError, match="acc_1, acc_2"):
        made["acc_9"]
    with pytest.raises(ValueError, match="one-dimensional"):
        gw.Recording.from_arrays({"a": np.zeros((2, 2))}, RATE_HZ)
    spectra = gw.order_spectra(recording(lines(10.0, [1.0])), bench, "acc_1")
    assert len(spectra) > 5 and all(one["orders"].shape == one["amplitude"].shape for one in spectra)


def test_analytic_a_changed_amplitude_has_its_rank(bench):
    """6 % more in 1x against a baseline of the same tones: rank II (4 to 7 %)."""
    told = [1.0, 0.5, 0.3, 0.2, 0.1]
    baseline = gw.learn_baseline(recording(lines(60.0, told, 0.02, seed=2)), bench, session="a").merged(
        gw.learn_baseline(gw.Recording.from_arrays(
            {name: lines(60.0, told, 0.02, seed=3) for name in ("acc_1", "acc_2")}, RATE_HZ, motor_speed_hz=SPEED_HZ,
            brake_torque_nm=10.0, name="other"), bench, session="b"))
    changed = gw.diagnose(recording(lines(60.0, [1.06, *told[1:]], 0.02, seed=4)), bench, baseline)
    assert set(changed.rank_1x) == {"II"}
    # Noise of 0.02 a sample over a minute leaves a millionth of the tone; the step stays 6 %.
    np.testing.assert_allclose(changed.dev_1x_percent, 6.0, atol=0.3)


def test_conform_steady_state_agrees_with_stepping(bench):
    """The mesh line of the steady state beside the one that stepping through time shows, behind the sensor's chain and noise."""
    state = gw.steady(bench)
    mesh = 20.0
    at = int(np.argmin(abs(state.orders - mesh)))
    assert state.orders[at] == mesh and state.frequencies_hz[at] == pytest.approx(100.0, rel=1e-3)
    stepped = gw.amplitudes(gw.simulate(bench, duration_s=10.0, background_m_per_s2=0.0), bench)
    # The chain of the simulated sensor passes 100 Hz within a few percent.
    found = stepped[stepped.channel == "acc_1"].amp_1x.median()
    assert abs(state.lines["acc_1"][at]) == pytest.approx(found, rel=0.1)


def test_conform_effects_are_described_and_checked(bench):
    wear = next(one for one in gw.effects() if one["id"] == "tooth_wear")
    assert wear["parameters"]["depth_um"]["unit"] == "µm"
    with pytest.raises(gw.SimulationError, match="expected ID@PLACE"):
        gw.simulate(bench, effects=["tooth_wear"])
    with pytest.raises(gw.SimulationError, match="depth_um"):
        gw.simulate(bench, effects=["tooth_wear@stage1:depth_um=99999"])


def test_conform_other_threads_go_on_and_ctrl_c_ends(bench):
    """Another thread counts while a long simulation runs, and Ctrl-C ends that within a second or two."""
    ticks, done = [], threading.Event()

    def count():
        while not done.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.01)

    counter = threading.Thread(target=count)
    counter.start()
    timer = threading.Timer(1.0, _thread.interrupt_main)
    timer.start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        gw.simulate(bench, duration_s=100_000.0)
    took = time.monotonic() - began
    done.set()
    counter.join()
    # Without the release of the lock the counter would stand still: a tenth of what fits is enough to tell.
    assert took < 20.0 and len(ticks) > took / 0.01 / 10


def test_conform_progress_is_told(bench):
    steps = []
    gw.simulate(bench, duration_s=3.0, progress=steps.append)
    assert steps[0] == "settling" and any("2 s of 3 s" in step for step in steps)
