# Ranks from a gearwatch log, a baseline and the parts of `gearwatch batch`, with what exists: mcap, pyarrow, duckdb, matplotlib.
# Each `# %%` is a cell for an editor that knows them; as a program:
#
#   python ranks.py LOG.mcap… [--baseline baseline.json] [--parts 'ranks/*.parquet'] [--plot ranks.png]
#
#   pip install mcap zstandard lz4 pyarrow duckdb matplotlib

# %% What is read
import argparse
import json
import math
import statistics

import duckdb
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pyarrow as pa
from mcap.reader import make_reader

arguments = argparse.ArgumentParser(description="Plot ranks from gearwatch logs")
arguments.add_argument("logs", nargs="+", help="MCAP files with verdicts, as the service writes them")
arguments.add_argument("--baseline", help="baseline file")
arguments.add_argument("--parts", help="Parquet files of `gearwatch batch`; * is allowed")
arguments.add_argument("--plot", default="ranks.png")
args = arguments.parse_args()

# %% A log: topics /gear/<stage>/rank, of several benches /gear/<bench>/<stage>/rank, hold one flat JSON object a window and channel
verdicts = []
for path in args.logs:
    with open(path, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if channel.topic.startswith("/gear/") and channel.topic.endswith("/rank"):
                verdicts.append({"bench": "", **json.loads(message.data)})
if not verdicts:
    raise SystemExit("no verdict in " + ", ".join(args.logs))

# A verdict that names no fault state lacks those keys: the table has the keys of all.
names = list(dict.fromkeys(name for verdict in verdicts for name in verdict))
log = pa.table({name: [verdict.get(name) for verdict in verdicts] for name in names if name != "states"})
print(f"{log.num_rows} verdicts of {len(set(log['stage'].to_pylist()))} stage(s)")

# %% DuckDB asks an Arrow table by the name of its variable
print(duckdb.sql("""
    select bench, stage, channel, count(*) as windows,
           round(avg(dev_1x_percent), 2) as mean_1x, round(avg(dev_2x_percent), 2) as mean_2x, mode(machine) as machine
    from log group by all order by all
"""))

# %% Ranks over time: a strip a harmonic; a rank that no window can resolve is grey
LEVEL = {"unknown": -1, "0": 0, "I": 1, "II": 2, "III": 3, "IV": 4, "V": 5}
COLOURS = matplotlib.colors.ListedColormap(["#bbbbbb", "#1b7837", "#7fbf7b", "#fee08b", "#fdae61", "#f46d43", "#b2182b"])
places = sorted({(verdict["bench"], verdict["stage"], verdict["channel"]) for verdict in verdicts})
figure, axes = plt.subplots(len(places), 1, figsize=(9, 0.6 + 1.5 * len(places)), sharex=True, squeeze=False, layout="constrained")
begin_ns = min(verdict["t0_ns"] for verdict in verdicts)
for (bench, stage, channel), axis in zip(places, axes[:, 0]):
    here = sorted((v for v in verdicts if (v["bench"], v["stage"], v["channel"]) == (bench, stage, channel)), key=lambda v: v["t0_ns"])
    seconds = [(v["t0_ns"] - begin_ns) * 1e-9 for v in here]
    hop = statistics.median(b - a for a, b in zip(seconds, seconds[1:])) if len(here) > 1 else 1.0
    levels = [[LEVEL[v[f"rank_{k}x"]] for v in here] for k in range(1, 6)]
    mesh = axis.pcolormesh(seconds + [seconds[-1] + hop], range(6), levels, cmap=COLOURS, vmin=-1.5, vmax=5.5)
    axis.set_yticks([k + 0.5 for k in range(5)], [f"{k}x" for k in range(1, 6)])
    axis.set_title(f"{bench} {stage} at {channel}".strip(), loc="left", fontsize=9)
axes[-1, 0].set_xlabel("time / s")
bar = figure.colorbar(mesh, ax=axes[:, 0], ticks=range(-1, 6), fraction=0.03)
bar.ax.set_yticklabels(LEVEL)
figure.savefig(args.plot, dpi=120)
print("plot:", args.plot)

# %% A baseline: JSON, a run for each recording that it was learned from
if args.baseline:
    baseline = json.load(open(args.baseline))
    print(f"{baseline['format']}, bench {baseline['bench_sha256'][:12]}, windows of {baseline['window_s']} s")
    for run in baseline["runs"]:
        print(f"  {run['recording']}: channels {', '.join(run['channels'])}")

# %% The parts of a batch: one row a window, channel and stage of every recording
if args.parts:
    parts = duckdb.read_parquet(args.parts)
    print(duckdb.sql("""
        select file, channel, count(*) as windows, max(level_2x) as worst_2x,
               round(avg(dev_2x_percent), 2) as mean_2x, round(stddev(dev_2x_percent) / sqrt(count(*)), 2) as standard_error
        from parts group by all order by all
    """))
