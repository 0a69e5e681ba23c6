"""The page's script in node: what it says of scenarios."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

from web.build import compiler

NODE = shutil.which("node")
WHY_NOT = "needs emcc and node: apt-get install emscripten"
MISSING = compiler() is None or NODE is None

_PROGRAM = """
const page = require(process.argv[1]);
const asked = JSON.parse(require("fs").readFileSync(0, "utf8"));
const told = (work) => {
  try { return work(); } catch (error) {
    if (!(error instanceof page.Refusal)) throw error;
    return { refused: error.message, field: error.field };
  }
};
const spelt = (key, value) => {
  return typeof value === "number" && !Number.isFinite(value) ? { not_finite: String(value) } : value;
};
page.load().then((core) => {
  const { what, items } = asked;
  const does = {
    evaluate: (text) => {
      const found = page.evaluate(core, text);
      const coarse = page.finerStepsWarning(core, text, found);
      found.told.verdict.warnings.push(...(coarse === null ? [] : [coarse]));
      return found.told;
    },
    check: (text) => page.check(core, text) ?? {},
    read: (text) => page.readToml(text),
    words: ([name, ...values]) => page[name](...values),
  };
  console.log(JSON.stringify(items.map((item) => told(() => does[what](item))), spelt));
});
"""


def in_node(script: Path, what: str, items: list[Any]) -> list[Any]:
    """What the page makes of each item: ``evaluate``, ``check`` or ``read`` of texts, or ``words`` of names and values.

    What it refuses has the key ``refused``.
    """
    assert NODE is not None
    done = subprocess.run(
        [NODE, "-e", _PROGRAM, str(script)],
        input=json.dumps({"what": what, "items": items}),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found: list[Any] = json.loads(done.stdout)
    return found
