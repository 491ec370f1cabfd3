"""Each example runs as it stands, and the promise of the package is what api.txt lists."""

from __future__ import annotations

import dataclasses
import inspect
import os
import runpy
from pathlib import Path

import pytest

import weldpath

HERE = Path(__file__).resolve().parent
EXAMPLES = sorted((HERE.parent / "examples").glob("*.py"))
SAYS = {
    "papers_stages.py": ("of the overlap nearer than 2 mm", "median intensity on the seams"),
    "from_open3d.py": ("fillet", "seam 1: "),
    "realsense_and_ur.py": ("ready", "fillet", "def "),
}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.name)
def test_an_example_runs(example: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "MPLBACKEND", "Agg")
    runpy.run_path(str(example), run_name="__main__")
    said = capsys.readouterr().out
    for part in SAYS[example.name]:
        assert part in said, said


def test_what_the_guide_shows_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    guide = (HERE.parents[1] / "docs" / "python.md").read_text()
    first = guide.split("```python\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", lambda url: True)
    exec(compile(first, "docs/python.md", "exec"), {})
    assert {"path.script", "weldpath.mod", "report.html"} <= {file.name for file in (tmp_path / "out").iterdir()}


def listing() -> str:
    """Every public name with its signature or its fields."""
    lines = []
    for name in sorted(weldpath.__all__):
        thing = getattr(weldpath, name)
        if inspect.isfunction(thing):
            lines.append(f"{name}{inspect.signature(thing)}")
        elif inspect.isclass(thing):
            bases = [base.__name__ for base in thing.__bases__ if base.__name__ not in ("object", "Short")]
            lines.append(f"class {name}" + (f"({', '.join(bases)})" if bases else ""))
            fields = [field.name for field in dataclasses.fields(thing)] if dataclasses.is_dataclass(thing) else []
            own = [key for key, value in vars(thing).items() if not key.startswith("_") and key not in fields]
            for key in [field for field in fields if not field.startswith("_")] + sorted(own):
                value = inspect.getattr_static(thing, key, None)
                lines.append(f"    {key}{inspect.signature(value) if inspect.isfunction(value) else ''}")
        elif inspect.ismodule(thing):
            lines += [f"{name}.{key}{inspect.signature(getattr(thing, key))}" for key in ("cell", "cell_job", "pipe")]
    return "\n".join(lines) + "\n"


def test_the_promise_is_what_is_listed() -> None:
    kept = HERE.parent / "api.txt"
    if os.environ.get("WELDPATH_WRITE_API"):
        kept.write_text(listing())
    assert listing() == kept.read_text(), "a change for users: WELDPATH_WRITE_API=1, and a line in CHANGELOG.md"
