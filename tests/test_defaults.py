"""The program's defaults are what the rule gives for the reports that are published."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from report_tables import DEVICES, MODELS

ROOT = Path(__file__).parents[1]
REPORTS = ROOT / "docs" / "report"
PROGRAM = ROOT / "tests" / "benchmarks" / "defaults.py"


def run(*arguments):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        [sys.executable, PROGRAM, *arguments],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("device", DEVICES)
def test_defaults_are_what_the_rule_gives(device):
    """With each device's own times, and the worst errors."""
    timed = [REPORTS / f"{name}-{device}" / "report.json" for name in MODELS]
    judged = sorted(REPORTS.glob("*/report.json"))
    ended = run(*timed, "--errors", *judged)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stdout.count("<- the rule") == 2


@pytest.mark.parametrize("share, ended", [(0.97, 1), (1.0, 0)])
def test_a_setting_has_to_be_cheaper_beyond_chance(tmp_path, share, ended):
    """Here in each turn, by about so much; what is cheaper by nothing is no default."""
    found, rng = [], np.random.default_rng(0)
    for path in sorted(REPORTS.glob("*-cpu/report.json")):
        report = json.loads(path.read_text())
        times = report["sections"]["rendering"]["values"]["times"]
        noise = rng.normal(scale=0.02, size=len(times["default"]))
        times["stop 0.003"] = (share * (1.0 + noise) * times["default"]).tolist()
        found.append(tmp_path / f"{path.parent.name}.json")
        found[-1].write_text(json.dumps(report))
    assert run(*found).returncode == ended


def test_other_defaults_would_be_seen(tmp_path):
    """Reports in which default mode is too far off."""
    found = []
    for path in sorted(REPORTS.glob("*-cpu/report.json")):
        text = path.read_text()
        wrong = text.replace('"worst_psnr": 6', '"worst_psnr": 1').replace(
            '"worst_psnr": 5', '"worst_psnr": 1'
        )
        assert wrong != text
        found.append(tmp_path / f"{path.parent.name}.json")
        found[-1].write_text(wrong)
    ended = run(*found)
    assert ended.returncode == 1 and not ended.stderr
    assert ended.stdout.count("<- the rule") == 1  # that of the substeps, which are as they were
