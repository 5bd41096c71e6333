from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from campaign_script import make_requests
from graspcast._version import __version__
from graspcast.simulation.campaign import on_node
from graspcast.simulation.campaign.batches import Batches
from graspcast.simulation.campaign.jobs import load_setups, run_batch
from graspcast.simulation.grasps.table import read_grasps


def test_what_differs_is_told_by_package() -> None:
    assert on_node.look({"graspcast": __version__}) == {}
    assert on_node.look({"graspcast": "0.0.9"}) == {"graspcast": __version__}
    assert on_node.look({"no_such_package": "1"}) == {"no_such_package": ""}


def test_a_package_that_is_broken_is_not_called_absent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_one.py").write_text("import no_such_library")
    (tmp_path / "broken_two.py").write_text("raise OSError('libEGL.so: cannot open')")
    monkeypatch.syspath_prepend(tmp_path)
    found = on_node.look({"broken_one": "1", "broken_two": "1"})
    assert "cannot be imported" in found["broken_one"]
    assert "no_such_library" in found["broken_one"]
    assert found["broken_two"] == "cannot be imported (libEGL.so: cannot open)"


def test_nothing_of_graspcast_is_imported_before_the_check() -> None:
    # The code is sent to nodes that may have no graspcast.
    program = (
        "import runpy, sys; sys.modules['graspcast'] = None; "
        f"print(runpy.run_path({on_node.__file__!r})['look']({{'graspcast': '1'}}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("{'graspcast': ")


def test_a_batch_runs_only_where_nothing_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    address = SimpleNamespace(get_node_ip_address=lambda: "10.0.0.3")
    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace(util=address))
    requests = make_requests(3)
    setups = load_setups(requests, read_grasps())
    batch = Batches(requests, np.arange(3))[0]
    setup = setups[batch.setup]
    sent = pickle.dumps(setup), pickle.dumps(batch)
    assert on_node.run({"graspcast": "0"}, *sent) == ("10.0.0.3", None, {"graspcast": __version__})
    node, outcomes, different = on_node.run({"graspcast": __version__}, *sent)
    assert (node, different) == ("10.0.0.3", {})
    assert [o.success for o in outcomes] == [o.success for o in run_batch(setup, batch)]
