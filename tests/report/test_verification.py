"""`trackbench verify`: what was stored comes out again, and what was changed is found."""

import subprocess
import sys

import pytest

from tests.report.forging import reseal
from trackbench import api
from trackbench.experiment.packing import PACKED, pack
from trackbench.verification import verify


def rewrite(folder, name, old, new):
    path = folder / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_what_was_stored_comes_out_again_even_packed(folder):
    assert verify(folder, 5) == []
    pack(folder)
    written = {name: (folder / f"{name}.xz").read_bytes() for name in PACKED}
    pack(folder)
    for name in PACKED:
        assert (folder / f"{name}.xz").read_bytes() == written[name]
        (folder / name).unlink()
    assert verify(folder, 5) == []
    for command in (api.compare, api.plot, api.report):
        command(folder)


def test_blocks_that_fit_come_out_again_of_fewer_runs(tmp_path):
    config = tmp_path / "fitted.yaml"
    config.write_text(
        "name: fitted\nruns: 20\nblock: fit\nscenario: {kind: merwe, T: 4}\n"
        "filters: {PF: {kind: pf, N: 2000}}\n"
        "figures: {last: {kind: estimates, run: 20}}\n"
    )
    folder = api.run(config, out=tmp_path / "out", workers=1, quiet=True, formats=()).folder
    assert verify(folder, 3) == []
    assert verify(folder, 12) == []


def test_another_verdict_is_found(folder):
    rewrite(folder, "comparison.csv", ",near,", ",agrees,")
    rewrite(
        folder, "claims.csv", "Fewer particles are better,fails", "Fewer particles are better,holds"
    )
    first, second = verify(folder, 1)
    assert first.endswith("p, Table 1, None, Mean, No data: recorded 'agrees', now 'near'")
    assert second.endswith("p, Fewer particles are better: recorded 'holds', now 'fails'")


def test_a_claim_that_was_never_recorded_is_found(folder):
    with (folder / "published" / "claims.csv").open("a") as file:
        file.write("p,A new one,small,PF,mean(rmse),>,0,,,text\n")
    (line,) = verify(folder, 1)
    assert line.endswith("p, A new one: recorded 'not recorded', now 'holds'")


@pytest.fixture
def forged(folder):
    """A run's number changed, and the manifest made to agree."""
    rows = (folder / "per_run.csv").read_text().splitlines()
    index = next(i for i, row in enumerate(rows) if row.startswith("PF,3,rmse,"))
    rows[index] = "PF,3,rmse,0.123"
    (folder / "per_run.csv").write_text("\n".join(rows) + "\n")
    reseal(folder)
    return folder


def test_a_run_that_does_not_come_out_again_is_found(forged):
    lines = [line for line in verify(forged, 4) if "per_run.csv" in line]
    assert len(lines) == 1
    assert "the first is 'PF,3,rmse,0.123', computed again 'PF,3,rmse,0." in lines[0]
    assert not [line for line in verify(forged, 3) if "per_run.csv" in line]


def test_the_command_leaves_with_1_if_anything_differs(forged):
    command = "from trackbench.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", command, "verify", str(forged), "--runs", "4"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert "per_run.csv: 1 of" in done.stdout
