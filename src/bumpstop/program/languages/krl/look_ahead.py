"""What stops KRL's look ahead at the moves that follow: inputs and outputs, and what may be one by another name."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from bumpstop.program.languages.expression import assigned
from bumpstop.program.languages.syntax import Token

# System variables that a program uses without stopping its look ahead at the moves that follow.
_SPEEDS = "$vel $vel_axis $vel_extax $acc $acc_axis $acc_extax $jerk $gear_jerk"
_SETTINGS = "$apo $tool $base $load $nullframe $ori_type $circ_type $ipo_mode $robroot $out_c $bwdstart"
_AHEAD = frozenset((*_SPEEDS.split(), *_SETTINGS.split()))
_CONDITIONS = ("if", "while", "until", "switch", "case")
_OPERATORS = "then and or not exor b_and b_or b_exor b_not true false"
_WORDS = frozenset((*_CONDITIONS, *_OPERATORS.split()))
# What every program has, and what inline forms assign.
_COMMON = frozenset(("tool_data", "base_data", "load_data", "pdat_act", "ldat_act", "fdat_act"))


def looks_no_further(words: Sequence[Token], variables: Collection[str]) -> bool:
    """Whether the program runs a statement when the arm has come there, and no earlier: it uses inputs or outputs.

    Args:
        words: of the statement.
        variables: names in small letters that are declared as variables; any other name may be a ``SIGNAL``.
    """
    names = [word.text.lower().partition(".")[0] if word.kind == "name" else "" for word in words]
    if any(name.startswith("$") and name not in _AHEAD for name in names):
        return True
    if names[0] in _COMMON or (names[0] not in _CONDITIONS and assigned(words, "=") is None):
        return False
    level = 0
    for word, name, following in zip(words, names, (*words[1:], None), strict=True):
        level += (word.text == "{") - (word.text == "}")
        variable = name == "" or name[0] in "$#" or name in _WORDS or name in _COMMON or name in variables
        if level == 0 and not variable and (following is None or following.text != "("):
            return True
    return False
