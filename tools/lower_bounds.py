"""Print the lowest version of every dependency that pyproject.toml allows, as constraints for pip.

``make lower-bounds`` installs these and runs tests on them: a bound that nobody tries is a guess.
"""

from __future__ import annotations

import tomllib
from pathlib import Path


def main() -> None:
    """Print a line ``name==version`` for each dependency of the package and of its extras for users."""
    with (Path(__file__).parents[1] / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    extras = project["optional-dependencies"]
    for requirement in [*project["dependencies"], *extras["plant"], *extras["recording"]]:
        name, bound = requirement.split(">=")
        print(f"{name}=={bound}")


if __name__ == "__main__":
    main()
