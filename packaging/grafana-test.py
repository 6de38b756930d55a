#!/usr/bin/env python3
"""Every query of the Grafana dashboard, by a Prometheus that scrapes a service with a fault: grafana-test.py GEARWATCH (Debian: prometheus)."""

import json
import pathlib
import re
import socket
import subprocess
import sys
import tempfile
import time
import urllib.parse
import urllib.request

HERE = pathlib.Path(__file__).resolve().parent
# The fault begins after the first of these, and everything is asked for after the second (s).
HEALTHY_S, WATCHED_S = 15, 75

SERVICE = """format = "gearwatch-service/1"
service = {{ page = "127.0.0.1:{page}" }}
[[bench]]
file = "bench.toml"
alarm = {{ needed = 2, of = 3, clear = 10, latch = true }}
learn_from = {{ kind = "test_signal", seed = 1, speed = "max", duration_secs = 60.0 }}
[[bench.source]]
kind = "test_signal"
seed = 3
fault = {{ after_secs = {healthy}.0, stage = "stage1", percent = [3.0, 6.0, -9.0, 12.0, 20.0] }}
[[sink]]
kind = "stdout"
[[sink]]
kind = "mcap_log"
folder = "log"
"""
PROMETHEUS = """global: {{scrape_interval: 2s, evaluation_interval: 2s}}
rule_files: ["{rules}"]
scrape_configs: [{{job_name: gearwatch, static_configs: [{{targets: ["127.0.0.1:{page}"]}}]}}]
"""


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Prometheus:
    def __init__(self, port):
        self.base = f"http://127.0.0.1:{port}/api/v1/"

    def ask(self, path, **parameters):
        with urllib.request.urlopen(self.base + path + "?" + urllib.parse.urlencode(parameters), timeout=10) as answer:
            return json.load(answer)["data"]

    def series(self, expression, seconds):
        now = time.time()
        expression = expression.replace("$bench", ".*")
        return self.ask("query_range", query=expression, start=now - seconds, end=now, step=2)["result"]


def check(dashboard, prometheus):
    """What is wrong with it, a line each."""
    wrong = []
    for variable in dashboard["templating"]["list"]:
        if variable["type"] == "query":
            metric, label = re.fullmatch(r"label_values\((\w+), *(\w+)\)", variable["query"]["query"]).groups()
            if not prometheus.ask(f"label/{label}/values", **{"match[]": metric}):
                wrong.append(f"variable {variable['name']}: no values")
    for panel in dashboard["panels"]:
        for target in panel["targets"]:
            series = prometheus.series(target["expr"], 30)
            legend = target.get("legendFormat", "")
            name = lambda one: re.sub(r"{{(\w+)}}", lambda label: one["metric"].get(label[1], "?"), legend)
            names = {name(one) for one in series}
            print(f"{panel['title']}: {len(series)} series, such as {series[0]['values'][-1][1] if series else None} {sorted(names)[:1]}")
            if not series:
                wrong.append(f"{panel['title']}: no data")
            if any("?" in one for one in names) or ("{{" in legend and len(names) < len(series)):
                wrong.append(f"{panel['title']}: series that cannot be told apart: {sorted(names)}")
    for annotation in dashboard["annotations"]["list"]:
        series = prometheus.series(annotation["expr"], WATCHED_S)
        print(f"annotation {annotation['name']}: {len(series)} series")
        if not series:
            wrong.append(f"annotation {annotation['name']}: the alarm is not among them")
    rules = [rule for group in prometheus.ask("rules")["groups"] for rule in group["rules"]]
    wrong += [f"rule {rule['name']}: {rule['health']}" for rule in rules if rule["health"] != "ok"]
    firing = [rule["name"] for rule in rules if rule["state"] == "firing"]
    print(f"{len(rules)} rules, firing: {firing}")
    if firing != ["GearAlarm"]:
        wrong.append(f"rules: {firing} fire")
    return wrong


def main():
    gearwatch = pathlib.Path(sys.argv[1]).resolve()
    dashboard = json.loads((HERE / "grafana-dashboard.json").read_text())
    bench = HERE.parent / "crates/sim/src/shipped/paper-rig.toml"
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        page, port = free_port(), free_port()
        (folder / "bench.toml").write_text(bench.read_text())
        (folder / "service.toml").write_text(SERVICE.format(page=page, healthy=HEALTHY_S))
        (folder / "prometheus.yml").write_text(PROMETHEUS.format(page=page, rules=HERE / "prometheus-alerts.yml"))
        quiet = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        service = subprocess.Popen([gearwatch, "run", "--config", "service.toml"], **quiet)
        server = subprocess.Popen(
            ["prometheus", "--config.file=prometheus.yml", "--storage.tsdb.path=data", f"--web.listen-address=127.0.0.1:{port}"],
            **quiet,
        )
        try:
            time.sleep(WATCHED_S)
            prometheus = Prometheus(port)
            wrong = check(dashboard, prometheus)
            service.terminate()
            service.wait(20)
            # Two scrapes later the service is known to be gone.
            time.sleep(6)
            (gone,) = [panel for panel in dashboard["panels"] if panel["title"] == "Service"]
            last = [one["value"][1] for one in prometheus.ask("query", query=gone["targets"][0]["expr"])["result"]]
            print(f"Service, after the service has gone: {last}")
            if last != ["0"]:
                wrong.append("Service: a service that has gone is not seen")
        finally:
            for process in (service, server):
                process.kill()
                process.wait()
    for line in wrong:
        print(f"WRONG {line}")
    sys.exit(bool(wrong))


main()
