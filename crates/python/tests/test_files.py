"""Files in, from the formats that other programs write."""

import csv

import gearwatch as gw
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsFile, TdmsWriter
from scipy.io import loadmat, savemat, wavfile

RATE_HZ = 2048.0


@pytest.fixture(scope="module")
def samples():
    """Five seconds within ±1 of single precision, so that every format holds them as they are."""
    return np.random.default_rng(7).uniform(-1, 1, 5 * int(RATE_HZ)).astype(np.float32).astype(np.float64)


def write_wav(path, samples):
    wavfile.write(path, int(RATE_HZ), samples.astype(np.float32))


def write_csv(path, samples):
    with path.open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["time_s", "acc"])
        lines.writerows((repr(k / RATE_HZ), repr(float(x))) for k, x in enumerate(samples))


def write_mat(path, samples):
    savemat(path, {"acc": samples})


def write_tdms(path, samples):
    properties = {"wf_increment": 1 / RATE_HZ, "unit_string": "m/s^2"}
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("vibration", "acc", samples, properties=properties)])


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (write_wav, {"scale": 1.0}),
        (write_csv, {"time_column": "time_s"}),
        (write_mat, {"sample_rate_hz": RATE_HZ}),
        (write_tdms, {}),
    ],
)
def test_oracle_files_of_other_writers_hold_the_same_samples(tmp_path, samples, write, said):
    """SciPy, npTDMS and csv write; `read` finds the same numbers."""
    path = tmp_path / f"run.{write.__name__.removeprefix('write_')}"
    write(path, samples)
    found = gw.read(path, unit="m/s^2", **said)
    channel = found[found.channels[0]]
    assert len(found) == 1 and channel.unit == "m/s^2"
    assert channel.sample_rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    np.testing.assert_array_equal(channel.samples, samples)


@pytest.mark.parametrize("name", ["run.mcap", "run.uff"])
def test_conform_files_of_the_command_are_read(command, folder, bench, name):
    """What `simulate` and `convert` write is what `simulate` gives here."""
    ours = gw.simulate(bench, duration_s=3.0, seed=5)
    made = folder / f"five-{name}.mcap"
    command("simulate", folder / "bench.toml", "--seed", 5, "--duration", 3, "-o", made)
    if name.endswith(".uff"):
        command("convert", made, folder / name)
        made = folder / name
    found = gw.read(made)
    assert found.channels == ours.channels
    for sensor in ours.channels:
        np.testing.assert_array_equal(found[sensor].samples, ours[sensor].samples)


def by_scipy_wav(path):
    rate_hz, values = wavfile.read(path)
    assert rate_hz == RATE_HZ
    return {"acc_1": values[:, 0], "acc_2": values[:, 1]}


def by_scipy_mat(path):
    found = loadmat(path)
    assert found["fs"] == RATE_HZ
    return {name: found[name].ravel() for name in ("acc_1", "acc_2")}


def by_nptdms(path):
    group = TdmsFile.read(path)["gearwatch"]
    for channel in group.channels():
        assert channel.properties["unit_string"] == "m/s^2"
        assert channel.properties["wf_increment"] == 1 / RATE_HZ
        assert str(channel.properties["wf_start_time"]).startswith("2026-01-01T00:00")
    return {channel.name: channel[:] for channel in group.channels()}


def by_numpy(path):
    table = np.genfromtxt(path, delimiter=",", names=True)
    np.testing.assert_allclose(np.diff(table["time"]), 1 / RATE_HZ, rtol=1e-9)
    return {name: table[name] for name in ("acc_1", "acc_2")}


@pytest.mark.parametrize(("end", "load"), [("wav", by_scipy_wav), ("mat", by_scipy_mat), ("tdms", by_nptdms), ("csv", by_numpy)])
def test_oracle_other_programs_read_what_convert_writes(command, folder, tmp_path, end, load):
    """SciPy, npTDMS and NumPy find the samples, the rate and the unit; `read` finds them with names and operating point."""
    recording = tmp_path / "run.mcap"
    command("simulate", folder / "bench.toml", "--speed", "300rpm", "--torque", 10, "--duration", 3, "-o", recording)
    command("convert", recording, tmp_path / f"run.{end}")
    ours, theirs, back = gw.read(recording), load(tmp_path / f"run.{end}"), gw.read(tmp_path / f"run.{end}")
    assert back.channels == ours.channels == list(theirs)
    for name in ours.channels:
        np.testing.assert_array_equal(theirs[name], ours[name].samples)
        np.testing.assert_array_equal(back[name].samples, ours[name].samples)
        assert back[name].sample_rate_hz == RATE_HZ and back[name].unit == "m/s^2"
    assert back.operating_points["brake_torque_nm"][0] == pytest.approx(10.0)


def test_conform_progress_of_reading_is_told(tmp_path, samples):
    steps = []
    write_csv(tmp_path / "run.csv", np.tile(samples, 10))
    gw.read(tmp_path / "run.csv", unit="g", time_column="time_s", progress=steps.append)
    assert steps[0] == "run.csv" and steps[1:] and all(step.endswith(" %") for step in steps[1:])


def test_conform_what_a_file_leaves_unsaid_is_asked_for(tmp_path, samples):
    """The sentence names the file and what to say."""
    write_mat(tmp_path / "run.mat", samples)
    with pytest.raises(gw.ReadError, match=r"run\.mat.*sample"):
        gw.read(tmp_path / "run.mat")
