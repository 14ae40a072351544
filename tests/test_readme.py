"""The README's example runs as it stands."""

import re
import shutil
from pathlib import Path

from retrue.cli.main import main

ROOT = Path(__file__).parents[1]
DEMO = ROOT / "src" / "retrue" / "demo_data"
README = (ROOT / "README.md").read_text(encoding="utf-8")


def demo_files(folder):
    for name, source in {
        "rig.json": "rig_before.json",
        "pattern.json": "pattern.json",
        "wall.jpg": "scene.jpg",
    }.items():
        shutil.copyfile(DEMO / source, folder / name)


def test_python_example(tmp_path, monkeypatch, capsys):
    demo_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    exec(compile(example, "README.md", "exec"), {})
    reason, cloud = capsys.readouterr().out.splitlines()
    assert "refused" not in reason
    assert re.fullmatch(r"\d{4} points, the nearest 1\.\d\d m away", cloud)


def test_commands(tmp_path, monkeypatch):
    demo_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    commands = [line.split("#")[0].split()[1:] for line in README.splitlines() if line.startswith("retrue ")]
    assert [main(command) for command in commands] == [0, 1, 0, 0]  # the rig has drifted
    assert {"new.json", "cloud.ply", "mesh.ply", "pattern"} <= {path.name for path in tmp_path.iterdir()}


def test_every_page_that_is_linked_is_there():
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).is_file(), f"{page.name}: {target}"
