"""Notebooks without Jupyter: runs the cells in one namespace and keeps what they print and draw.

`python tests/support/notebooks.py examples/paper.ipynb` runs a notebook and writes its outputs into it.
"""

import ast
import base64
import contextlib
import io
import json
import sys
import time
from pathlib import Path


def code_cells(notebook: dict) -> list[dict]:
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def run_notebook(notebook: dict, path: Path | None = None) -> dict[str, object]:
    """Run every code cell, put its outputs into it, keep what is done in a file, and return the names that are left."""
    import matplotlib

    matplotlib.use("Agg")
    names: dict[str, object] = {"__name__": "__main__"}
    for number, cell in enumerate(code_cells(notebook), start=1):
        began = time.monotonic()
        cell["execution_count"], cell["outputs"] = number, list(run_cell("".join(cell["source"]), names, number))
        if path is not None:
            path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(f"cell {number}: {time.monotonic() - began:.1f} s", file=sys.stderr, flush=True)
    return names


def run_cell(source: str, names: dict[str, object], number: int):
    """Run a cell and yield its outputs as a notebook stores them: printed text, the last value, figures."""
    from matplotlib import pyplot

    tree, last = ast.parse(source), None
    if tree.body and isinstance(tree.body[-1], ast.Expr) and not source.rstrip().endswith(";"):
        last = ast.Expression(tree.body.pop().value)
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(tree, f"cell {number}", "exec"), names)
        value = None if last is None else eval(compile(last, f"cell {number}", "eval"), names)
    if said.getvalue():
        yield {"name": "stdout", "output_type": "stream", "text": said.getvalue().splitlines(keepends=True)}
    figures = [pyplot.figure(each) for each in pyplot.get_fignums()]
    if hasattr(value, "savefig") and value not in figures:
        figures.append(value)
    elif value is not None and value not in figures:
        data = {"text/plain": repr(value).splitlines(keepends=True)}
        yield {"data": data, "execution_count": number, "metadata": {}, "output_type": "execute_result"}
    for figure in figures:
        drawn = io.BytesIO()
        figure.savefig(drawn, format="png", dpi=70, bbox_inches="tight")
        data = {"image/png": base64.b64encode(drawn.getvalue()).decode(), "text/plain": ["<Figure>"]}
        yield {"data": data, "metadata": {}, "output_type": "display_data"}
    pyplot.close("all")


if __name__ == "__main__":
    path = Path(sys.argv[1]).resolve()
    run_notebook(json.loads(path.read_text(encoding="utf-8")), path)
