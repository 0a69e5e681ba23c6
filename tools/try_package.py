"""Try an installed bumpstop: imports, data files, every instruction set of this machine, the command, a verdict.

It imports nothing but the package and runs in a folder that holds a copy of ``examples/``. ``make wheel`` runs it in
an empty environment for each wheel; ``python -I tools/try_package.py`` tries whatever is installed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

SCENARIO = "examples/01_hand_downward.toml"


def verdict(target: str) -> dict[str, object]:
    """What the command says of the first example with the kernels of an instruction set."""
    command = [str(Path(sys.executable).with_name("bumpstop")), "evaluate", SCENARIO, "--json"]
    environment = os.environ | {"BUMPSTOP_TARGET": target}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{target}: exit status {done.returncode}\n{done.stderr}")
    found: dict[str, object] = json.loads(done.stdout)
    return found


def main() -> None:
    """Print what was tried; end with an error where something is not as it should be."""
    import bumpstop as bs
    from bumpstop import _cpu, _native

    if Path(bs.__file__).is_relative_to(Path(__file__).parents[1] / "src"):
        sys.exit("bumpstop comes from the sources beside this script: install the package first")
    for name in bs.__all__:
        getattr(bs, name)
    if len(bs.robots()) < 4 or not bs.LimitTable.load("ts15066").regions:
        sys.exit("robots or limit tables are missing")
    targets = _native.available_targets()
    if targets != _cpu.supported_targets():
        sys.exit(f"kernels are missing: this processor runs {_cpu.supported_targets()}, the package has {targets}")
    forces = {target: verdict(target)["peak_force_N"]["p99"] for target in targets}  # type: ignore[index]
    if max(forces.values()) - min(forces.values()) > 1e-8 * max(forces.values()):
        sys.exit(f"the instruction sets differ: {forces}")
    print(f"bumpstop {bs.__version__}, Python {sys.version.split()[0]}: {len(bs.__all__)} public names")
    print(f"p99 of the peak force {min(forces.values()):.4f} N with {', '.join(forces)}")


if __name__ == "__main__":
    main()
