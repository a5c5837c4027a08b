"""A small experiment with published numbers that are right, nearly right and wrong."""

import shutil

import pytest

from tests.papers import merwe_text
from trackbench import api

HOSTILE = """<script>document.title='x'</script><img src=x onerror="throw 1"> 'a' & b"""

CONFIG = """
name: small
title: A small & <b>quick</b> experiment
seed: 7
runs: 400
block: 200
scenario: MERWE
reference: Exact
published: [numbers.csv, claims.csv]
filters:
  PF: {kind: pf, N: 10}
  PF (N=50): {kind: pf, N: 50}
  "%s": {kind: ukf}
  No data: {kind: prior-mean}
  Exact: {kind: grid, nodes: 40}
tables:
  table1:
    kind: metrics
    title: RMSE
    columns: {Mean: mean(rmse), Variance: variance(rmse), Median: median(rmse)}
figures:
  time: {kind: rmse-vs-time, title: RMSE <i>over</i> time, floor: Exact, baseline: No data}
  runs: {kind: rmse-per-run, filters: [PF]}
  estimates: {kind: estimates, title: One run}
  bars: {kind: bars, title: "Means", floor: Exact, baseline: No data}
  ranks: {kind: critical-difference}
  pairs: {kind: heat-map}
""".replace("MERWE", merwe_text(T=12, switch=6))

NUMBERS = """\
paper,table,filter,metric,value,digits,runs,experiment,label,expression,source,note
p,Table 1,PF,Mean,{pf},4,100000,small,PF,mean(rmse),Table 1,
p,Table 1,PF50,Mean,{pf50},4,100000,small,PF (N=50),mean(rmse),Table 1,
p,Table 1,None,Mean,{near},4,100000,small,No data,mean(rmse),Table 1,
p,Table 1,Exact,Mean,9.9,1,400,small,Exact,mean(rmse),Table 1,plainly wrong
p,Table 1,PF,Particles,10,0,,small,PF,N,Table 1,
p,Table 2,PF,"Gain, %",0,0,400,small,PF,"gain(rms(rmse), PF)",Table 2,
p,Table 2,PF,Step 5,0.5,1,400,small,PF,rmse@5,Table 2,
p,Table 2,MCMC,Mean,1,0,400,small,,,Table 2,not built
p,Table 3,Other,Mean,1,0,40,other,Nobody,mean(rmse),,
"""

CLAIMS = """\
paper,claim,experiment,left,expression,relation,factor,right,tolerance,source
p,More particles are better,small,PF (N=50),mean(rmse),<,1,PF;No data,,text
p,Fewer particles are better,small,PF,rms(rmse),<,0.8,PF (N=50),,text
p,The exact filter is no worse than itself by half,small,Exact,mean(rmse),<,2,Exact,,text
p,PF equals itself,small,PF,mean(rmse),~,1,PF (N=50),0.001,text
p,PF has an error,small,PF,mean(rmse),>,0,,,text
p,Nobody measures this,small,,,,,,,text
"""


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """The folder of a finished run of the small experiment; do not write into it."""
    home = tmp_path_factory.mktemp("small")
    label = HOSTILE.replace('"', '\\"')
    (home / "small.yaml").write_text(CONFIG % label)
    (home / "claims.csv").write_text(CLAIMS.replace("small,,,,,,,text", "small,,,<,,,,text"))
    (home / "numbers.csv").write_text(NUMBERS.format(pf=0, pf50=0, near=0))
    options = api.Options(engine="serial", quiet=True, out=home / "out", formats=("svg",))
    rows = api.run(home / "small.yaml", options, formats=()).comparison.rows
    pf, pf50, none = (row.measured for row in rows[:3])
    numbers = NUMBERS.format(
        pf=f"{pf.value + 0.5 * pf.stderr:.4f}",
        pf50=f"{pf50.value:.4f}",
        near=f"{none.value * 0.91:.4f}",
    )
    (home / "numbers.csv").write_text(numbers)
    api.run(home / "small.yaml", options)
    return home / "out"


@pytest.fixture
def folder(made, tmp_path):
    """A copy of it that a test may change."""
    return shutil.copytree(made, tmp_path / "small")


@pytest.fixture
def hostile():
    """A filter's label that would inject markup if it could."""
    return HOSTILE
