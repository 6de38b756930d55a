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
    with pytest.raises(gw.GearwatchError, match="exists already"):
        tuesday.save(files / "python.json")
    monday.merged(tuesday).save(files / "python.json", force=True)
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


@pytest.mark.parametrize("healthy", [False, True])
def test_conform_indicators_have_the_same_bytes(files, bench, command, healthy):
    """Rows of `indicators` are the lines of `gearwatch indicators --json`."""
    normal = [files / "monday.mcap", files / "tuesday.mcap"] if healthy else []
    told = ["--healthy", *normal] if healthy else []
    said = [json.loads(line) for line in command("indicators", files / "bench.toml", files / "worn.mcap", "--json", *told).splitlines()]
    table = gw.indicators(gw.read(files / "worn.mcap"), bench, [gw.read(path) for path in normal] or None)
    assert list(table.columns) == list(said[0]) and len(table) == len(said) > 20
    for row, (_, found) in zip(said, table.iterrows()):
        for name, value in row.items():
            assert found[name] == value or (value is None and found.isna()[name]), (name, row)
    assert table[table.indicator == "rms"].z.notna().all() == healthy


def test_conform_a_check_has_the_same_findings(files, bench, command):
    wrong = files / "teeth.toml"
    wrong.write_text((files / "bench.toml").read_text().replace("teeth = 20", "teeth = 21"))
    said = json.loads(command("check", wrong, files / "worn.mcap", "--format", "json", exits=(0, 1, 3)))
    table = gw.check(gw.Bench.load(wrong), gw.read(files / "worn.mcap"))
    assert table.to_dict("records") == said["findings"] != []


def test_conform_polars_has_the_same_numbers(files, bench):
    baseline = gw.Baseline.load(files / "normal.json")
    worn = gw.read(files / "worn.mcap")
    ours, theirs = gw.diagnose(worn, bench, baseline, frame="polars"), gw.diagnose(worn, bench, baseline)
    assert ours.columns == list(theirs.columns)
    assert ours["dev_1x_percent"].to_list() == theirs.dev_1x_percent.tolist()
    with pytest.raises(ValueError, match="expected 'pandas' or 'polars'"):
        gw.diagnose(worn, bench, frame="arrow")


def test_conform_an_explanation_has_the_same_bytes(files, bench, command):
    """`explain` gives explanation.json, whatever the answer is, and its figures can be drawn."""
    import matplotlib

    matplotlib.use("Agg")
    names = []
    for speed, torque in [(4.0, 6.0), (4.0, 12.0), (6.0, 6.0), (6.0, 12.0)]:
        name = files / f"x-{speed:.0f}-{torque:.0f}.mcap"
        command(
            "simulate", files / "bench.toml", "--speed", speed, "--torque", torque, "--duration", 6, "--effect",
            "eccentricity@stage1.pinion:runout_um=40", "-o", name,
        )
        names.append(name)
    out = files / "answer"
    command("explain", files / "bench.toml", *names, "--out", out, exits=(0, 1))
    steps = []
    answer = gw.explain(bench, [gw.read(name) for name in names], progress=steps.append)
    assert answer.json.encode() == (out / "explanation.json").read_bytes() and steps
    assert answer.bench.to_toml() == (out / "bench.toml").read_text()
    assert len(answer.mismatch_frame()) == len(answer.mismatch)
    if answer.mismatch:
        assert answer.plot_mismatch().axes
    if answer.fit is None:
        with pytest.raises(ValueError, match="no fit"):
            answer.plot_fit()
    else:
        assert answer.plot_fit().axes


def test_conform_leads_and_laws_are_no_named_effects(bench, monkeypatch):
    """An instrument fault beside a change without a name: what comes nearest, and a law without a name, stand apart."""
    entry = {"parameters": {}, "indistinguishable_from": [], "evidence": {}}
    effects = [
        {"effect": "channel_dead", "where": "acc_2", "probability": 0.99, **entry},
        {"effect": "tooth_wear", "where": "stage1", "probability": 0.34, "nearest": True, **entry},
        {"effect": None, "where": "stage1", "probability": 0.8, "parameters": {}, "term": {"expression": "dead_zone(u)"}},
    ]
    text = json.dumps({"status": "unexplained", "effects": effects, "mismatch": [], "advice": []})
    monkeypatch.setattr(gw._native, "explain", lambda *_, **__: (text, bench))
    answer = gw.explain(bench, [])
    assert [one.effect for one in answer.effects] == ["channel_dead"]
    assert [(one.place, one.probability) for one in answer.nearest] == [("stage1", 0.34)]
    assert answer.law["term"]["expression"] == "dead_zone(u)"
