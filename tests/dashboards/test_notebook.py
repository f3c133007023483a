"""A tab in a notebook, run by a kernel of its own as README says it."""

from __future__ import annotations

import nbformat
import pytest
from nbclient import NotebookClient

CELL = """
import panel as pn
from dashboards.session import Session
from dashboards.tabs.{module} import {name}

pn.extension("tabulator")
session = Session()
session.open_beacon_demo()
session.open_range_demo()
{name}(session)
"""


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.parametrize(
    ("module", "name"),
    [("chart", "ChartTab"), ("crossover", "CrossoverTab"), ("timing", "TimingTab"), ("beacon", "BeaconTab")],
)
def test_a_tab_is_shown_in_a_notebook(root, module, name):
    cell = nbformat.v4.new_code_cell(CELL.format(module=module, name=name))
    notebook = nbformat.v4.new_notebook(cells=[cell])
    NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(root)}}).execute()
    shown = [output for output in cell.outputs if output.output_type in ("execute_result", "display_data")]
    assert any(
        "Bokeh.index" in str(output.data) or "bk-root" in str(output.data) or "root_id" in str(output.data)
        for output in shown
    ), [output.get("text") for output in cell.outputs]
