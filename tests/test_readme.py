"""The README's Python code runs as it stands, block after block."""

import re
import runpy

from tests.support.places import ROOT


def test_python_blocks_run(tmp_path, monkeypatch):
    """One script of all blocks, in a folder of its own; the motion it simulates is finished and drawn."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    script = tmp_path / "readme.py"
    script.write_text("\n".join(blocks), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    found = runpy.run_path(str(script))
    assert found["motion"].status == "finished"
    assert found["atlas"].contains(found["q0"])
    assert (tmp_path / "motion.html").stat().st_size > 100_000
