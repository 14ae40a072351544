"""The scripts that complete a command line, in real shells on a terminal: a TAB is pressed, then Return."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from retrue.cli.main import main

PATIENCE = 60  # seconds
STARTS = {
    "bash": (["bash", "--norc", "--noprofile", "-i"], "source {script}; bind 'set bell-style none'"),
    "zsh": (["zsh", "-f", "-i"], "autoload -Uz compinit; compinit -D -u; source {script}; unsetopt beep"),
}


class Terminal:
    """A shell in a folder, to type to."""

    def __init__(self, shell: str, script: Path, folder: Path) -> None:
        command, start = STARTS[shell]
        self._master, slave = pty.openpty()
        settings = {
            "PS1": "",
            "PS2": "",
            "PATH": os.environ["PATH"],
            "HOME": str(folder),
            "TERM": "dumb",
            "INPUTRC": "/dev/null",
        }
        self._process = subprocess.Popen(
            command, stdin=slave, stdout=slave, stderr=slave, cwd=folder, env=settings, start_new_session=True
        )
        os.close(slave)
        self.type(start.format(script=script) + "\n")
        self.type("retrue() { printf 'ARGUMENTS<%s>\\n' \"$*\"; }; echo rea''dy\n")
        self.read("ready")

    def type(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def read(self, pattern: str) -> re.Match[str]:
        """As soon as the shell has printed it."""
        end, seen = time.monotonic() + PATIENCE, ""
        while (found := re.search(pattern, seen)) is None:
            assert select.select([self._master], [], [], max(0.0, end - time.monotonic()))[0], seen
            seen += os.read(self._master, 4096).decode(errors="replace")
        return found

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._master)


@pytest.mark.parametrize(
    "shell",
    [
        pytest.param(name, marks=pytest.mark.skipif(shutil.which(name) is None, reason=f"no {name}: make shells"))
        for name in STARTS
    ],
)
def test_a_tab_completes_commands_options_choices_and_files(
    shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["completion", shell]) == 0
    script = tmp_path / "script"
    script.write_text(capsys.readouterr().out)
    folder = tmp_path / "folder"
    (folder / "wall").mkdir(parents=True)
    for name in ("rig.json", "pattern.json"):
        (folder / name).touch()
    terminal = Terminal(shell, script, folder)
    try:
        for typed, expected in (
            ("veri", "verify"),
            ("verify ri", "verify rig.json"),
            ("verify rig.json wa", "verify rig.json wall"),
            ("verify --patt", "verify --pattern"),
            ("verify rig.json --pattern pat", "verify rig.json --pattern pattern.json"),
            ("verify --lens may", "verify --lens may-have-changed"),
            ("calibrate --no-d", "calibrate --no-dense"),
            ("pattern color", "pattern color-grid"),
            ("completion zs", "completion zsh"),
            ("studio --sim", "studio --simulated"),
        ):
            terminal.type(f"retrue {typed}\t\n")
            found = terminal.read(r"ARGUMENTS<([^>]*)>")
            assert found[1].strip().rstrip("/") == expected
    finally:
        terminal.close()


def test_fish_offers_files_and_choices(capsys: pytest.CaptureFixture[str]):
    assert main(["completion", "fish"]) == 0
    script = capsys.readouterr().out
    assert "--no-files" not in script
    assert (
        "'__fish_seen_subcommand_from pattern' --arguments 'color-grid line-grid gray-code phase-shift sequence'"
        in script
    )
