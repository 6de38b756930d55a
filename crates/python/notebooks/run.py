"""Runs the notebooks in a folder of their own, and fails where a cell does: `python run.py [OUT]`."""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

here = Path(__file__).parent
out = Path(sys.argv[1] if len(sys.argv) > 1 else "notebooks-run")
out.mkdir(parents=True, exist_ok=True)
for path in sorted(here.glob("*.ipynb")):
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=1800, resources={"metadata": {"path": str(out)}}).execute()
    nbformat.write(notebook, out / path.name)
    print(path.name, "ran")
