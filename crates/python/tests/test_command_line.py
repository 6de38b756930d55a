"""What Python computes is what the command line computes, byte for byte."""

import json

import gearwatch as gw
import pytest


@pytest.fixture(scope="module")
def files(command, folder):
    """Recordings written by the command line, of the normal state and with worn teeth."""
    for name, seed, effect in [("monday", 1, []), ("tuesday", 2, []), ("worn", 3, ["--effect", "tooth_wear@stage1:depth_um=20"])]:
        command("simulate", folder / "bench.toml", "--seed", seed, "--duration", 20, *effect, "-o", folder / f"{name}.mcap")
    for name in ("monday", "tuesday"):
        command(
            "baseline", "learn", folder / f"{name}.mcap", "-b", folder / "bench.toml", "-o", folder / f"{name}.json", "--session", name
        )
    command("baseline", "merge", folder / "monday.json", folder / "tuesday.json", "-o", folder / "normal.json")
    return folder


def test_conform_a_baseline_has_the_same_bytes(files, bench):
    """`learn_baseline` and `merged` write the file that `baseline learn` and `baseline merge` write."""
    monday, tuesday = (gw.learn_baseline(gw.read(files / f"{day}.mcap"), bench, session=day) for day in ("monday", "tuesday"))
    monday.save(files / "python.json")
    assert (files / "python.json").read_bytes() == (files / "monday.json").read_bytes()
    monday.merged(tuesday).save(files / "python.json")
    assert (files / "python.json").read_bytes() == (files / "normal.json").read_bytes()


@pytest.mark.parametrize("windows", [False, True])
def test_conform_verdicts_have_the_same_bytes(files, bench, command, windows):
    form = ["--windows"] if windows else ["--format", "json"]
    worn = files / "worn.mcap"
    said = command("diagnose", worn, "-b", files / "bench.toml", "-n", files / "normal.json", *form, exits=(0, 1, 2, 3))
    ours = gw.diagnose_json(gw.read(worn), bench, gw.Baseline.load(files / "normal.json"), windows=windows)
    assert said and ours.encode() == said


def test_conform_the_table_holds_what_the_lines_say(files, bench):
    baseline = gw.Baseline.load(files / "normal.json")
    worn = gw.read(files / "worn.mcap")
    rows = [json.loads(line) for line in gw.diagnose_json(worn, bench, baseline).splitlines()]
    table = gw.diagnose(worn, bench, baseline)
    assert list(table.columns) == list(max(rows, key=len)) and len(table) == len(rows) == 2
    for row, (_, found) in zip(rows, table.iterrows()):
        for name, value in row.items():
            assert found[name] == value or (value is None and found.isna()[name]), name
    # Worn flanks are seen.
    assert set(table.machine) <= {"alarm", "deviating"}, table.machine


def test_conform_a_simulation_has_the_same_samples(files, bench):
    ours = gw.simulate(bench, effects=[("tooth_wear", "stage1", {"depth_um": 20})], duration_s=20.0, seed=3)
    theirs = gw.read(files / "worn.mcap")
    assert ours.channels == theirs.channels == ["acc_1", "acc_2"]
    for name in ours.channels:
        assert (ours[name].samples == theirs[name].samples).all()
    assert (ours.tachos["input"] == theirs.tachos["input"]).all()


def test_conform_many_recordings_in_their_order_and_what_failed(files, bench):
    baseline = gw.Baseline.load(files / "normal.json")
    paths = [files / "worn.mcap", files / "monday.mcap", files / "bench.toml", files / "none.mcap"]
    table, failed = gw.batch(paths, bench, baseline, workers=3)
    assert list(dict.fromkeys(table.recording)) == [str(path) for path in paths[:2]]
    alone = gw.diagnose(gw.read(paths[1]), bench, baseline, windows=True)
    assert (table[table.recording == str(paths[1])].amp_1x.to_numpy() == alone.amp_1x.to_numpy()).all()
    assert set(failed) == {str(path) for path in paths[2:]} and "none.mcap" in failed[str(paths[3])]


def test_conform_errors_are_the_sentences_of_the_command(command, folder):
    """A misspelt key: exit 3 and a sentence on stderr there, an exception with that sentence here."""
    wrong = folder / "wrong.toml"
    wrong.write_text((folder / "bench.toml").read_text().replace("teeth = 20", "tooth = 20"))
    with pytest.raises(gw.BenchError) as raised:
        gw.Bench.load(wrong)
    assert 'did you mean "teeth"?' in str(raised.value) and str(wrong) in str(raised.value)
    assert gw.Bench.check(wrong) == [str(raised.value)] and gw.Bench.check(folder / "bench.toml") == []
    with pytest.raises(gw.ReadError, match="none.mcap"):
        gw.read(folder / "none.mcap")
    assert issubclass(gw.ReadError, gw.GearwatchError)
