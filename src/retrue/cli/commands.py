"""All commands, in the order in which a newcomer meets them."""

from __future__ import annotations

from retrue.cli.calibrate import Calibrate
from retrue.cli.command import Command
from retrue.cli.completion import Completion
from retrue.cli.convert import Convert
from retrue.cli.decode import Decode
from retrue.cli.demo import Demo
from retrue.cli.diff import Diff
from retrue.cli.experiment import Experiment
from retrue.cli.history import History
from retrue.cli.pattern import Pattern
from retrue.cli.recalibrate import Recalibrate
from retrue.cli.reconstruct import Reconstruct
from retrue.cli.rollback import Rollback
from retrue.cli.simulate import Simulate
from retrue.cli.verify import Verify
from retrue.cli.view import View
from retrue.cli.watch import Watch

COMMANDS: dict[str, type[Command]] = {
    "demo": Demo,
    "pattern": Pattern,
    "decode": Decode,
    "calibrate": Calibrate,
    "recalibrate": Recalibrate,
    "verify": Verify,
    "reconstruct": Reconstruct,
    "view": View,
    "watch": Watch,
    "history": History,
    "rollback": Rollback,
    "diff": Diff,
    "convert": Convert,
    "simulate": Simulate,
    "experiment": Experiment,
    "completion": Completion,
}
EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("retrue demo --out demo-out",),
    "pattern": (
        "retrue pattern color-grid --projector-size 1024 768 --out pattern",
        "retrue pattern gray-code --projector-size 1920 1080 --out pattern",
    ),
    "decode": ("retrue decode wall.jpg --pattern pattern.json --out points.csv",),
    "calibrate": (
        "retrue calibrate capture_*/ --pattern pattern.json \\\n      --board chessboard:7x9:75mm --out rig.json",
    ),
    "recalibrate": (
        "retrue recalibrate rig.json wall.jpg --pattern pattern.json --out new.json",
        "retrue recalibrate rig.json points.csv --in-place --report page.html",
    ),
    "verify": ("retrue verify rig.json wall.jpg --pattern pattern.json",),
    "reconstruct": (
        "retrue reconstruct rig.json scene.jpg --pattern pattern.json --out cloud.ply",
        "retrue reconstruct rig.json scene.jpg --pattern pattern.json \\\n      --out cloud.ply --mesh part.stl",
    ),
    "view": ("retrue view rig.json cloud.ply",),
    "watch": ("retrue watch rig.json incoming/ --pattern pattern.json --out watch-out",),
    "history": ("retrue history rig.json --plot drift.png",),
    "rollback": ("retrue rollback rig.json 3",),
    "diff": ("retrue diff rig.json new.json --working-distance 1500",),
    "convert": ("retrue convert rig.json stereo.yml --to procam-calibration",),
    "simulate": ("retrue simulate clutter --rig rig.json --pattern pattern.json --out made",),
    "experiment": ("retrue experiment noise --out experiment-out",),
    "completion": (
        "retrue completion bash > ~/.local/share/bash-completion/completions/retrue",
        "retrue completion zsh > ~/.zfunc/_retrue   # a folder on $fpath",
        "retrue completion fish > ~/.config/fish/completions/retrue.fish",
    ),
}
